"""Which pixels stand out so much that their near light is laid down pixel by pixel."""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare.plane import Plane
from entoptic.pipeline.effects.glare.spread import Apart
from entoptic.pipeline.effects.glare.stamps import REACHES_PX, reach_px
from entoptic.pipeline.measure import luminance


class Choice(NamedTuple):
    """What stands out."""

    times: float
    """How much brighter than the three by three cells around it a pixel is."""
    most: int
    """Pixels taken at most; where more stand out, those that do so most."""


@functools.partial(jax.jit, static_argnames=("plane", "choice"))
def standing_out(
    light: Float[Array, "3 y x"],
    cells: Float[Array, "3 row column"],
    beyond: Float[Array, "3 1 1"],
    plane: Plane,
    choice: Choice,
) -> Apart:
    """Of a frame's pixels, with what they have more than there is beyond its edges, as its cells are given."""
    pool = plane.pool
    around = _mean_around(luminance(cells + beyond))
    peaks = luminance(_maxima(light, pool) + beyond)
    ratio = jnp.where(around > 0, peaks / jnp.where(around > 0, around, 1), 0)
    ratio = jnp.where(_within(plane), ratio, 0)
    cell = _most(ratio, choice.times, choice.most // 2 if pool > 1 else choice.most)
    row, column = cell // ratio.shape[1], cell % ratio.shape[1]
    # A cell that is none lies below the frame.
    offset = jnp.arange(pool)
    both = len(cell), pool, pool
    y = jnp.broadcast_to((row[:, None] * pool + offset)[:, :, None], both).ravel()
    x = jnp.broadcast_to((column[:, None] * pool + offset)[:, None, :], both).ravel()
    more = light.at[:, y, x].get(mode="fill", fill_value=0)
    level = around.at[jnp.repeat(row, pool * pool), jnp.repeat(column, pool * pool)].get(mode="fill", fill_value=0)
    own = luminance(more[:, None] + beyond)[0]
    chosen = _most(jnp.where(level > 0, own / jnp.where(level > 0, level, 1), 0), choice.times, choice.most)
    y, x = (place.at[chosen].get(mode="fill", fill_value=0) for place in (y, x))
    return Apart(y, x, more.at[:, chosen].get(mode="fill", fill_value=0))


def _most(ratio: Array, times: float, most: int) -> Int[Array, "n"]:
    """Where ratios are largest, of those above a limit; in place of those that are not, one past the last."""
    value, place = jax.lax.top_k(ratio.ravel(), min(most, ratio.size))
    return jnp.where(value > times, place, ratio.size)


def _within(plane: Plane) -> NDArray[np.bool_]:
    """Cells whose near light reaches no further than windows do."""
    rows, columns = (np.arange(size) * plane.pool + plane.pool / 2 for size in plane.tables.corner.shape)
    return np.asarray(reach_px(plane, rows[:, None], columns[None]) <= REACHES_PX[-1] - plane.pool * 4)


def _mean_around(cells: Float[Array, "row column"]) -> Float[Array, "row column"]:
    edged = jnp.pad(cells, 1, mode="edge")
    rows = edged[:-2] + edged[1:-1] + edged[2:]
    return (rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]) / 9


def _maxima(light: Float[Array, "3 y x"], pool: int) -> Float[Array, "3 row column"]:
    """Of each channel in each cell."""
    rows = light.reshape(3, -1, pool, light.shape[2])
    tall = jax.lax.optimization_barrier(functools.reduce(jnp.maximum, [rows[:, :, k] for k in range(pool)]))
    return functools.reduce(jnp.maximum, [tall[:, :, k::pool] for k in range(pool)])
