"""Accuracy against time: what is left out by each setting, and what it costs. Every number comes from running the code.

errors.py      how far an image is from the truth, in cd/m² and as a display shows it
timing.py      calls that take turns, each timed
scenes.py      the frames that settings are compared on
glare.py       glare's settings, their truth, and the comparison
sun_corner.py  how far from the sun rounding outshines the dark
"""
