"""What the planner saw, decided and why, as a picture.

subject.py   what is explained: a frame and how it was looked at, from a file or a session
variants.py  the frame as planned, with everything on, and without each effect
timeline.py  a session's plan over its time
panels.py    the parts of the picture
page.py      the picture
"""
