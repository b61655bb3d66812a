"""The effects said plainly: the same equations in NumPy and SciPy, float64, written down from the papers.

Nothing here is fast or clever, so it is what the program is compared to, in rounding and in time. One image (3, y, x)
at a time, linear Rec.709.

adaptation.py    the luminance an eye is adapted to, and the exposure
sphere.py        light at the angle that every pixel has from every other
point_spread.py  the functions by which it falls with the angle
glare.py         the two for one eye
acuity.py        detail lost in the dark
rod_noise.py     photons that rods count
tone.py          the filmic curve, and the display's encoding
operators.py     every tone operator
gamut.py         to white what lies beyond the display's colours
night_colour.py  the shift to blue
afterimage.py    what a bleached retina adds
chain.py         all of them, one after the other
"""
