"""Simulated eyes, labelled with their truth.

eyes.py     a whole session at once, by a seed; its parts: gaze.py, lid.py, pupil.py, tracker.py (what a camera sees)
live.py     the same at the pace of time, before a light that is set while it runs
endless.py  the same without an end, for live sessions
truth.py    the labels
"""
