"""Glare as the direct sum over the sphere: every pixel's light at the angle that it has from every other.

`L'(p) = Σ_s L(s)·Ω_s·K(angle(s, p), azimuth)`, float64, NumPy alone. Angles are those between pixels' directions, solid
angles those of pixels' four corners. Nothing is pooled, projected or convolved. A pixel's light is taken at its centre,
but for the pixels around one, where it is averaged over the pixel; what a pixel keeps is what all others do not get.

The azimuth of a function that is not alike all round is carried by parallel transport along great circles through the
view's axis.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from entoptic.pipeline.frame import View

Reals = NDArray[np.float64]

SPLIT_DEG = 9.0
"""Up to where a function may have colours and an azimuth. Engineering choice: beyond the widest halo and its lines."""
PARTS = {0: 9, 1: 9, 2: 7, 3: 5, 4: 3, 5: 3}
"""Along each side of a pixel so many pixels away: at how many places its light is taken. Beyond, at its middle."""
PAIRS_AT_ONCE = 20_000_000
TABLE = 1 << 18
"""Entries of the far function's table, even in the root of the sine of half the angle: 2e-6 of it apart at 9°."""
AROUND = 720
"""Directions in which a pixel's border is looked at."""


@dataclasses.dataclass(frozen=True)
class Function:
    """A point-spread function of unit volume."""

    near: Callable[[Reals, Reals], Reals]
    """Per steradian, up to SPLIT_DEG: of angles in degrees and azimuths in radians, (n,), to (o, i, n) or (1, 1, n)."""
    far: Callable[[Reals], Reals]
    """Beyond, alike for all colours: of angles, (n,), to (n,)."""
    beyond: Callable[[Reals], Reals]
    """How much of its light goes further than angles: (n,) to (o, i, n) or (1, 1, n)."""


def glare(light: ArrayLike, view: View, function: Function, at: NDArray[np.intp] | None = None) -> Reals:
    """What pixels show: (3, y, x), or (3, n) of the pixels `at` (n, 2), row and column."""
    values = np.asarray(light, np.float64)
    rows, columns = np.indices(values.shape[1:]).reshape(2, -1) if at is None else np.asarray(at).T
    result = _near(values, view, function, rows, columns)
    result += _far(values, view, function, rows, columns)
    stays = _stays(view, function, rows, columns)
    own = values[:, rows, columns]
    result += stays[0, 0] * own if len(stays) == 1 else np.einsum("oin,in->on", stays, own)
    return result.reshape(values.shape) if at is None else result


def from_pixel(view: View, function: Function, pixel: tuple[int, int], at: NDArray[np.intp]) -> Reals:
    """What other pixels `at` (n, 2) get of one pixel's light of luminance 1, (o, i, n) or (1, 1, n)."""
    row, column = at.T
    there = directions(view, row, column)
    source = np.full(len(at), pixel[0]), np.full(len(at), pixel[1])
    averaged, at_middle = (_density(view, function, *source, there, away_px) for away_px in (0, max(PARTS) + 1))
    deg = angle_deg(directions(view, *(np.array([place]) for place in pixel)), there)
    # Of a pixel at the split a part would be missing.
    density = np.where(deg < SPLIT_DEG - 2 / view.ppd_centre, averaged, at_middle)
    far = np.where(deg >= SPLIT_DEG, function.far(np.maximum(deg, SPLIT_DEG)), 0)
    alike = np.eye(len(density))[:, :, None]
    return np.asarray((np.where(deg < SPLIT_DEG, density, 0) + alike * far) * solid_angles(view)[pixel])


def solid_angles(view: View) -> Reals:
    """Of each pixel, in sr: the cone through a rectangle, by the angles at its four corners."""
    edges = [np.arange(size + 1) - size / 2 for size in (view.height_px, view.width_px)]
    v, u = np.meshgrid(*edges, indexing="ij")
    corner = np.arctan2(u * v, view.focal_px * np.sqrt(view.focal_px**2 + u * u + v * v))
    return np.asarray(np.diff(np.diff(corner, axis=0), axis=1))


def directions(view: View, row: ArrayLike, column: ArrayLike) -> Reals:
    """Unit vectors (3, …) of places in pixels, 0 in the middle of the first: right, down, ahead."""
    right = (np.asarray(column, np.float64) + 0.5 - view.width_px / 2) / view.focal_px
    down = (np.asarray(row, np.float64) + 0.5 - view.height_px / 2) / view.focal_px
    towards = np.stack(np.broadcast_arrays(right, down, 1.0))
    return np.asarray(towards / np.linalg.norm(towards, axis=0))


def angle_deg(one: Reals, other: Reals) -> Reals:
    """Between unit vectors (3, …), exact for small ones too."""
    return np.degrees(2 * np.arcsin(np.minimum(np.linalg.norm(one - other, axis=0) / 2, 1)))


def azimuth(to: Reals, source: Reals) -> Reals:
    """Of the great circle from a source to another direction, in radians from right to down, as it is at the axis.

    At the source it is the angle in the tangent plane whose axes have been carried there from the view's axis.
    """
    right, down = _carried(source)
    towards = to - source * (to * source).sum(axis=0)
    return np.arctan2((towards * down).sum(axis=0), (towards * right).sum(axis=0))


def _carried(at: Reals) -> tuple[Reals, Reals]:
    """The axis' right and down after parallel transport to directions along great circles."""
    x, y, z = at
    # A rotation about (axis × at) that takes the axis there takes its tangents along.
    share = 1 / (1 + z)
    return np.stack([1 - x * x * share, -x * y * share, -x]), np.stack([-x * y * share, 1 - y * y * share, -y])


def _near(light: Reals, view: View, function: Function, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Reals:
    """From pixels up to SPLIT_DEG away, displacement by displacement."""
    _, height, width = light.shape
    reach = _reach_px(view)
    here = directions(view, rows, columns)
    flux = light * solid_angles(view)
    result = np.zeros((3, len(rows)))
    down_reach, right_reach = min(reach, height - 1), min(reach, width - 1)
    for down in range(-down_reach, down_reach + 1):
        for right in range(-right_reach, right_reach + 1):
            if down == right == 0:
                continue
            row, column = rows + down, columns + right
            there = (row >= 0) & (row < height) & (column >= 0) & (column < width)
            there[there] &= flux[:, row[there], column[there]].any(axis=0)
            if not there.any():
                continue
            density = _density(view, function, row[there], column[there], here[:, there], max(abs(down), abs(right)))
            arrives = flux[:, row[there], column[there]]
            result[:, there] += (
                density[0, 0] * arrives if len(density) == 1 else np.einsum("oin,in->on", density, arrives)
            )
    return result


def _density(view: View, function: Function, row: Reals, column: Reals, to: Reals, away_px: int) -> Reals:
    """Of light from pixels to directions; 0 beyond SPLIT_DEG."""
    count = PARTS.get(away_px, 1)
    parts = (np.arange(count) + 0.5) / count - 0.5
    total: Reals | float = 0.0
    for y in parts:
        for x in parts:
            source = directions(view, row + y, column + x)
            deg = angle_deg(source, to)
            total = total + np.where(deg < SPLIT_DEG, function.near(deg, azimuth(to, source)), 0)
    return np.asarray(total) / len(parts) ** 2


def _reach_px(view: View) -> int:
    """Most pixels that SPLIT_DEG may cover anywhere in a view."""
    corner = math.atan(math.hypot(view.width_px, view.height_px) / 2 / view.focal_px)
    inner = max(corner - math.radians(SPLIT_DEG), -corner)
    return math.ceil(view.focal_px * max(math.tan(corner) - math.tan(inner), math.tan(math.radians(SPLIT_DEG)))) + 1


def _far(light: Reals, view: View, function: Function, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Reals:
    """From all pixels further away."""
    lit = light.any(axis=0)
    flux = (light * solid_angles(view))[:, lit]
    sources = directions(view, *np.nonzero(lit))
    here = directions(view, rows, columns)
    root = np.linspace(0, 1, TABLE + 1)
    deg = np.degrees(2 * np.arcsin(root * root))
    table = np.zeros(TABLE + 1)
    table[deg >= SPLIT_DEG] = function.far(deg[deg >= SPLIT_DEG])
    result = np.zeros((3, len(rows)))
    step = max(PAIRS_AT_ONCE // max(sources.shape[1], 1), 1)
    for start in range(0, len(rows), step):
        some = slice(start, start + step)
        sine = np.sqrt(np.maximum(0.5 - 0.5 * (here[:, some].T @ sources), 0))
        arrives = table[np.minimum(np.sqrt(sine) * TABLE + 0.5, TABLE).astype(np.int32)]
        result[:, some] = flux @ arrives.T
    return result


def _stays(view: View, function: Function, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Reals:
    """The light that a pixel keeps, (o, i, n): all but what goes further than its border in each direction."""
    centre = directions(view, rows, columns)
    turn = (np.arange(AROUND) + 0.5) / AROUND * 2 * math.pi
    largest = np.maximum(np.abs(np.cos(turn)), np.abs(np.sin(turn)))
    down, right = 0.5 * np.sin(turn) / largest, 0.5 * np.cos(turn) / largest
    border = directions(view, rows[:, None] + down, columns[:, None] + right)
    middle = centre[:, :, None]
    deg = angle_deg(border, middle)
    direction = azimuth(border, np.broadcast_to(middle, border.shape))
    wide = np.roll(direction, -1, axis=1) - np.roll(direction, 1, axis=1)
    wide = np.abs((wide + math.pi) % (2 * math.pi) - math.pi)
    leaves = function.beyond(deg.ravel())
    leaves = leaves.reshape(*leaves.shape[:2], *deg.shape)
    share = wide / wide.sum(axis=1, keepdims=True)
    return np.eye(len(leaves))[:, :, None] - (leaves * share).sum(axis=-1)
