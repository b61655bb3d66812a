"""What an eye does to a frame, one file an effect, in the order of LUI §4.

adaptation.py     the luminance the eye is adapted to, and the exposure that follows from it
glare.py          light that the eye scatters away from where it belongs
acuity.py         detail that an eye loses in the dark
tone.py           from scene to display luminance, and the display's encoding
night_colour.py   the shift to blue where rods see
"""
