"""Light that a scene knows beyond the view's edges: a panorama's lamp veils what is looked at beside it.

Each piece of it is soft by its own size, so that nothing switches on as a piece crosses the edge. What it brings is
smooth in the view: worked out at the corners of tiles, of small pieces close to the edge at more places, and straight
between them.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare.kernel import Mixture, Part
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, Surroundings, View
from entoptic.pipeline.optics import radial
from entoptic.pipeline.ranges import Change

Reals = NDArray[np.float64]

LEAST_RAD, ENTRIES = np.radians(0.1), 512
"""Of the table of glare, even in the logarithm of the angle's chord; nearer it is flat."""
PER_DEG, REACH = 12.0, 108
"""Samples of a function's coloured part, and how many to each side."""
CLOSE_RAD, SMALL_RAD = np.radians(4.0), np.radians(1.5)
"""Pieces nearer to the view's edge, and smaller, are looked up in places FINER times as dense. Engineering choice."""
FINER = 8
AT_ONCE = {False: 256, True: 8}
"""Pieces of either kind come in so many, so that few numbers of them are compiled."""


class Lattice(NamedTuple):
    """Light at places a step apart, from the frame's first edges to its last."""

    cd_m2: Float[np.ndarray, "3 row column"]
    step_px: float


@dataclasses.dataclass(frozen=True, eq=False)
class Around:
    """What surroundings bring to a view."""

    lattices: tuple[Lattice, ...]
    """Their sum is what they bring."""
    most: Change
    """In each tile, of red, green, blue and luminance."""


def around(
    mixture: Mixture, surroundings: Surroundings, view: View, beyond_cd_m2: tuple[float, ...], tile_px: int
) -> Around:
    """What surroundings bring to a view more than light of `beyond_cd_m2` all over would; tiles as measured."""
    weighed = tuple((part, round(weight, 3)) for part, weight in mixture)
    return _around(weighed, surroundings, view, beyond_cd_m2, tile_px)


@functools.lru_cache(maxsize=4)
def _around(
    mixture: Mixture, surroundings: Surroundings, view: View, beyond_cd_m2: tuple[float, ...], tile_px: int
) -> Around:
    table = sum(np.float32(weight) * part.kept("around", functools.partial(_table, part)) for part, weight in mixture)
    more_lx = surroundings.rgb_lx - surroundings.steradians[:, None] * np.asarray(beyond_cd_m2, np.float32)
    soft = surroundings.steradians / np.float32(np.pi)
    is_close = (surroundings.outside_rad(view) < CLOSE_RAD) & (soft < SMALL_RAD**2)
    size = view.height_px, view.width_px
    middles = _directions(view, *(_places(length, tile_px)[:-1] + tile_px / 2 for length in size))
    half = np.float32(tile_px / view.focal_px / np.sqrt(2))
    lattices, tiles = [], [len(_places(length, tile_px)) - 1 for length in size]
    most = np.zeros((3, *tiles))
    for close in (False, True):
        mine = np.flatnonzero(is_close == close)
        if not len(mine):
            continue
        pieces = [_padded(of[mine], AT_ONCE[close]) for of in (surroundings.towards, more_lx, soft)]
        step_px = tile_px / (FINER if close else 1)
        places = [_places(length, step_px) for length in size]
        lattice = np.asarray(_arriving(_directions(view, *places), *pieces, table, np.float32(0)))
        lattice = lattice.reshape(3, *map(len, places))
        lattices.append(Lattice(lattice, step_px))
        if close:
            high = np.asarray(_arriving(middles, pieces[0], np.abs(pieces[1]), pieces[2], table, half))
            most += high.reshape(most.shape)
        else:
            most += _largest_at_corners(np.abs(lattice))
    with_luminance = np.concatenate([most, np.tensordot(LUMINANCE_WEIGHTS, most, 1)[None]]).astype(np.float64)
    return Around(tuple(lattices), with_luminance)


def at_cells(around: Around, view: View, pool: int) -> Float[Array, "3 row column"]:
    """What it brings to each of a frame's cells, cd/m²."""
    parts = [
        _interpolated(
            lattice.cd_m2,
            *(
                _interpolation(length, pool, lattice.step_px).astype(np.float32)
                for length in (view.height_px, view.width_px)
            ),
        )
        for lattice in around.lattices
    ]
    return functools.reduce(jnp.add, parts)


def _largest_at_corners(lattice: Float[np.ndarray, "3 row column"]) -> Float[np.ndarray, "3 r c"]:
    for axis in (1, 2):
        lattice = np.maximum(np.delete(lattice, 0, axis), np.delete(lattice, -1, axis))
    return lattice


def _places(length: int, step_px: float) -> Reals:
    """From one edge at every step up to the other or beyond."""
    return np.arange(-(-length // step_px) + 1) * step_px


@functools.lru_cache(maxsize=8)
def _interpolation(length: int, pool: int, step_px: float) -> Reals:
    """Weights (cell, place)."""
    places = _places(length, step_px)
    cells = (np.arange(-(-length // pool)) + 0.5) * pool
    return np.stack([np.interp(cells, places, unit) for unit in np.eye(len(places))], axis=1)


@jax.jit
def _interpolated(
    lattice: Float[Array, "3 r c"], rows: Float[Array, "row r"], columns: Float[Array, "column c"]
) -> Float[Array, "3 row column"]:
    return jnp.einsum("yr,orc,xc->oyx", rows, lattice, columns)


def _directions(view: View, rows: NDArray[np.floating], columns: NDArray[np.floating]) -> NDArray[np.float32]:
    """Unit vectors (3, n) of places in pixels from the upper left corner: right, down, ahead."""
    down, right = np.meshgrid(
        (rows - view.height_px / 2) / view.focal_px, (columns - view.width_px / 2) / view.focal_px, indexing="ij"
    )
    both = np.stack([right, down, np.ones_like(down)]).reshape(3, -1)
    return np.asarray(both / np.linalg.norm(both, axis=0), np.float32)


def _padded(values: NDArray[np.float32], multiple: int) -> NDArray[np.float32]:
    rest = -len(values) % multiple
    return np.pad(values, ((0, rest), *[(0, 0)] * (values.ndim - 1)))


@jax.jit
def _arriving(
    at: Float[Array, "3 p"],
    towards: Float[Array, "n 3"],
    rgb_lx: Float[Array, "n 3"],
    soft: Float[Array, "n"],
    table: Float[Array, "3 entry"],
    nearer_rad: Float[Array, ""],
) -> Float[Array, "3 p"]:
    """Glare of pieces at directions that may lie nearer to them by so much."""
    chord = jnp.maximum(2 - 2 * (towards @ at), 0)
    chord = jnp.where(nearer_rad > 0, jnp.maximum(jnp.sqrt(chord) - nearer_rad, 0) ** 2, chord) + soft[:, None]
    first = np.float32(2 * np.log2(LEAST_RAD))
    place = jnp.clip((jnp.log2(chord) - first) * np.float32((ENTRIES - 1) / (1 - first)), 0, ENTRIES - 1)
    below = jnp.minimum(place.astype(jnp.int32), ENTRIES - 2)
    beyond = place - below
    return jnp.stack(
        [
            ((of[below] * (1 - beyond) + of[below + 1] * beyond) * rgb_lx[:, k, None]).sum(axis=0)
            for k, of in enumerate(table)
        ]
    )


def _table(part: Part) -> Float[np.ndarray, "3 entry"]:
    """Density of grey light at angles, on average around: to red, green and blue."""
    chord = np.sqrt(2.0) * np.exp2(np.linspace(2 * np.log2(LEAST_RAD / np.sqrt(2)), 0, ENTRIES) / 2)
    deg = np.degrees(2 * np.arcsin(np.minimum(chord / 2, 1)))
    cells = part.cells(PER_DEG, REACH, 1.0).sum(axis=1) / np.radians(1 / PER_DEG) ** 2
    offset = np.arange(-REACH, REACH + 1) / PER_DEG
    away = np.hypot(offset[:, None], offset).ravel()
    ring = np.rint(away * PER_DEG * 2).astype(int)
    count = np.bincount(ring)
    filled = count > 0
    at = np.bincount(ring, away)[filled] / count[filled]
    means = [np.interp(deg, at, np.bincount(ring, of.ravel())[filled] / count[filled], right=0.0) for of in cells]
    density = np.stack(means) if len(means) == 3 else np.repeat(means, 3, axis=0)
    if part.veil is not None:
        density = density + part.veil.density(deg, 1.0)
    return np.where(deg < radial.EDGE_DEG, density, 0).astype(np.float32)
