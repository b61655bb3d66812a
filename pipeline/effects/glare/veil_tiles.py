"""Low resolution for the veil: a grid of smooth tiles over a view, and what an analytic function carries between them.

**Tiles** are cubic B-splines, so light that moves from one tile to the next moves smoothly, and what arrives is read
off as smoothly. A pinhole view spreads its edges, so tiles lie evenly not in pixels but in s = asinh(u), u the tangent
of the angle: a step of s along an axis is an angle of at most s, anywhere, and nearly that in most of a view.

**Blocks** make that cheap. Within a block of pixels the light is gathered at POINTS points with the weights of cubic
interpolation; a few hundred points along a side then go to the tiles by a small matrix. Light times any function that
is smooth over a block keeps its sum: so solid angles and tiles are evaluated at the points alone.

**Halves.** A view is mirrored in both its middles, so tiles are kept as sums and differences of mirrored ones, which do
not mix: four matrices of a sixteenth of the size each in place of one.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare.kernel import Veil
from entoptic.pipeline.frame import View
from entoptic.pipeline.optics import radial

TILES = 88
"""Along the longer side at most: 1.5° in the middle of a view of 104°. Engineering choice: the matrices of a square
view are 60 MB, and a veil that rises between 4.5° and 9° is within 2.5 % of the whole function at every angle."""
FINEST_DEG = 0.8
"""Least side of a tile. Engineering choice: with it the veil is within 0.6 % of the whole function."""
BLOCK_DEG, POINTS = 1.5, 4
"""A block's side in the view's middle, about, and points along it. Engineering choice: gathered in such blocks, light
reaches the tiles nearly as accurately as pixel by pixel."""
SUPPORT = 6
"""Tiles to each side that a B-spline's coefficient depends on. Its weights fall by 2 − √3 a tile, to 4e-4 here."""
TABLE = 1 << 16
"""Entries of the function's table, even in the sine of half the angle: 0.0018° apart, 1e-4 of a function."""
ROWS_AT_ONCE = 256
"""Of a matrix under construction: its working memory is some 20 MB."""

Reals = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class Axis:
    """Tiles along one side of a view."""

    pixels: int
    block_px: int
    blocks: int
    """Blocks that cover the pixels; the last may reach beyond them."""
    weights: NDArray[np.float32]
    """(point, pixel): how a block's pixels are gathered at its points, and read off from them."""
    tangents: Reals
    """Of all points, block by block, in focal lengths from the view's middle."""
    tiles: Reals
    """(point, parity, tile): the even and the odd sums of mirrored tiles."""
    nodes: Reals
    """Tangents of the tiles of one half and of SUPPORT more beyond, from the middle outwards."""
    middle: bool
    """Whether one lies in the middle, its own mirror image."""
    coefficients: Reals
    """(parity, tile, node): B-spline coefficients from sums and differences of values at mirrored nodes."""


@functools.lru_cache(maxsize=16)
def axes(view: View) -> tuple[Axis, Axis]:
    """The tiles along a view's height and its width."""
    reach = 2 * math.asinh(max(view.height_px, view.width_px) / 2 / view.focal_px)
    step = max(reach / (TILES - 3), math.radians(FINEST_DEG))
    return _axis(view.height_px, view.focal_px, step), _axis(view.width_px, view.focal_px, step)


def _axis(pixels: int, focal_px: float, step: float) -> Axis:
    block_px = _block_px(pixels, math.radians(BLOCK_DEG) * focal_px)
    blocks = -(-pixels // block_px)
    weights, within = _gathering(block_px)
    tangents = ((np.arange(blocks) * block_px)[:, None] + within + 0.5 - pixels / 2).ravel() / focal_px
    # Few large pixels have a tile each; one more lies beyond each end.
    by_pixel = pixels + 2 <= TILES and math.degrees(1 / focal_px) >= FINEST_DEG
    place = tangents if by_pixel else np.arcsinh(tangents)
    span = 2 * float(np.abs(place).max())
    tiles = pixels + 2 if by_pixel else math.ceil(span / step) + 3
    spacing = span / (tiles - 3) if tiles > 3 else 1 / focal_px
    values = _b_spline(place[:, None] / spacing - _centred(tiles))
    nodes = _centred(tiles + 2 * SUPPORT)[(tiles + 2 * SUPPORT) // 2 :] * spacing
    halves, node_halves = _halves(tiles), _halves(tiles + 2 * SUPPORT)
    return Axis(
        pixels=pixels,
        block_px=block_px,
        blocks=blocks,
        weights=weights.astype(np.float32),
        tangents=tangents,
        tiles=np.einsum("ut,pht->uph", values, halves),
        nodes=nodes if by_pixel else np.sinh(nodes),
        middle=tiles % 2 == 1,
        coefficients=halves @ _coefficients(tiles) @ node_halves.transpose(0, 2, 1),
    )


def _centred(count: int) -> Reals:
    return np.asarray(np.arange(count) - (count - 1) / 2, np.float64)


def _halves(count: int) -> Reals:
    """(parity, one of a half, one of all): sums and differences of mirrored ones, of unit length.

    From the middle outwards; if one lies in the middle, it is an even one by itself, and its odd one is none.
    """
    result = np.zeros((2, (count + 1) // 2, count))
    for index in range((count + 1) // 2):
        right, left = count // 2 + index, (count - 1) // 2 - index
        if right == left:
            result[0, index, right] = 1
        else:
            result[:, index, right] = math.sqrt(0.5)
            result[:, index, left] = math.sqrt(0.5), -math.sqrt(0.5)
    return result


def _block_px(pixels: int, about: float) -> int:
    """Side of a block: one that leaves no rest if there is one of about the right size."""
    if about <= POINTS:
        return 1
    fitting = [side for side in range(math.ceil(about * 0.8), int(about * 1.4) + 1) if pixels % side == 0]
    return min(fitting, key=lambda side: abs(side - about)) if fitting else round(about)


def _gathering(block_px: int) -> tuple[Reals, Reals]:
    """Weights of cubic interpolation at each pixel of a block, and the points' places, in pixels from the first."""
    if block_px <= POINTS:
        return np.eye(block_px), np.arange(block_px, dtype=np.float64)
    # Chebyshev's points: no other four keep the interpolation's error as small.
    places = (block_px - 1) / 2 * (1 - np.cos((np.arange(POINTS) + 0.5) * math.pi / POINTS))
    pixels = np.arange(block_px)
    weights = np.ones((POINTS, block_px))
    for k in range(POINTS):
        for other in range(POINTS):
            if other != k:
                weights[k] *= (pixels - places[other]) / (places[k] - places[other])
    return weights, places


def _b_spline(distance: Reals) -> Reals:
    """Cubic B-spline at a distance in tiles; all of them add up to 1 everywhere."""
    t = np.abs(distance)
    return np.where(t < 1, 2 / 3 - t * t + t**3 / 2, np.where(t < 2, np.maximum(2 - t, 0) ** 3 / 6, 0))


def _coefficients(tiles: int) -> Reals:
    """B-spline coefficients of tiles from a function's values at as many nodes and SUPPORT more at each end.

    The coefficient of a tile is Σ √3·(√3 − 2)^|j| times the value j nodes away (Unser 1993).
    """
    taps = (math.sqrt(3) - 2) ** np.abs(np.arange(-SUPPORT, SUPPORT + 1))
    taps /= taps.sum()
    matrix = np.zeros((tiles, tiles + 2 * SUPPORT))
    for tile in range(tiles):
        matrix[tile, tile : tile + len(taps)] = taps
    return matrix


def solid_angles(view: View) -> Reals:
    """Solid angle in sr of a pixel at each point, exactly."""
    rows, columns = axes(view)
    half = 0.5 / view.focal_px

    def corner(v: Reals, u: Reals) -> Reals:
        """Of the rectangle between the view's middle and a point of it."""
        return np.arctan(u * v / np.sqrt(1 + u * u + v * v))

    v, u = rows.tangents[:, None], columns.tangents[None, :]
    return np.asarray(
        corner(v + half, u + half)
        - corner(v - half, u + half)
        - corner(v + half, u - half)
        + corner(v - half, u - half)
    )


def carried(view: View, veil: Veil) -> NDArray[np.float32]:
    """What a veil of unit volume carries from tile to tile, per steradian: (parity, tile, tile).

    Parities are rows' and columns' even-even, even-odd, odd-even, odd-odd; tiles go row by row. Takes about a second.
    """
    rows, columns = axes(view)
    table = _tabulated(veil)
    directions = _directions(rows.nodes, columns.nodes)
    once = np.outer(*(_once(axis) for axis in (rows, columns))).ravel().astype(np.float32)
    count = len(once)
    classes = np.empty((4, count, count), np.float32)
    for start in range(0, count, ROWS_AT_ONCE):
        some = slice(start, start + ROWS_AT_ONCE)
        across, along, ahead = (np.outer(part[some], part) for part in directions)
        same, mirrored_x, mirrored_y, both = (
            _looked_up(table, ahead + sign_x * across + sign_y * along) for sign_y in (1, -1) for sign_x in (1, -1)
        )
        weights = np.outer(once[some], once)
        classes[0, some] = same + mirrored_x + mirrored_y + both
        classes[1, some] = same - mirrored_x + mirrored_y - both
        classes[2, some] = same + mirrored_x - mirrored_y - both
        classes[3, some] = same - mirrored_x - mirrored_y + both
        classes[:, some] *= weights
    matrices = np.stack([_to_tiles(classes[k], rows, columns, k // 2, k % 2) for k in range(4)])
    # A uniform frame gets no more than the veil's volume anywhere, and so no light, wherever it is, gives more.
    most = _uniform(view, matrices).max()
    volume = radial.hemisphere_volume(veil.density)
    return np.asarray(matrices / max(volume, most), np.float32)


def _once(axis: Axis) -> Reals:
    """Weights by which a node in the middle, which is its own mirror image, counts once."""
    weights = np.ones(len(axis.nodes))
    if axis.middle:
        weights[0] = math.sqrt(0.5)
    return weights


def _directions(v: Reals, u: Reals) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Unit vectors of a grid of tangents: right, down, ahead."""
    ahead = 1 / np.sqrt(1 + v[:, None] ** 2 + u[None, :] ** 2)
    parts = (ahead * u[None, :], ahead * v[:, None], ahead)
    return tuple(part.ravel().astype(np.float32) for part in parts)  # type: ignore[return-value]


def _tabulated(veil: Veil) -> NDArray[np.float32]:
    """A veil's density, even in the sine of half the angle, 0 beyond 90°."""
    deg = 2 * np.degrees(np.arcsin(np.linspace(0, 1, TABLE + 1)))
    density = np.zeros(TABLE + 1)
    inside = (deg > 0) & (deg <= radial.EDGE_DEG)
    density[inside] = veil.density(deg[inside])
    return density.astype(np.float32)


def _looked_up(table: NDArray[np.float32], cosine: NDArray[np.float32]) -> NDArray[np.float32]:
    sine = np.sqrt(np.maximum(0.5 - 0.5 * cosine, 0))
    return table[np.minimum(sine * np.float32(TABLE) + np.float32(0.5), np.float32(TABLE)).astype(np.int32)]


def _to_tiles(
    values: NDArray[np.float32], rows: Axis, columns: Axis, parity_y: int, parity_x: int
) -> NDArray[np.float32]:
    """B-spline coefficients of a symmetric function of two nodes, in both."""
    y, x = rows.coefficients[parity_y], columns.coefficients[parity_x]
    by_row = scipy.sparse.kron(y, scipy.sparse.eye_array(x.shape[1]), "csr").astype(np.float32)
    by_column = scipy.sparse.kron(scipy.sparse.eye_array(len(y)), x, "csr").astype(np.float32)

    def one_side(matrix: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(by_column @ (by_row @ matrix))

    return one_side(np.ascontiguousarray(one_side(values).T))


def _uniform(view: View, matrices: NDArray[np.float32]) -> Reals:
    """What each point gets from a uniform frame; it is even in both directions."""
    rows, columns = axes(view)
    light = solid_angles(view) * np.outer(*(_pixels_at_points(axis) for axis in (rows, columns)))
    even_y, even_x = rows.tiles[:, 0], columns.tiles[:, 0]
    tiles = matrices[0] @ (even_y.T @ light @ even_x).ravel()
    return np.asarray(even_y @ tiles.reshape(even_y.shape[1], -1) @ even_x.T)


def _pixels_at_points(axis: Axis) -> Reals:
    """How many pixels are gathered at each point; none from beyond the frame's end."""
    there = (np.arange(axis.blocks * axis.block_px) < axis.pixels).reshape(axis.blocks, axis.block_px)
    return np.asarray(there.astype(np.float64) @ axis.weights.T.astype(np.float64)).ravel()
