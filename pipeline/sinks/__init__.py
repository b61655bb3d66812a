"""Where perceived frames go.

images.py      single frames: PNG as the display takes them, EXR in absolute luminance
video.py       a film
whole_file.py  a file is there when it is whole
"""
