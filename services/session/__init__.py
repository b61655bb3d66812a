"""A session by recorded time, in one process.

offline.py  every frame of a recording, and what is left of them
again.py    a folder's session once more, the same frames
differences.py  what they differ in, and what is promised of that
eyes.py     a recording's states and events, as far as a frame needs them
watch.py    the thread that renders, and the one that shows how far it is
"""
