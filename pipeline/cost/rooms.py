"""Two rooms by closed formulas: a white one evenly lit, and one with a single candle.

Both are a box around the observer. Each pixel's ray meets one wall; what that gets of light follows from where it is.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, Frame, View
from entoptic.pipeline.scenes.discs import add_discs

Reals = NDArray[np.float64]

LOW_M, HIGH_M = np.array([-2.5, -1.2, -1.0]), np.array([2.0, 1.5, 4.0])
"""The box's corners from the eye: x to the right, y up, z ahead."""
EVEN_CD_M2, CEILING_CD_M2 = 150.0, 156.0
"""White walls under the 500 lx of an office (EN 12464-1): 500·0.9/π = 143 cd/m²; the ceiling, lit from a cove, a little
more."""
EVEN_SHARE, FROM_CEILING = 0.88, 0.24
"""How the walls' light divides into what comes from everywhere and what comes from the ceiling. Engineering choice: so
that a wall meets the ceiling with less than 10 % contrast, and the floor too."""
CANDLE_M, CANDLE_CD, FLAME_M = np.array([0.45, -0.35, 2.2]), 1.0, 0.006
"""A flame of 1 cd and 12 mm across: 9e3 cd/m²."""
FLAME = (2.64, 0.61, 0.0)
"""Linear Rec.709 at luminance 1 of a black body at 1900 K (CIE 1931)."""
REFLECTED_LX = 0.06
"""What all walls send back to each. Engineering choice: 12.6 lm on 78 m² of walls that reflect a third."""
WALL, PICTURE, BOARDS = 0.55, 0.12, 0.2
"""Albedos: plaster, the pictures on it, the floor."""


def bright_room(view: View) -> Frame:
    """An empty, evenly lit white room: 100 to 200 cd/m², no edge of more than 20 %."""
    point, axis, _ = _meet(view)
    width, depth = (HIGH_M - LOW_M)[[0, 2]]
    below = np.maximum(HIGH_M[1] - point[1], 1e-9)
    # What of the ceiling a point sees: of a wall, by the ceiling's two parts on either side; of the floor, by four.
    beside_x = point[0] - LOW_M[0], HIGH_M[0] - point[0]
    beside_z = point[2] - LOW_M[2], HIGH_M[2] - point[2]
    on_side = sum(_perpendicular(reach, width, below) for reach in beside_z)
    on_end = sum(_perpendicular(reach, depth, below) for reach in beside_x)
    on_floor = sum(_parallel(x, z, below) for x in beside_x for z in beside_z)
    sees = np.select([axis == 0, axis == 2], [on_side, on_end], on_floor)
    walls = EVEN_CD_M2 * (EVEN_SHARE + FROM_CEILING * sees)
    luminance = np.where((axis == 1) & (point[1] > 0), CEILING_CD_M2, walls)
    return Frame(jnp.asarray(np.stack([luminance] * 3), jnp.float32)[None], view)


def candle_room(view: View) -> Frame:
    """A room with one candle and pictures on its walls: 0.01 to 1 cd/m², and a flame of 9e3."""
    point, axis, facing = _meet(view)
    towards = CANDLE_M[:, None, None] - point
    squared = (towards**2).sum(axis=0)
    # The wall's normal points inwards, against the ray.
    cosine = -facing * np.take_along_axis(towards, axis[None], axis=0)[0] / np.sqrt(squared)
    lux = CANDLE_CD * np.maximum(cosine, 0) / squared + REFLECTED_LX
    along = np.where(axis == 0, point[2], point[0])
    hung = (np.abs((along - 0.3) % 1.1 - 0.55) < 0.33) & (np.abs(point[1] - 0.25) < 0.4) & (axis != 1)
    painted = PICTURE * (1.2 + np.sin(40 * along) * np.cos(31 * point[1]))
    boards = BOARDS * (1 + 0.4 * np.sign(np.sin(2 * np.pi * point[0] / 0.3)))
    albedo = np.where(hung, painted, np.where((axis == 1) & (point[1] < 0), boards, WALL))
    colour = np.array(FLAME) / np.dot(LUMINANCE_WEIGHTS, FLAME)
    image = jnp.asarray(colour[:, None, None] * lux * albedo / np.pi, jnp.float32)
    px_per_m = view.focal_px / CANDLE_M[2]
    x_px, y_px = view.width_px / 2 + px_per_m * CANDLE_M[0], view.height_px / 2 - px_per_m * CANDLE_M[1]
    radius_px = px_per_m * FLAME_M
    flame = colour * CANDLE_CD / (np.pi * FLAME_M**2)
    x, y, radius, rgb = (jnp.asarray([value]) for value in (x_px, y_px, radius_px, flame))
    return Frame(add_discs(image, x, y, radius, rgb, half=int(radius_px) + 5)[None], view)


def _meet(view: View) -> tuple[Reals, NDArray[np.intp], Reals]:
    """Where each pixel's ray meets the box (x, y, z), which axis that wall is square to, and on which side it lies."""
    right = (np.arange(view.width_px) + 0.5 - view.width_px / 2) / view.focal_px
    up = (view.height_px / 2 - np.arange(view.height_px) - 0.5) / view.focal_px
    ray = np.stack(np.broadcast_arrays(right[None, :], up[:, None], 1.0)).astype(np.float64)
    bounds = np.where(ray > 0, HIGH_M[:, None, None], LOW_M[:, None, None])
    reach = bounds / np.where(ray == 0, 1e-12, ray)
    axis = np.argmin(np.where(ray == 0, np.inf, reach), axis=0)
    nearest = np.take_along_axis(reach, axis[None], axis=0)
    side = np.sign(np.take_along_axis(ray, axis[None], axis=0)[0])
    return ray * nearest, axis, side


def _parallel(x: Reals, z: Reals, below: Reals) -> Reals:
    """View factor to a rectangle x by z over a corner of which a facing element lies (Howell's catalogue, B-3)."""
    a, b = x / below, z / below
    over_a, over_b = np.sqrt(1 + a * a), np.sqrt(1 + b * b)
    return np.asarray((a / over_a * np.arctan(b / over_a) + b / over_b * np.arctan(a / over_b)) / (2 * np.pi))


def _perpendicular(beside: Reals, away: float, below: Reals) -> Reals:
    """View factor to a rectangle beside by away square to the element, from below its corner (Howell, B-4)."""
    slant = np.hypot(away, below)
    return np.asarray((np.arctan(beside / below) - below / slant * np.arctan(beside / slant)) / (2 * np.pi))
