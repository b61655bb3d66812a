"""What the embedded street is built of, and where it stands: metres, luminances, albedos and colours."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

EYE_HEIGHT_M = 1.5
ROAD_M, PAVEMENT_M = 4.0, 8.0
"""Half widths: of the road, and of all up to the facades."""
WINDOW_M, FLOOR_M = 2.6, 3.2
BUILDING_M, PARAPET_M = 5 * WINDOW_M, 0.5
"""Five windows wide and three to five floors high, so that neither neighbour nor roof cuts a window."""
ROOF_CLIMB = np.float32(1.5)
"""A roof is about 12 m above the eye and 8 m beside it: the slope of its line in a picture straight ahead."""
WALLS_END_M = 400.0
LIT_SHARE = 0.28

ASPHALT, PAVING, PAINT, KERB, WALL, GLASS = 0.07, 0.16, 0.45, 0.3, 0.22, 0.07
"""Albedos."""

SODIUM = (1.75, 0.86, 0.17)
LED = (1.16, 0.97, 0.83)
WARM = (1.45, 0.92, 0.45)
XENON = (0.95, 1.0, 1.12)
SKY = (0.72, 1.0, 1.5)
"""Linear Rec.709 at luminance 1."""

DARK_CD_M2 = 0.02
"""Of what stands against the light."""
LAMP_HEIGHT_M, LAMP_DOWN_CD = 6.5, 900.0
"""Luminaires with cut-off: 900 cd downwards, 0.5 cd/m² on the asphalt below."""
LAMPS_END_M, BEYOND_LUX = 81.0, 8.2
"""How far from the middle of the row lamps light the street, and the mean that stands for those after the last."""
BEAM_CD = 2e4
"""Of headlights on the road before them."""
START_M, SPEED_M_S = 100.0, 13.0
"""From where and how fast a car comes."""
MOON_LUX = 0.15
"""On what faces the moon; on all else in the street 0.4 of it, from the sky around."""
GABLE_CD_M2 = np.float32(0.4 * MOON_LUX * WALL / np.pi)


def _lamp_places() -> np.ndarray:
    z = np.arange(-1, 8) * 18.0 + 9.0
    x = np.where(np.arange(len(z)) % 2 == 0, -5.3, 5.3)
    return np.stack([x, np.full_like(z, LAMP_HEIGHT_M), z], axis=1).astype(np.float32)


LAMPS_M = _lamp_places()
LAMP_RGB = np.where((np.arange(len(LAMPS_M)) % 2 == 0)[:, None], SODIUM, LED).astype(np.float32)


def arrived(oncoming_m: Array) -> Array:
    """0 where a car appears, 1 from a second on: otherwise its lights would jump when the next one comes."""
    return jnp.clip((START_M - oncoming_m) / SPEED_M_S, 0, 1)
