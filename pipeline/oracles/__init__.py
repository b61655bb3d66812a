"""The effects said plainly: the same equations in NumPy and SciPy, float64, written down from the papers.

Nothing here is fast or clever, so it is what the program is compared to, in rounding and in time. One image (3, y, x)
at a time, linear Rec.709.

adaptation.py    the luminance an eye is adapted to, and the exposure
sphere.py        glare as the direct sum over the sphere, for any kernel
point_spread.py  the analytic kernels from their papers
wave_spread.py   wave optics of a pupil plane over the sphere
glare.py         the brightest pixels one by one, the rest by a float64 FFT, the veil at true angles
glare_fft.py     one FFT of the whole frame: what is quick enough to be timed beside
acuity.py        detail lost in the dark
rod_noise.py     photons that rods count
tone.py          the filmic curve, and the display's encoding
operators.py     every tone operator
gamut.py         to white what lies beyond the display's colours
night_colour.py  the shift to blue
afterimage.py    what a bleached retina adds
chain.py         all of them, one after the other
"""
