"""The effects said plainly: the same equations in NumPy and SciPy, float64, written down from the papers.

Nothing here is fast or clever, so it is what the program is compared to, in rounding and in time. One image (3, y, x)
at a time, linear Rec.709.

adaptation.py    the luminance an eye is adapted to, and the exposure
glare.py         a kernel by one FFT of the whole frame, the veil by sums at true angles
acuity.py        detail lost in the dark
tone.py          to the display's range, and its encoding
night_colour.py  the shift to blue
whole.py         all of them, one after the other
"""
