"""Code values for a display with the sRGB transfer function."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt8


@jax.jit
def encode(linear: Float[Array, "eye 3 y x"], black_share: float) -> UInt8[Array, "eye y x 3"]:
    """Code values for a display with the sRGB transfer function whose black is `black_share` of its peak."""
    shown = jnp.clip((linear - jnp.float32(black_share)) / (1 - jnp.float32(black_share)), 0, 1)
    # exp of log: XLA's power costs seven times as much, and 2 code values in a million differ by one.
    root = jnp.exp(jnp.log(jnp.maximum(shown, np.float32(1e-8))) * np.float32(1 / 2.4))
    power = np.float32(1.055) * root - np.float32(0.055)
    encoded = jnp.where(shown <= np.float32(0.0031308), np.float32(12.92) * shown, power)
    return jnp.round(encoded * 255).astype(jnp.uint8).transpose(0, 2, 3, 1)
