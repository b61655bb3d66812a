"""The fast fit on the dark parts of a frame alone: what a mostly bright frame pays.

Dark tiles are taken block by block, with the margin that the blur needs, as if each block were an eye's image; so the
same functions do the same to the same pixels. Blocks are computed several at a time, which keeps both cores at work.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import NDArray

from entoptic.pipeline.effects.acuity import fit
from entoptic.pipeline.effects.acuity.cielab import lightness
from entoptic.pipeline.measure import luminance

BLOCK_PX = 96
"""Side of a block, about. Engineering choice: its margin is an eighth more, and its 150 kB stay in a core's cache."""
AT_ONCE = 16
"""Blocks. Engineering choice: enough to share out, few enough that the last, filled up, wastes little."""
WORTHWHILE = 0.4
"""Share of blocks that are dark from which on the whole frame is cheaper (docs/acuity.md)."""


def change_of_luminance(
    rgb: Float[Array, "eye 3 y x"], tiles: NDArray[np.bool_], tile_px: int
) -> Float[Array, "eye y x"]:
    """What the blur changes each pixel's luminance by, in cd/m², in these tiles of `tile_px` (rows, columns).

    The same as `fit.change_of_luminance` if every pixel below LIMIT_CD_M2 lies in one of them.
    """
    height, width = rgb.shape[2:]
    side = max(BLOCK_PX // tile_px, 1)
    block_px = side * tile_px
    rows, columns = -(-tiles.shape[0] // side), -(-tiles.shape[1] // side)
    padded = np.zeros((rows * side, columns * side), bool)
    padded[: tiles.shape[0], : tiles.shape[1]] = tiles
    blocks = np.argwhere(padded.reshape(rows, side, columns, side).any((1, 3)))
    small = min(height, width) < block_px + 2 * fit.RADIUS_PX
    if small or len(blocks) > WORTHWHILE * rows * columns:
        return fit.change_of_luminance(rgb)
    corners = np.minimum(blocks * block_px, (height - block_px, width - block_px))
    eyes = np.arange(rgb.shape[0])
    places = np.array([(eye, *corner) for eye in eyes for corner in corners], np.int32)
    result = jnp.zeros((rgb.shape[0], height, width), jnp.float32)
    for start in range(0, len(places), AT_ONCE):
        # The last of them again and again, where they do not fill up: it is the same each time.
        some = places[np.minimum(np.arange(start, start + AT_ONCE), len(places) - 1)]
        inside, within = _inside(some, rgb.shape, block_px), _within(some, rgb.shape, block_px)
        result = _with_blocks(result, rgb, some, inside, within, block_px)
    return result


def _inside(places: Int[np.ndarray, "block 3"], shape: tuple[int, ...], block_px: int) -> Int[np.ndarray, "block 3"]:
    """Upper left corners of blocks with their margin, moved inwards at the frame's edge."""
    side = block_px + 2 * fit.RADIUS_PX
    last = (shape[0], shape[2] - side, shape[3] - side)
    return np.clip(places - (0, fit.RADIUS_PX, fit.RADIUS_PX), 0, last).astype(np.int32)


def _within(places: Int[np.ndarray, "block 3"], shape: tuple[int, ...], block_px: int) -> Int[np.ndarray, "2 block p"]:
    """Which row and which column of what was cut each one of a block with its margin is: the edge's own beyond it."""
    steps = np.arange(-fit.RADIUS_PX, block_px + fit.RADIUS_PX)
    cut = _inside(places, shape, block_px)
    return np.stack(
        [np.clip(places[:, axis, None] + steps, 0, shape[axis + 1] - 1) - cut[:, axis, None] for axis in (1, 2)]
    ).astype(np.int32)


@functools.partial(jax.jit, static_argnames="block_px", donate_argnums=0)
def _with_blocks(
    result: Float[Array, "eye y x"],
    rgb: Float[Array, "eye 3 y x"],
    places: Int[Array, "block 3"],
    inside: Int[Array, "block 3"],
    within: Int[Array, "2 block p"],
    block_px: int,
) -> Float[Array, "eye y x"]:
    (lit,) = jax.lax.optimization_barrier((_lightness_of(_cut(rgb, inside, block_px), within),))
    return _put(result, fit.change_of_padded(lit), places)


def _cut(rgb: Float[Array, "eye 3 y x"], places: Int[Array, "block 3"], block_px: int) -> Float[Array, "block 3 p p"]:
    side = block_px + 2 * fit.RADIUS_PX

    def one(place: Int[Array, "3"]) -> Float[Array, "3 p p"]:
        return jax.lax.dynamic_slice(rgb, (place[0], jnp.int32(0), place[1], place[2]), (1, 3, side, side))[0]

    return jax.lax.map(one, places)


def _lightness_of(cut: Float[Array, "block 3 p p"], within: Int[Array, "2 block p"]) -> Float[Array, "block p p"]:
    (lit,) = jax.lax.optimization_barrier((lightness(luminance(cut)),))
    rows = jnp.take_along_axis(lit, within[0][:, :, None], 1)
    return jnp.take_along_axis(rows, within[1][:, None, :], 2)


def _put(
    result: Float[Array, "eye y x"], change: Float[Array, "block p p"], places: Int[Array, "block 3"]
) -> Float[Array, "eye y x"]:
    def one(k: int, result: Float[Array, "eye y x"]) -> Float[Array, "eye y x"]:
        return jax.lax.dynamic_update_slice(result, change[k][None], (places[k, 0], places[k, 1], places[k, 2]))

    return jax.lax.fori_loop(0, places.shape[0], one, result)
