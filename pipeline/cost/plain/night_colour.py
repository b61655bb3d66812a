"""The shift to blue where rods see (LUI 5.18)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.cost.plain.adaptation import luminance, rod_share

Reals = NDArray[np.float64]

TINT = (1.05, 0.97, 1.27)


def night_tint(displayed: Reals, adapted_cd_m2: float) -> Reals:
    """A displayed frame blended towards tinted grey by the rods' share."""
    rods = rod_share(adapted_cd_m2)
    grey = np.array(TINT)[:, None, None] * luminance(displayed)
    return displayed * (1 - rods) + grey * rods
