"""What a session leaves in its folder, readable at every moment.

frames.py      of each frame: film, pictures, a row of plan.csv
tally.py       plan.csv, and what it comes to
render_log.py  what each frame was rendered from, so that it can be rendered again
kept.py        exact msgpack, arrays too
appended.py    files that grow whole line by whole line
session_file.py  session.json and copies of the files that a session needs
folder.py      folders that are written whole or not at all
finish.py      what is left to do when a take ends: the film in one, the figures together
"""
