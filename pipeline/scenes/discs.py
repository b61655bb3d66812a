"""Lights that may be smaller than a pixel: drawn so that their flux stays when they move by parts of one."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

EDGE_PX = 0.6
"""Standard deviation of a drawn disc's edge: sampled once a pixel it ripples by 0.2 %."""


def add_discs(
    image: Float[Array, "3 y x"],
    x_px: Float[Array, " light"],
    y_px: Float[Array, " light"],
    radius_px: Float[Array, " light"],
    rgb: Float[Array, "light 3"],
    half: int,
) -> Float[Array, "3 y x"]:
    """Adds discs of light to an image, each within `half` pixels of its middle; their flux is radius²·π·rgb.

    Below a pixel's size a disc is a Gaussian of its second moment, above it has an edge of EDGE_PX; in between both.
    """
    column, row = jnp.floor(x_px).astype(jnp.int32), jnp.floor(y_px).astype(jnp.int32)
    offsets = jnp.arange(-half, half + 1)
    dx = (column[:, None] + offsets + 0.5 - x_px[:, None]).astype(jnp.float32)
    dy = (row[:, None] + offsets + 0.5 - y_px[:, None]).astype(jnp.float32)
    squared = dy[:, :, None] ** 2 + dx[:, None, :] ** 2
    r = radius_px[:, None, None].astype(jnp.float32)
    variance = np.float32(EDGE_PX**2) + r * r / 4
    spot = r * r / (2 * variance) * jnp.exp(-squared / (2 * variance))
    edge = jax.scipy.special.erfc((jnp.sqrt(squared) - r) / np.float32(EDGE_PX * np.sqrt(2))) / 2
    disc = edge * r * r / (r * r + np.float32(EDGE_PX**2))
    large = jnp.clip(r - 1.5, 0, 1)
    cover = spot * (1 - large) + disc * large
    rows = jnp.broadcast_to((row[:, None] + offsets)[:, :, None], cover.shape)
    columns = jnp.broadcast_to((column[:, None] + offsets)[:, None, :], cover.shape)
    # Out of the frame, above or to the left too, is dropped, not wrapped.
    rows, columns = (jnp.where(at < 0, 1 << 20, at) for at in (rows, columns))
    return image.at[:, rows, columns].add(cover[None] * rgb.T[:, :, None, None].astype(jnp.float32), mode="drop")
