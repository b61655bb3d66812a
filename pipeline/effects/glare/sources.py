"""Glare of a frame's brightest pixels alone: each lays down the kernel, without an FFT.

Only the pixels taken scatter; the others keep their light. It is instant: a frame depends on no other.
"""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare import convolve, splat
from entoptic.pipeline.effects.glare.kernel import Mixture
from entoptic.pipeline.measure import SOURCE_RATIO, Measurement

MOST_SOURCES = 128
"""Pixels taken at most. Engineering choice: more take longer than the window's FFT."""


@dataclasses.dataclass(frozen=True, eq=False)
class Taken:
    """Which pixels scatter."""

    above_cd_m2: float
    at: NDArray[np.intp]
    """Row and column (n, 2), brightest first."""
    left_out: int
    """Pixels above the threshold that do not scatter, being too many."""


def glare_sources(
    rgb: Float[Array, "3 y x"],
    mixture: Mixture,
    measured: Measurement,
    *,
    above_cd_m2: float | None = None,
    ceiling_cd_m2: float | None = None,
    onto: Float[Array, "3 y x"] | None = None,
) -> tuple[Float[Array, "3 y x"], Taken]:
    """A frame in cd/m² with what a kernel makes of its brightest pixels, and which these were.

    They are those above `above_cd_m2`, by default SOURCE_RATIO times the frame's mean, MOST_SOURCES at most. Above a
    `ceiling_cd_m2`, only the light above it spreads. The change is added to `onto`, whose memory
    the result takes over; to a copy of the frame if None.
    """
    if above_cd_m2 is None:
        above_cd_m2 = SOURCE_RATIO * measured.mean_cd_m2
    if ceiling_cd_m2 is not None:
        above_cd_m2 = max(above_cd_m2, ceiling_cd_m2)
    if measured.max_cd_m2 <= above_cd_m2:
        return rgb if onto is None else onto, Taken(above_cd_m2, np.empty((0, 2), np.intp), 0)
    at, light = splat.bright_pixels(rgb, above_cd_m2)
    taken = Taken(above_cd_m2, at[:MOST_SOURCES], max(len(at) - MOST_SOURCES, 0))
    light = light[:MOST_SOURCES]
    if ceiling_cd_m2 is not None:
        light = light * convolve.spill_share(splat.luminances(light), ceiling_cd_m2)[:, None]
    image = jnp.array(rgb, copy=True) if onto is None else onto
    return splat.lay_down(image, taken.at, light, mixture), taken
