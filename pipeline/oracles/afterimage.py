"""What a bleached retina makes of a displayed frame: each pixel's own place on the retina, in float64.

The program looks the retina up at a few thousand nodes and interpolates between them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from entoptic.pipeline.effects.afterimage.geometry import HALF_FIELD_DEG
from entoptic.pipeline.effects.afterimage.retina import cone_matrix
from entoptic.pipeline.effects.afterimage.seen import HELD_STILL, LOG10_RISE, OWN_CD_M2
from entoptic.pipeline.frame import View

Reals = NDArray[np.float64]


def shown(displayed: Reals, bleached: Reals, exposure: float, view: View, gaze_px: tuple[float, float]) -> Reals:
    """A displayed frame (3, y, x), linear, with the afterimages of a retina (3, row, column) that looks at a pixel."""
    there = _on_retina(bleached, view, gaze_px)
    field = _at_nodes_mean(bleached, view, gaze_px)
    own = np.maximum(_own_light(there) - _own_light(field), 0)
    cones = cone_matrix()
    to_rgb = np.linalg.inv(cones)
    light = -np.expm1(-np.maximum(np.einsum("kc,cyx->kyx", to_rgb, own), 0) * exposure * HELD_STILL)
    more = (field - there) / np.maximum(1 - field, 1e-6) * np.einsum("cj,jyx->cyx", cones, displayed)
    changed = displayed + (1 - displayed**2) * np.einsum("kc,cyx->kyx", to_rgb, more)
    return np.asarray(changed + light * (1 - changed))


def _own_light(bleached: Reals) -> Reals:
    return np.asarray(OWN_CD_M2 * np.expm1(bleached * LOG10_RISE * np.log(10)))


def _at_nodes_mean(bleached: Reals, view: View, gaze_px: tuple[float, float]) -> Reals:
    """What the field has bleached on average, (3, 1, 1)."""
    return np.asarray(_on_retina(bleached, view, gaze_px).mean(axis=(1, 2), keepdims=True))


def _on_retina(bleached: Reals, view: View, gaze_px: tuple[float, float]) -> Reals:
    """The map where each pixel falls, (3, y, x): Listing's law, degrees of eccentricity, bilinear."""
    y, x = np.indices((view.height_px, view.width_px)) + 0.5
    away = _unit(x, y, view)
    right, up, ahead = gaze = _unit(np.float64(gaze_px[0]), np.float64(gaze_px[1]), view)
    # Turned back about the axis that is at right angles to straight ahead and to the gaze (Rodrigues).
    axis = np.array([up, -right, 0.0])
    dot = np.tensordot(axis, away, 1)
    crossed = np.stack([axis[1] * away[2], -axis[0] * away[2], axis[0] * away[1] - axis[1] * away[0]])
    seen = away * gaze[2] + crossed + axis[:, None, None] * dot / (1 + ahead)
    off_axis = np.hypot(seen[0], seen[1])
    deg = np.degrees(np.arctan2(off_axis, seen[2])) / np.maximum(off_axis, 1e-12)
    count = bleached.shape[1]
    per_cell, middle = (count - 1) / (2 * HALF_FIELD_DEG), (count - 1) / 2
    places = np.clip([middle - seen[1] * deg * per_cell, middle + seen[0] * deg * per_cell], 0, count - 1)
    return np.stack([map_coordinates(one, places, order=1) for one in bleached])


def _unit(x_px: NDArray[np.float64] | np.float64, y_px: NDArray[np.float64] | np.float64, view: View) -> Reals:
    """Directions of places in a frame: right, up and ahead."""
    right, up = (x_px - view.width_px / 2) / view.focal_px, (view.height_px / 2 - y_px) / view.focal_px
    return np.stack([right, up, np.ones_like(right)]) / np.sqrt(1 + right**2 + up**2)
