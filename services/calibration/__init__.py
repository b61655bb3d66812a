"""Pupils before white and black screens.

run.py      one run, stepped by a source's items
display.py  asks a display for the screens and hears when they were shown
page/       the screens in a browser
result.py   what a run comes to: problems, or a pupil map
plot.py     its picture
"""
