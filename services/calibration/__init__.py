"""Pupils before white and black screens.

pupil_calibration.py  runs before one display, begun, stepped and concluded
run.py                one run, stepped by a source's items
display.py            asks a display for the screens and hears when they were shown
page/                 the screens in a browser
result.py             what a run comes to: problems, or a pupil map
outcome.py            the same as files and figures, worked out at once or by a process
plot.py               its picture
"""
