"""What makes the light that CIE 135's curve counts: structures that are drawn, finer particles, the retina.

The curve is the mean of many eyes and knows no wavelength. What cornea, lens and vitreous scatter comes from their
particles, large ones that the pupil plane shows one by one and fine ones that fine_scatter.py has as points; both scale
with the wavelength. The retina's light is smooth, and what is left, so that the mean is CIE's at each wavelength.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.observer import ScatterShares
from entoptic.pipeline.optics import analytic
from entoptic.pipeline.optics.diffraction import WAVELENGTH_NM

RESOLVED = 0.352
"""Of what cornea, lens and vitreous scatter within the field, the structures that are drawn do this share. Engineering
choice: the structures of the default eye scatter 0.28 of CIE's light at 1–2° (measured, 4–8 mm, halo aside)."""
ONSET_DEG = 0.3
"""Where all this begins, as θ²/(θ² + 0.3²). Engineering choice: further in, CIE's light is that of aberrations (its
term of 0.045°), which blur and do not scatter."""
FIELD_SAMPLES = 2048
"""The field of a finer plane is ended where this one's ends."""

Angles = NDArray[np.float64]


def shares(scatter: ScatterShares) -> tuple[float, float]:
    """Of CIE's light within the field, what fine particles scatter and what the retina does."""
    particles = scatter.cornea + scatter.lens + scatter.vitreous
    total = particles + scatter.retina
    return ((1 - RESOLVED) * particles / total, scatter.retina / total) if total else (0.0, 0.0)


def onset(deg: Angles) -> Angles:
    """How much of CIE's light at an angle is scattered."""
    return np.asarray(deg**2 / (deg**2 + ONSET_DEG**2))


def fine_density(deg: Angles, nm: float, age_years: float, pigmentation: float, scatter: ScatterShares) -> Angles:
    """Mean light of the fine particles at a wavelength, in sr⁻¹: their share of CIE's at 575 nm, scaled from there."""
    scale = WAVELENGTH_NM / nm
    at = np.asarray(deg, np.float64) * scale
    return np.asarray(scale**2 * shares(scatter)[0] * analytic.cie135(at, age_years, pigmentation) * onset(at))
