"""How much all this can change, from the tiles' ranges alone.

A pixel gives away a share of its own light and gets the same shares of the light around it, so it changes by no more
than the sum, over rings around it, of what the eye scatters there times how far the light there can differ from its
own. A plain wall hardly changes; a wall beside a lamp does.

Rings are squares of tiles. What is scattered beyond a square is the mean of what is scattered beyond its border in each
direction; the four in which it is nearest say more than there is, but never less.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare.kernel import Mixture, Part, far_deg
from entoptic.pipeline.effects.glare.scatter import plane_for
from entoptic.pipeline.effects.glare.settings import GlareLevel
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.measure import Measurement
from entoptic.pipeline.optics import radial
from entoptic.pipeline.ranges import Change, Range

Reals = NDArray[np.float64]
Off = tuple[float, float, float]
"""How far off what is near is, what is far, and the angle in degrees between."""
ALL: Off = (1.0, 1.0, 0.0)
OFF_NEAR = {GlareLevel.EIGHTH: 1.0, GlareLevel.QUARTER: 0.6, GlareLevel.HALF: 0.5, GlareLevel.FULL: 0.4}
"""How far a level is off in what is near, as a share of what is near and can change."""
OFF_FAR = {GlareLevel.EIGHTH: 0.12, GlareLevel.QUARTER: 0.08, GlareLevel.HALF: 0.08, GlareLevel.FULL: 0.08}
"""The same of what is far. Both measured on frames of noise, which are worse than any picture (test_changes.py)."""
ANGLES_DEG = np.concatenate([[0.0], np.geomspace(1e-3, radial.EDGE_DEG, 240)])
"""At which it is known what is scattered further."""
SAMPLED = ((96.0, 48), (12.0, 108))
"""Samples per degree of a part, and how many to each side: the finer, as far as they reach, in place of the coarser."""
SWING = 0.06
"""How far levels are off from the function itself, as a share of what changes in any channel: B-splines swing, and a
channel's swing shows in another that should get nothing. Measured: 0.03."""
NEXT_PX = 0.5
"""Light scattered no further stays in its pixel."""


@dataclasses.dataclass(frozen=True, eq=False)
class Rings:
    """The light around each tile, as far as each ring reaches, beyond the frame's edges too."""

    measured: Measurement
    low: Reals
    """Least and largest of red, green, blue and luminance, (ring, 4, row, column)."""
    high: Reals
    further: Reals
    """How much more red, green and blue there differ from the tile's own than as far as the ring within reaches."""
    has_ceiling: bool


def rings(measured: Measurement, beyond_cd_m2: Reals, ceiling_cd_m2: float | None = None) -> Rings:
    """Of a frame with light of `beyond_cd_m2` beyond its edges; with a ceiling, only light above it scatters."""
    outside = np.append(beyond_cd_m2, np.dot(LUMINANCE_WEIGHTS, beyond_cd_m2))
    low, high = measured.range_cd_m2.low, measured.range_cd_m2.high
    if ceiling_cd_m2 is not None:
        low, high = np.zeros_like(low), np.where(high[3] > ceiling_cd_m2, high, 0)
        outside = outside * (outside[3] > ceiling_cd_m2)
    both, outside = np.concatenate([low, -high]), np.concatenate([outside, -outside])
    grown, found, reached = _with_edges(both, outside, measured), [], 0
    for reach in _reaches(max(low.shape[1:])):
        grown = _grown(grown, outside, reach - reached)
        found.append(grown)
        reached = reach
    around = np.array(found)
    ring_low, ring_high = around[:, :4], -around[:, 4:]
    apart = np.maximum(ring_high[:, :3] - low[:3], high[:3] - ring_low[:, :3])
    return Rings(measured, ring_low, ring_high, np.diff(apart, axis=0, prepend=0), ceiling_cd_m2 is not None)


def skipped(mixture: Mixture, rings: Rings) -> Change:
    """The most that leaving glare out changes, in cd/m²."""
    return _change(_beyond_rings(mixture, rings.measured, ALL), rings)


def reduced(mixture: Mixture, rings: Rings, level: GlareLevel, asked: GlareLevel) -> Change:
    """The most that a level differs from the one asked for, in cd/m²."""
    if level is asked:
        return np.zeros_like(rings.low[0])
    of_levels = [
        _beyond_rings(
            mixture,
            rings.measured,
            (OFF_NEAR[each], OFF_FAR[each], far_deg(plane_for(rings.measured.view, each))[1]),
        )
        for each in (level, asked)
    ]
    return _change(of_levels[0] + of_levels[1], rings)


def _change(beyond: Reals, rings: Rings) -> Change:
    change = (beyond * rings.further[:, None]).sum(axis=(0, 2))
    return np.asarray(change + SWING * change.max(axis=0))


def after(mixture: Mixture, rings: Rings, hidden: Change) -> Range:
    """What may stand in each tile whether glare has run or not; `hidden` is what it may change.

    A pixel is afterwards between its own light and that of the pixels around, each in its share: no brighter than the
    brightest pixel of its tile with the brightest of each ring around it.
    """
    range_ = rings.measured.range_cd_m2
    if rings.has_ceiling:
        return range_.widened(hidden)
    beyond = _beyond_rings(mixture, rings.measured, ALL)
    weights = np.array(LUMINANCE_WEIGHTS)[:, None, None]
    of_luminance = beyond[:, 3] / weights
    own = np.stack([*(beyond[:, i, i] for i in range(3)), of_luminance.max(axis=1)], axis=1)
    across = beyond.copy()
    for i in range(3):
        across[:, i, i] = 0
    across[:, 3] = (own[:, 3:] - of_luminance) * weights
    strayed = (across * np.diff(rings.high[:, :3], axis=0, prepend=0)[:, None]).sum(axis=(0, 2))
    less = (own * np.diff(np.maximum(range_.low - rings.low, 0), axis=0, prepend=0)).sum(axis=0)
    more = (own * np.diff(np.maximum(rings.high - range_.high, 0), axis=0, prepend=0)).sum(axis=0)
    swing = SWING * hidden.max(axis=0)
    return Range(
        np.maximum(range_.low - less - strayed - swing, 0), range_.high + more + strayed + swing, range_.tile_px
    )


def propagate(change: Change, mixture: Mixture) -> Change:
    """The most that glare makes of a change before it: all of it, from wherever it is largest."""
    gain = np.sum([weight * part.kept("gain", functools.partial(_gain, part)) for part, weight in mixture], axis=0)
    return np.broadcast_to((gain @ change[:3].max(axis=(1, 2)))[:, None, None], change.shape)


def _beyond_rings(mixture: Mixture, measured: Measurement, off: Off) -> Reals:
    """What is scattered beyond where each ring begins: (ring, 4, 3, row, column)."""
    key = "rings", measured.view, measured.range_cd_m2.tile_px, off
    of_parts = [weight * part.kept(key, functools.partial(_rings, part, measured, off)) for part, weight in mixture]
    return np.asarray(of_parts[0] if len(of_parts) == 1 else np.sum(of_parts, axis=0))


def _with_edges(both: Reals, outside: Reals, measured: Measurement) -> Reals:
    """Least of tiles, where those that the frame's edge cuts reach beyond it."""
    both = both.copy()
    if measured.view.height_px % measured.range_cd_m2.tile_px:
        both[:, -1] = np.minimum(both[:, -1], outside[:, None])
    if measured.view.width_px % measured.range_cd_m2.tile_px:
        both[:, :, -1] = np.minimum(both[:, :, -1], outside[:, None])
    return both


def _grown(values: Reals, outside: Reals, tiles: int) -> Reals:
    """The least of all that lies within so many tiles more, and of what is outside the frame."""
    count, rows, columns = values.shape
    edged = np.empty((count, rows + 2 * tiles, columns))
    edged[:] = outside[:, None, None]
    edged[:, tiles : tiles + rows] = values
    values = np.minimum(np.minimum(edged[:, :rows], edged[:, tiles : tiles + rows]), edged[:, 2 * tiles :])
    edged = np.empty((count, rows, columns + 2 * tiles))
    edged[:] = outside[:, None, None]
    edged[:, :, tiles : tiles + columns] = values
    return np.minimum(np.minimum(edged[:, :, :columns], edged[:, :, tiles : tiles + columns]), edged[:, :, 2 * tiles :])


def _rings(part: Part, measured: Measurement, off: Off) -> Reals:
    """Of each ring, at each tile: what is scattered beyond where it begins, (ring, 4, 3, row, column)."""
    view, tile_px = measured.view, measured.range_cd_m2.tile_px
    rows, columns = measured.range_cd_m2.low.shape[1:]
    away = [
        np.maximum(np.abs(np.arange(count) * tile_px - size / 2), np.abs(np.arange(1, count + 1) * tile_px - size / 2))
        for count, size in ((rows, view.height_px), (columns, view.width_px))
    ]
    radius = np.hypot(away[0][:, None], away[1]) / view.focal_px
    beyond = _beyond(part, off)
    result = []
    for edge_px in (NEXT_PX, *(reach * tile_px for reach in _reaches(max(rows, columns))[:-1])):
        edge = edge_px / view.focal_px
        # Away from the axis, towards it and to both sides; to a square's corners it is further.
        outwards, inwards = np.arctan(radius + edge) - np.arctan(radius), np.arctan(radius) - np.arctan(radius - edge)
        aside = np.arctan(edge / np.sqrt(1 + radius * radius))
        deg = np.degrees(np.stack([outwards, inwards, aside, aside]))
        result.append([[np.interp(deg, ANGLES_DEG, one).mean(axis=0) for one in of] for of in beyond])
    return np.array(result)


def _reaches(tiles: int) -> list[int]:
    """How many tiles rings reach to each side: about half as many again each time."""
    found = [1, 2, 3]
    while found[-1] < tiles:
        found.append(min(found[-1] * 3 // 2, tiles))
    return found


def _beyond(part: Part, off: Off) -> Reals:
    """What is scattered beyond each of ANGLES_DEG, as far off as said: (4, 3, angle), to R, G, B, Y of each channel."""
    deg, light = part.kept("strewn", functools.partial(_strewn, part))
    counted = light * np.where(deg < off[2], off[0], off[1])
    order = np.searchsorted(ANGLES_DEG, deg)
    of_angle = np.stack([[np.bincount(order, one, len(ANGLES_DEG) + 1) for one in of] for of in counted])
    return np.asarray(of_angle[..., ::-1].cumsum(axis=-1)[..., ::-1][..., :-1])


def _strewn(part: Part) -> tuple[Reals, Reals]:
    """Angles, and how much light goes that far: (n,) and (4, 3, n), all counted as positive."""
    angles, lights, begins = [], [], 0.0
    for per_deg, count in SAMPLED:
        cells = part.cells(per_deg, count, 1.0)
        offset = np.arange(-count, count + 1) / per_deg
        middle, corner = (np.hypot(away[:, None], away) for away in (np.abs(offset), np.abs(offset) + 0.5 / per_deg))
        mine = (middle >= begins) & (middle < count / per_deg)
        if len(cells) == 1:
            cells = np.eye(3)[:, :, None, None] * cells
        both = np.concatenate([cells, np.einsum("o,oijk->ijk", np.array(LUMINANCE_WEIGHTS), cells)[None]])
        angles.append(corner[mine])
        lights.append(np.abs(both[:, :, mine]))
        begins = count / per_deg
    if part.veil is not None:
        edges = ANGLES_DEG[ANGLES_DEG > 1]
        middles = (edges[1:] + edges[:-1]) / 2
        steradians = 2 * math.pi * np.sin(np.radians(middles)) * np.radians(np.diff(edges))
        angles.append(edges[1:])
        weights = np.concatenate([np.eye(3), [LUMINANCE_WEIGHTS]])
        lights.append(weights[:, :, None] * part.veil.density(middles, 1.0) * steradians)
    return np.concatenate(angles), np.concatenate(lights, axis=2)


def _gain(part: Part) -> Reals:
    """(4, 3): what arrives at most in red, green, blue and luminance of a unit of each channel all over."""
    _, light = part.kept("strewn", functools.partial(_strewn, part))
    return np.asarray(light.sum(axis=2))
