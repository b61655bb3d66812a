"""Accuracy against time: what is left out by each setting, and what it costs. Every number comes from running the code.

errors.py       how far an image is from the truth, in its own unit and as a display shows it
timing.py       calls that take turns, each timed
scenes.py       the frames that settings are compared on (landscape.py, rooms.py)
viewing.py      an eye viewing a scene: what each effect starts from, and what becomes of its image
whole_frame.py  combinations of them, and which to take at a rate
everything.py   every variant of every effect beside its oracle, and the whole frame, over all scenes
calibration.py  what each level takes on this machine, for planning within a budget
glare.py        glare's settings, their truth, and the comparison
sun_corner.py   how far from the sun rounding outshines the dark
"""
