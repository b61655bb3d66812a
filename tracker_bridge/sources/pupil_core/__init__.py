"""Pupil Core: live from Pupil Capture or Service, from its recordings, from Pupil Player's tables, and back to files.

capture.py        Capture or Service, live over its Network API; its parts: link.py (two threads and sockets),
                  remote.py (what may be asked of Pupil Remote), bus.py (messages off the data port), tasks.py (what
                  Capture was told to do, until it reports)
recording.py      recordings: folders or *.pldata files
player_export.py  tables that Pupil Player exports
datum.py          one pupil or gaze datum, from bytes to samples; streams.py: a whole session of them, as a source
form.py           samples as such datums; recorder.py writes them, while they come or at once
"""
