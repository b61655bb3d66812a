"""One person's eye as light: `entoptic psf`.

subject.py        whose eye, how it stands, and the light it looks at
profile.py        light per steradian and encircled light over the angle, as tables
picture.py        the colour picture: light per steradian, log-compressed, on an sRGB display
plots.py          psf.png, pupil_plane.png, profiles.png
sheets.py         pictures side by side, in which one thing differs; layout.py puts them together
film.py           the eye in motion
results.py        all that the command writes
"""
