"""Where perceived frames go.

images.py      single frames: PNG or EXR as the display takes them, EXR in absolute luminance
video.py       a film
video_parts.py films of what happens now, readable while they are written, and one of them all
hdr10.py       what is particular to a film for an HDR10 display
"""
