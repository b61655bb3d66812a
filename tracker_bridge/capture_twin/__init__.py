"""A stand-in for Pupil Capture: everything that a client sees of the real program, made of recorded or simulated eyes.

standin.py    the program: its sockets and its only loop
remote.py     Pupil Remote's answers
backbone.py   the IPC backbone: what is published, and what clients send to all
playback.py   where the eyes' data come from, and when
published.py  recordings and samples in the form in which Capture 3.6.14 publishes them
blinks.py     Pupil's own blink filter
tasks.py      gaze calibrations and recordings that clients ask for
clock.py      Pupil time
faults.py     what may go wrong, on request
"""

from __future__ import annotations

from entoptic.errors import EntopticError


class CaptureError(EntopticError):
    """The stand-in cannot do what it was asked to do: the message names the thing and the remedy."""
