"""The shift to blue where rods see (LUI 5.18, after Krawczyk 2005)."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from pipeline.measure import luminance

TINT = (1.05, 0.97, 1.27)
"""What a grey looks like to rods, linear Rec.709 (LUI 5.18)."""


@jax.jit
def night_tint(displayed: Float[Array, "eye 3 y x"], rod_share: Float[Array, "eye"]) -> Float[Array, "eye 3 y x"]:
    """A displayed frame (linear, 1 = peak) blended towards tinted grey by the rods' share σ(L_i) in [0, 1]."""
    sigma = rod_share.astype(jnp.float32)[:, None, None, None]
    tint = jnp.asarray(TINT, jnp.float32)[:, None, None]
    return displayed * (1 - sigma) + tint * luminance(displayed)[:, None] * sigma


def grey_change_code_values(rod_share: float) -> float:
    """At most how many of 255 code values a grey pixel changes.

    Blue, which changes most, gains 0.27·σ of itself, and v·dE/dv of the sRGB encoding E(v) is 0.44 at most.
    """
    return 255 * 0.44 * (max(TINT) - 1) * rod_share
