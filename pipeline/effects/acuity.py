"""Detail that an eye loses in the dark (LUI §5.3, the fast fit).

Only lightness is blurred, with a Gaussian whose width follows each pixel's own lightness: σ = max(1 − L*, 0) px, L* of
CIELAB with white at 100 cd/m². So only pixels darker than 0.11 cd/m² (L* = 1) are touched at all.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pipeline.measure import luminance

WHITE_CD_M2 = 100.0
KAPPA, EPSILON = 24389 / 27, 216 / 24389
"""CIELAB's slope at black and the end of its linear part (CIE 15:2004)."""
LIMIT_CD_M2 = WHITE_CD_M2 / KAPPA
"""Where L* = 1: brighter pixels stay sharp."""
RADIUS_PX = 3
"""7 taps are enough for σ ≤ 1 (LUI §5.3.2)."""


def lightness(y_cd_m2: Float[Array, "..."]) -> Float[Array, "..."]:
    """L* of CIELAB, 0 at black, 100 at 100 cd/m²."""
    relative = y_cd_m2 / np.float32(WHITE_CD_M2)
    # exp of log: XLA's cube root costs seven times as much for the same seven digits.
    root = jnp.exp(jnp.log(jnp.maximum(relative, np.float32(EPSILON))) * np.float32(1 / 3))
    return jnp.where(relative > np.float32(EPSILON), 116 * root - 16, np.float32(KAPPA) * relative)


def luminance_of(lightness_: Float[Array, "..."]) -> Float[Array, "..."]:
    """The luminance in cd/m² of an L*."""
    above = ((lightness_ + 16) / 116) ** 3
    relative = jnp.where(lightness_ > np.float32(KAPPA * EPSILON), above, lightness_ / np.float32(KAPPA))
    return relative * np.float32(WHITE_CD_M2)


@jax.jit
def dark_acuity(rgb: Float[Array, "eye 3 y x"]) -> Float[Array, "eye 3 y x"]:
    """A frame in cd/m² with its dark parts blurred.

    In the linear part of CIELAB, a change of L* at constant a* and b* adds the same to X, Y and Z relative to white, so
    it adds the same to R, G and B: that is done here, without the way to CIELAB and back.
    """
    y = luminance(rgb)
    blurred = _blur(_blur(lightness(y), axis=2), axis=1)
    dark = y < np.float32(LIMIT_CD_M2)
    change = jnp.where(dark, luminance_of(blurred) - y, 0)
    return jnp.maximum(rgb + change[:, None], 0)


def _blur(values: Float[Array, "eye y x"], axis: int) -> Float[Array, "eye y x"]:
    """One pass of the blur, each pixel with its own σ; the frame's edge is repeated."""
    sigma = jnp.clip(1 - values, 0, 1)
    # At σ = 0 every tap but the middle one underflows to 0.
    inverse = 1 / jnp.maximum(2 * sigma * sigma, np.float32(1e-4))
    pad = [(0, 0)] * 3
    pad[axis] = (RADIUS_PX, RADIUS_PX)
    padded = jnp.pad(values, pad, mode="edge")
    total, weight_sum = values, jnp.ones_like(values)
    for k in range(1, RADIUS_PX + 1):
        weight = jnp.exp(np.float32(-k * k) * inverse)
        size = values.shape[axis]
        before = jax.lax.slice_in_dim(padded, RADIUS_PX - k, RADIUS_PX - k + size, axis=axis)
        after = jax.lax.slice_in_dim(padded, RADIUS_PX + k, RADIUS_PX + k + size, axis=axis)
        total = total + weight * (before + after)
        weight_sum = weight_sum + 2 * weight
    return total / weight_sum
