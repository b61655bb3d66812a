"""Patterns averaged over a pixel's footprint, so that nothing far away shimmers, and numbers drawn for places."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt32


def reciprocal(positive: Array) -> Array:
    """1/x within three roundings, in a third of a division's time: XLA has an instruction for the root."""
    root = jax.lax.rsqrt(positive)
    return root * root


def repeat(at: Array, period: float) -> Array:
    """Modulo; XLA's own calls the C library for each pixel."""
    return at - np.float32(period) * jnp.floor(at * np.float32(1 / period))


def stripe(at: Array, centre: float, width: float, footprint: Array) -> Array:
    """Share of a footprint that a stripe covers."""
    low = jnp.maximum(at - footprint / 2, centre - width / 2)
    high = jnp.minimum(at + footprint / 2, centre + width / 2)
    return jnp.clip((high - low) * reciprocal(footprint), 0, 1)


def stripes(at: Array, period: float, start: float, width: float, footprint: Array) -> Array:
    """Share of a footprint of any size that stripes cover."""

    def covered_up_to(place: Array) -> Array:
        whole = jnp.floor(place * np.float32(1 / period))
        return whole * np.float32(width) + jnp.clip(place - np.float32(period) * whole - np.float32(start), 0, width)

    return (covered_up_to(at + footprint / 2) - covered_up_to(at - footprint / 2)) * reciprocal(footprint)


def uniform(a: Array, b: Array, salt: int) -> Float[Array, "..."]:
    """Uniform in [0, 1) for two integers, the same on every machine."""
    value: UInt32[Array, "..."] = a.astype(jnp.uint32) * np.uint32(0x9E3779B1) ^ b.astype(jnp.uint32) * np.uint32(
        0x85EBCA77
    )
    value = (value ^ np.uint32(salt * 0xC2B2AE3D & 0xFFFFFFFF)) * np.uint32(0x27D4EB2F)
    value = (value ^ (value >> 15)) * np.uint32(0x2C1B3C6D)
    value = value ^ (value >> 12)
    return (value >> 8).astype(jnp.float32) * np.float32(2**-24)
