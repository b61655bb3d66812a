"""Glare as the direct sum over the sphere in float64: what every other way of computing it is compared to.

What arrives at a pixel is Σ L(s)·∫K over the solid angle of s, the angle always the true one between two directions. A
pixel is the middle of its target and the whole of its source: near ones are integrated over the source's area, in its
own pixel in polar coordinates around its middle. NumPy alone, nothing of what it judges.

An angle's kernel is read from a table that is even in the sine of half the angle. A kernel with an azimuth and
colours, as wave optics makes, is called for each pair: its azimuth is carried from the origin (the gaze or the view's
axis) to the source by parallel transport along a great circle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from entoptic.pipeline.frame import View
from entoptic.pipeline.oracles.point_spread import Density, per_panel, radial_edges

Reals = NDArray[np.float64]
Indices = NDArray[np.intp]
Positions = NDArray[np.integer[Any]] | NDArray[np.floating[Any]]
Directed = Callable[[Reals, Reals], Reals]
"""Of angles in degrees and azimuths in radians, from columns to rows, around the light: (out 3, in 3, …) in sr⁻¹."""

RINGS = ((2, 12), (6, 4), (20, 2))
"""Up to so many pixels away (along rows or columns), a source is integrated by so many nodes a side. Engineering
choice: CIE's light from each source within 1e-3 of its own."""
FEW = 64
"""So few sources are integrated by 2 nodes a side at every distance. Engineering choice: in 4 s at 1440×1600 each."""
TABLE = 1 << 20
"""Entries. Engineering choice: with steps of 1.1e-4°, lines between them are within 1e-5 from 0.05° on."""
PAIRS_AT_ONCE = 1 << 17
"""Their working memory, 1 MB an array, stays in the cache."""
GAUSS = {count: np.polynomial.legendre.leggauss(count) for count in range(1, 33)}


def glare(light: ArrayLike, view: View, density: Density, at: Indices | None = None) -> Reals:
    """The perceived light of a frame (3, y, x), everywhere or at `at`, n rows and columns: (3, y, x) or (3, n)."""
    values = np.asarray(light, np.float64)
    rows, columns = _places(view, at)
    stays = values[:, rows, columns] * own_share(view, density, np.stack([rows, columns], 1))
    return arrives(values, view, density, at) + (stays if at is not None else stays.reshape(values.shape))


def arrives(light: ArrayLike, view: View, density: Density, at: Indices | None = None) -> Reals:
    """What comes to each pixel from all others."""
    values = np.asarray(light, np.float64)
    table = _table(density, 1.0)
    near = _table(density, math.sin(_widest(view, RINGS[-1][0]) / 2))
    rows, columns = _places(view, at)
    lit = np.argwhere(values.any(axis=0))
    lamps, towards = values[:, lit[:, 0], lit[:, 1]], _directions(view, rows, columns)
    where, weights = _nodes(view, lit, 2 if len(lit) <= FEW else 1)
    from_nodes, fluxes = where.reshape(-1, 3), (lamps[:, None] * weights).reshape(3, -1)
    result = np.zeros((3, len(rows)))
    for some, of_nodes in _chunks(len(rows), len(from_nodes)):
        result[:, some] += fluxes[:, of_nodes] @ table(towards[some], from_nodes[of_nodes], "pc,sc->sp")
    for row, column, targets, sources, count in _near_pairs(view, rows, columns, lit):
        for part in np.array_split(np.arange(len(targets)), max(1, len(targets) * count**2 // PAIRS_AT_ONCE)):
            here, there = towards[targets[part]], sources[part]
            inside = -np.sum(table(here, where[:, there], "pc,npc->np") * weights[:, there], axis=0)
            if row or column:
                finer, of_finer = _nodes(view, lit[there], count)
                inside += np.sum(near(here, finer, "pc,npc->np") * of_finer, axis=0)
            result[:, targets[part]] += lamps[:, there] * inside
    return result if at is not None else result.reshape(values.shape)


def arrives_directed(
    light: ArrayLike,
    view: View,
    density: Directed,
    at: Indices | None = None,
    origin_deg: tuple[float, float] = (0.0, 0.0),
    nodes: int = 8,
) -> Reals:
    """What comes to each pixel from all others by a kernel with azimuth and colours.

    Each source is cut into `nodes` equal parts a side: where the kernel is finer, give its average over such a part.
    """
    values = np.asarray(light, np.float64)
    rows, columns = _places(view, at)
    lit = np.argwhere(values.any(axis=0))
    towards = _directions(view, rows, columns)
    result = np.zeros((3, len(rows)))
    for place in lit:
        others = np.flatnonzero((rows != place[0]) | (columns != place[1]))
        lamp = values[:, place[0], place[1]]
        where, weights = _parts(view, place[None], nodes)
        for part in np.array_split(others, max(1, len(others) * nodes**2 // PAIRS_AT_ONCE)):
            angle, turn = angle_and_azimuth(where, towards[part], origin_deg)
            shares = np.einsum("oinp,nq->oip", density(angle, turn), weights)
            result[:, part] += np.einsum("oip,i->op", shares, lamp)
    return result if at is not None else result.reshape(values.shape)


def own_share(view: View, density: Density, at: Indices | None = None) -> Reals:
    """The share of its light that stays in a pixel: what lies inside, in polar coordinates around its middle."""
    rows, columns = _places(view, at)
    middle = _directions(view, rows, columns)
    # An edge is a part of a great circle: at an azimuth ψ from its nearest point, δ away, tan θ = tan δ / cos ψ.
    edges = np.radians(radial_edges())
    within = np.log(np.cumsum(per_panel(density)) / (2 * math.pi))
    corners = [
        _directions(view, rows + v, columns + u) for v, u in ((-0.5, -0.5), (-0.5, 0.5), (0.5, 0.5), (0.5, -0.5))
    ]
    total = np.zeros(len(rows))
    for first, second in zip(corners, corners[1:] + corners[:1], strict=True):
        normal = np.cross(first, second)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        distance = np.abs(np.arcsin(np.einsum("pc,pc->p", normal, middle)))
        foot = normal - middle * np.einsum("pc,pc->p", normal, middle)[:, None]
        side = np.cross(middle, foot)
        start, end = (np.arctan2(_dot(c, side), _dot(c, foot)) for c in (first, second))
        # `normal` points away from the foot or to it, by the corners' order: half a turn either way.
        start, end = (np.mod(angle + math.pi / 2, math.pi) - math.pi / 2 for angle in (start, end))
        half = (end - start) / 2
        psi = (end + start)[:, None] / 2 + half[:, None] * GAUSS[12][0]
        reach = np.arctan(np.tan(distance)[:, None] / np.cos(psi))
        inside = np.exp(np.interp(np.log(reach), np.log(edges[1:]), within))
        total += np.abs(half) * (inside @ GAUSS[12][1])
    return total


def solid_angles(view: View) -> Reals:
    """Of each pixel in sr, (y, x): a pyramid's, by its four corners."""
    v = (np.arange(view.height_px + 1) - view.height_px / 2)[:, None] / view.focal_px
    u = (np.arange(view.width_px + 1) - view.width_px / 2)[None, :] / view.focal_px
    corner = np.arctan(u * v / np.sqrt(1 + u * u + v * v))
    return np.asarray(corner[1:, 1:] - corner[:-1, 1:] - corner[1:, :-1] + corner[:-1, :-1])


def directions(view: View) -> Reals:
    """Unit vectors of the pixels' middles, (y, x, 3): along the columns, down the rows, ahead."""
    rows, columns = _places(view, None)
    return _directions(view, rows, columns).reshape(view.height_px, view.width_px, 3)


def angle_and_azimuth(
    sources: Reals, towards: Reals, origin_deg: tuple[float, float] = (0.0, 0.0)
) -> tuple[Reals, Reals]:
    """Of each of `towards` (p, 3) as seen from each of `sources` (n, 1, 3), in degrees and radians: (n, p)."""
    right, down = frame_at(sources, origin_deg)
    sine = np.linalg.norm(towards - sources, axis=-1) / 2
    angle = np.degrees(2 * np.arcsin(np.minimum(sine, 1)))
    return angle, np.arctan2(np.sum(towards * down, axis=-1), np.sum(towards * right, axis=-1))


def frame_at(places: Reals, origin_deg: tuple[float, float]) -> tuple[Reals, Reals]:
    """The view's right and down, carried from its axis to the origin and from there to each place (…, 3)."""
    azimuth, elevation = map(math.radians, origin_deg)
    origin = np.array(
        [math.sin(azimuth) * math.cos(elevation), -math.sin(elevation), math.cos(azimuth) * math.cos(elevation)]
    )
    at_origin = [transported(np.array(axis), np.array([0.0, 0.0, 1.0]), origin) for axis in ((1.0, 0, 0), (0, 1.0, 0))]
    right, down = (transported(axis, origin, places) for axis in at_origin)
    return right, down


def transported(tangent: Reals, start: Reals, end: Reals) -> Reals:
    """A vector tangent to the sphere at `start`, moved to `end` (…, 3) along the great circle between them."""
    along = end @ tangent / (1 + end @ start)
    return np.asarray(tangent - along[..., None] * (start + end))


def _table(density: Density, last: float) -> Callable[[Reals, Reals, str], Reals]:
    """The density between directions by the sine of half the angle, up to `last`.

    0 in the first entries, a light's own direction. Directions are multiplied as an einsum says.
    """
    sines = np.minimum(np.linspace(0, last, TABLE + 2), 1)
    values = density(np.degrees(2 * np.arcsin(sines)))
    values[:2] = 0
    steps = np.append(np.diff(values), 0)
    scale = 0.5 * (TABLE / last) ** 2

    def read(a: Reals, b: Reals, product: str) -> Reals:
        place = (b * -scale) @ a.T if product == "pc,sc->sp" else np.einsum(product, a, b * -scale)
        place += scale
        np.maximum(place, 0, out=place)
        np.sqrt(place, out=place)
        index = place.astype(np.int32)
        place -= index
        place *= steps.take(index, mode="clip")
        place += values.take(index, mode="clip")
        return np.asarray(place)

    return read


def _places(view: View, at: Indices | None) -> tuple[Indices, Indices]:
    if at is None:
        rows, columns = np.indices((view.height_px, view.width_px))
        return rows.ravel(), columns.ravel()
    return np.asarray(at)[:, 0], np.asarray(at)[:, 1]


def _directions(view: View, rows: Positions, columns: Positions) -> Reals:
    v = (rows + 0.5 - view.height_px / 2) / view.focal_px
    u = (columns + 0.5 - view.width_px / 2) / view.focal_px
    ahead = 1 / np.sqrt(1 + u * u + v * v)
    return np.stack([u * ahead, v * ahead, ahead], axis=-1)


def _nodes(view: View, places: Indices, count: int) -> tuple[Reals, Reals]:
    """Directions within pixels and what solid angle each stands for: (count², p, 3) and (count², p)."""
    points, weights = GAUSS[count]
    return _within(view, places, points / 2, weights / 2)


def _parts(view: View, places: Indices, count: int) -> tuple[Reals, Reals]:
    """The same in equal steps."""
    return _within(view, places, (np.arange(count) + 0.5) / count - 0.5, np.full(count, 1 / count))


def _within(view: View, places: Indices, points: Reals, weights: Reals) -> tuple[Reals, Reals]:
    v, u = (axis.ravel()[:, None] for axis in np.meshgrid(points, points, indexing="ij"))
    where = _directions(view, places[:, 0] + v, places[:, 1] + u)
    return where, np.outer(weights, weights).reshape(-1, 1) * where[..., 2] ** 3 / view.focal_px**2


def _dot(a: Reals, b: Reals) -> Reals:
    return np.asarray(np.einsum("...c,...c->...", a, b))


def _widest(view: View, pixels: int) -> float:
    """An angle in rad that so many pixels along rows and columns at once do not reach beyond."""
    return min(math.pi / 2, (pixels + 1) * 1.5 / view.focal_px)


def _chunks(targets: int, sources: int) -> Iterator[tuple[slice, slice]]:
    across = max(1, min(sources, 4096))
    down = max(1, PAIRS_AT_ONCE // across)
    for first in range(0, sources, across):
        for start in range(0, targets, down):
            yield slice(start, start + down), slice(first, first + across)


def _near_pairs(
    view: View, rows: Indices, columns: Indices, lit: Indices
) -> Iterator[tuple[int, int, Indices, Indices, int]]:
    """By their distance in pixels: pairs of a target and a source that is integrated, and by how many nodes."""
    few, many = (lit, np.stack([rows, columns], 1)) if len(lit) < len(rows) else (np.stack([rows, columns], 1), lit)
    reach = RINGS[-1][0]
    where = np.full((view.height_px + 2 * reach, view.width_px + 2 * reach), -1, np.intp)
    where[many[:, 0] + reach, many[:, 1] + reach] = np.arange(len(many))
    for row in range(-reach, reach + 1):
        for column in range(-reach, reach + 1):
            found = where[few[:, 0] + row + reach, few[:, 1] + column + reach]
            one = np.flatnonzero(found >= 0)
            other = found[one]
            targets, sources = (other, one) if few is lit else (one, other)
            count = next(count for ring, count in RINGS if max(abs(row), abs(column)) <= ring)
            if len(one):
                yield row, column, targets, sources, count
