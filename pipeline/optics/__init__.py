"""Light inside the eye, in metres and degrees.

pupil.py        how wide a pupil is at a luminance and an age
aperture.py     the pupil plane: disc, particles, lens fibre gratings
diffraction.py  the pupil plane's monochromatic point-spread function
spectrum.py     that function at all wavelengths, in RGB, over display pixels
analytic.py     measured point-spread functions as closed formulas
"""

from __future__ import annotations


class OpticsError(Exception):
    """A quantity that the optics cannot represent: the message names it and the remedy."""
