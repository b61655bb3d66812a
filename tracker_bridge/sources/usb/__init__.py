"""USB (HID) eye trackers, live, and what one once sent.

tracker.py  the live source; its parts: device.py (found, opened, read), stream.py (packets to samples), remedies.py
capture.py  a file of all that a tracker sends: written, and read as a source
"""
