"""LUI's fast fit (LUI 5.3, 5.16): σ = max(1 − L*, 0) px, blurred along rows, then along columns, 7 taps each.

Only pixels darker than 0.11 cd/m² (L* = 1) are touched at all. What a frame costs is bytes and exponentials, so: the
stages are kept apart; a pass has one exponential, w = exp(−1/2σ²), since the taps weigh w, w⁴ and w⁹; and the one frame
with a margin serves both passes.
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from entoptic.pipeline.effects.acuity.cielab import CD_M2_PER_LIGHTNESS, lightness, luminance_of
from entoptic.pipeline.effects.pointwise import Planes
from entoptic.pipeline.fast_math import clip, exp2, larger, smaller
from entoptic.pipeline.measure import luminance

LIMIT_CD_M2 = CD_M2_PER_LIGHTNESS
"""Where L* = 1: brighter pixels stay sharp."""
RADIUS_PX = 3
"""7 taps for every σ, enough up to 1 px (LUI 5.3.2): LUI's 2⌊3σ⌋+1 would drop a tap of 1 % and jump there."""
LEAST_VARIANCE = np.float32(0.02)
"""px²; below it σ is taken as this, whose taps weigh 1e-11 beside the middle one."""
LEAST_WEIGHT = np.float32(2e-4)
"""Of the first tap as the others are computed from it: the third's is its ninth power, 5e-34, no denormal number."""


def dark_acuity(rgb: Float[Array, "eye 3 y x"]) -> Float[Array, "eye 3 y x"]:
    """A frame in cd/m² with its dark parts blurred."""
    return add_grey(rgb, change_of_luminance(rgb))


@jax.jit
def change_of_luminance(rgb: Float[Array, "eye 3 y x"]) -> Float[Array, "eye y x"]:
    """What the blur changes each pixel's luminance by, in cd/m²."""
    # Kept apart, or XLA would fuse the cheap end of one stage into the next and compute it once for each tap.
    (lit,) = jax.lax.optimization_barrier((lightness(luminance(rgb)),))
    (padded,) = jax.lax.optimization_barrier((with_margin(lit),))
    return change_of_padded(padded)


def change_of_padded(padded: Float[Array, "eye y+6 x+6"]) -> Float[Array, "eye y x"]:
    """The same of lightness with a margin."""
    (rows,) = jax.lax.optimization_barrier((blur(padded, 2),))
    return luminance_change(rows, padded)


def with_margin(values: Float[Array, "eye y x"]) -> Float[Array, "eye y+6 x+6"]:
    """The frame with its edge repeated RADIUS_PX times on all sides."""
    height, width = values.shape[1:]
    margin = (RADIUS_PX, RADIUS_PX, 0)
    # One copy and four narrow writes into it; jnp.pad makes a copy for each direction and more.
    padded = jax.lax.pad(values, np.float32(0), ((0, 0, 0), margin, margin))

    def wide(column: Float[Array, "eye y 1"]) -> Float[Array, "eye y 3"]:
        return jnp.broadcast_to(column, (*column.shape[:2], RADIUS_PX))

    def across(row: Float[Array, "eye 1 x"]) -> Float[Array, "eye 3 x+6"]:
        row = jnp.concatenate([wide(row[:, :, :1]), row, wide(row[:, :, -1:])], 2)
        return jnp.broadcast_to(row, (row.shape[0], RADIUS_PX, row.shape[2]))

    for part, row, column in (
        (wide(values[:, :, :1]), RADIUS_PX, 0),
        (wide(values[:, :, -1:]), RADIUS_PX, RADIUS_PX + width),
        (across(values[:, :1]), 0, 0),
        (across(values[:, -1:]), RADIUS_PX + height, 0),
    ):
        padded = jax.lax.dynamic_update_slice(padded, part, (0, row, column))
    return padded


def luminance_change(rows: Float[Array, "eye y+6 x"], padded: Float[Array, "eye y+6 x+6"]) -> Float[Array, "eye y x"]:
    """What the blur changes each luminance by, in cd/m²: from blurred rows and the lightness that they are of."""
    sharp = padded[:, RADIUS_PX:-RADIUS_PX, RADIUS_PX:-RADIUS_PX]
    # A dark pixel is in the linear part of CIELAB; what it is blurred to need not be.
    change = luminance_of(blur(rows, 1)) - sharp * np.float32(CD_M2_PER_LIGHTNESS)
    return jnp.where(sharp < 1, change, 0)


def add_grey_to_planes(image: Planes, scene: Planes, numbers: tuple[()], planes: Planes, tables: tuple[()]) -> Planes:
    """`add_grey` as one of a pass's functions; `planes` has the change alone."""
    return tuple(larger(plane + planes[0], smaller(plane, 0)) for plane in image)


@jax.jit
def add_grey(rgb: Float[Array, "eye 3 y x"], change: Float[Array, "eye y x"]) -> Float[Array, "eye 3 y x"]:
    """A frame with its luminance changed and a* and b* kept.

    In the linear part of CIELAB, a change of L* adds the same to X, Y and Z relative to white, so it adds the same to
    R, G and B: that is done here, without the way to CIELAB and back. No channel falls below 0 by it; one that was
    below, a colour outside the display's, falls no further.
    """
    return larger(rgb + change[:, None], smaller(rgb, 0))


def blur(values: Float[Array, "eye y x"], axis: int) -> Float[Array, "eye y x"]:
    """One pass of the blur along an axis, each pixel with the σ of its own lightness. The result lacks the margin."""
    size = values.shape[axis] - 2 * RADIUS_PX

    def tap(offset: int) -> Float[Array, "eye y x"]:
        return jax.lax.slice_in_dim(values, RADIUS_PX + offset, RADIUS_PX + offset + size, axis=axis)

    sigma = clip(1 - tap(0), 0, 1)
    first = exp2(np.float32(-0.5 / math.log(2)) / larger(sigma * sigma, LEAST_VARIANCE))
    base = larger(first, LEAST_WEIGHT)
    fourth = base * base * base * base
    ninth = fourth * fourth * base
    total = tap(0) + first * (tap(-1) + tap(1)) + fourth * (tap(-2) + tap(2)) + ninth * (tap(-3) + tap(3))
    return total / (1 + 2 * (first + fourth + ninth))
