"""Simulated eyes, labelled with their truth.

eyes.py   a whole session at once, by a seed; its parts: gaze.py, lid.py, pupil.py, tracker.py (what a camera sees)
live.py   the same without an end, before a light that is set while they live; its part: live_pupil.py
truth.py  the labels
"""
