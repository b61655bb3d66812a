"""Light inside the eye, in metres and degrees.

pupil.py          how wide a pupil is at a luminance and an age
aperture.py       the pupil plane: how all that shades it stands at one moment
  cornea.py lens.py vitreous.py lids.py   what shades it, each with its own statistics
  coverage.py     how much of a grid's cells a shape covers, exactly
ocular_dynamics.py         what moves from frame to frame
  microfluctuations.py lens_springs.py vitreous_motion.py value_noise.py damped.py
focus.py          the phase of a pupil out of focus
diffraction.py    from pupil plane to retina at one wavelength
fine_scatter.py   particles finer than the plane's samples, and their needles (straylight.py)
monochromatic.py  one eye's function at one wavelength, of all this
light_spectra.py  what each wavelength contributes to the frame's channels
spectrum.py       the monochromatic function at all wavelengths, over display pixels
analytic.py       measured point-spread functions as closed formulas, and their transfer functions
radial.py         a radial density's light: over pixels, within an angle, over the hemisphere
flare_lines.py    the radial lines that such a formula lacks
whole.py          the whole function of one eye, from its peak to 90°
moving_kernel.py  the same of an eye in motion, from that of the eye at rest
"""

from __future__ import annotations

from entoptic.errors import EntopticError


class OpticsError(EntopticError):
    """A quantity that the optics cannot represent: the message names it and the remedy."""
