"""Lightness of CIELAB with white at 100 cd/m², and back: what acuity blurs (LUI 5.3.1)."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from entoptic.pipeline.fast_math import cube_root

WHITE_CD_M2 = 100.0
KAPPA, EPSILON = 24389 / 27, 216 / 24389
"""CIELAB's slope at black and the end of its linear part (CIE 15:2004)."""
LINEAR_END = KAPPA * EPSILON
"""L* = 8, 0.886 cd/m²: up to here lightness is proportional to luminance."""
CD_M2_PER_LIGHTNESS = WHITE_CD_M2 / KAPPA
"""cd/m² for each unit of L* in the linear part: 0.1107."""


def lightness(y_cd_m2: ArrayLike) -> Float[Array, "..."]:
    """L* of CIELAB, 0 at black, 100 at 100 cd/m²; float32."""
    relative = jnp.asarray(y_cd_m2, jnp.float32) / np.float32(WHITE_CD_M2)
    return jnp.where(relative > np.float32(EPSILON), 116 * cube_root(relative) - 16, np.float32(KAPPA) * relative)


def luminance_of(lightness_: Float[Array, "..."]) -> Float[Array, "..."]:
    """The luminance in cd/m² of an L*."""
    above = ((lightness_ + 16) / 116) ** 3
    relative = jnp.where(lightness_ > np.float32(LINEAR_END), above, lightness_ / np.float32(KAPPA))
    return relative * np.float32(WHITE_CD_M2)
