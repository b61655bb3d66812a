"""How far an eye is open, told from how much of its pupil a lid leaves to see.

Latency: none. What it can tell ends where the lid does not touch the pupil, and where the pupil is no longer found: an
eye of 4 mm pupil looks wholly open until it is 0.7 open.
"""

from __future__ import annotations

import numpy as np

FISSURE_MM = 10.0
"""Height of the open lids' gap (9–11 mm in healthy adults)."""
PUPIL_HEIGHT_MM = 5.0
"""Height of the pupil's centre in it: the light reflex lies 4–5 mm below the upper lid's edge in healthy adults (the
"margin reflex distance" of eyelid surgery)."""
USUAL_DIAMETER_MM = 4.0
"""Of a pupil whose diameter in mm nobody knows. Engineering choice."""

_HEIGHTS = np.linspace(0.0, 1.0, 201)
# The diameter of a circle with the area that is left below a chord at this share of a circle's height.
_SIZES = np.sqrt((np.arccos(1 - 2 * _HEIGHTS) - 2 * (1 - 2 * _HEIGHTS) * np.sqrt(_HEIGHTS - _HEIGHTS**2)) / np.pi)


def estimated_openness(apparent_share: float, diameter_mm: float | None) -> float:
    """Openness, 0 … 1, of an eye whose pupil of `diameter_mm` looks as small as this share of it, from 0 up.

    Assumes that the tracker reports the diameter of the circle with the area that is to see. 1 where it is whole.
    """
    if apparent_share >= 1.0:
        return 1.0
    whole_mm = USUAL_DIAMETER_MM if diameter_mm is None else diameter_mm
    height_mm = float(np.interp(apparent_share, _SIZES, _HEIGHTS)) * whole_mm
    return min(max((height_mm + PUPIL_HEIGHT_MM - whole_mm / 2) / FISSURE_MM, 0.0), 1.0)
