"""How much night colour may change a displayed frame, and what it makes of changes before it.

Every method adds s·(tint·q − displayed) to a pixel, q the light that rods see, s their share: linear in the pixel but
for the share, so its largest value over a tile stands in a corner of the tile's range. Both functions are of one eye.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.display_gamut import change_within_peak, moved_within_peak
from entoptic.pipeline.effects.night_colour.settings import NightColour, NightMethod
from entoptic.pipeline.effects.night_colour.share import adapted_share, largest_step, share
from entoptic.pipeline.effects.night_colour.shift import may_exceed
from entoptic.pipeline.effects.night_colour.tints import BLUE_XY, tint, weights
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, FrameError
from entoptic.pipeline.primaries import SUM_WEIGHTS
from entoptic.pipeline.ranges import Change, Range

Tiles = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class _Shares:
    """The share that a tile's pixels may have, and by how much a pixel's may change with what came before."""

    low: Tiles
    high: Tiles
    step: Tiles


def skip_bound(range_: Range, adapted_cd_m2: float, settings: NightColour, scene: Range | None = None) -> Change:
    """The most that leaving night colour out changes a pixel: `range_` is displayed, `scene` in cd/m² (per_pixel)."""
    still = np.zeros_like(range_.low)
    shares = _shares(range_, still, adapted_cd_m2, settings, scene, still)
    distance = shares.high * _distance(range_, adapted_cd_m2, settings.method)
    if _stays(shares, adapted_cd_m2, settings):
        return distance
    brighter = np.maximum(tint(settings.method, adapted_cd_m2) - 1, 0)[:, None, None]
    # Of a component c, (1 − s)·c + s·tint·q, and rods see no more than the largest of a colour, q ≤ 1.
    above = np.maximum(range_.high[:3] - 1, 0) + shares.high * brighter
    beyond = _above_peak(range_.high, shares, adapted_cd_m2, settings.method)
    distance[:3] += np.where(beyond, moved_within_peak(above), 0)
    return distance


def propagate(
    change: Change,
    range_: Range,
    adapted_cd_m2: float,
    settings: NightColour,
    scene: Range | None = None,
    scene_change: Change | None = None,
) -> Change:
    """What becomes of a change of the displayed frame, and of the scene that per_pixel looks at."""
    if settings.per_pixel and scene_change is None:
        raise FrameError("night colour per pixel: pass the change of the frame in cd/m² as well")
    moved = np.zeros_like(change) if scene_change is None else scene_change
    shares = _shares(range_, change, adapted_cd_m2, settings, scene, moved)
    by_tint = _through_tint(change, adapted_cd_m2, settings.method)
    out = np.empty_like(change)
    for k in range(4):
        # What was there and what the tint brings: linear in the share, so one of its ends is the worst.
        with_fewest, with_most = ((1 - end) * change[k] + end * by_tint[k] for end in (shares.low, shares.high))
        out[k] = np.maximum(with_fewest, with_most)
    if shares.step.any():
        out += shares.step * _distance(range_.widened(change), adapted_cd_m2, settings.method)
    if _stays(shares, adapted_cd_m2, settings):
        return out
    return change_within_peak(out, _above_peak(range_.high + change, shares, adapted_cd_m2, settings.method))


def _stays(shares: _Shares, adapted_cd_m2: float, settings: NightColour) -> bool:
    """Whether what a tint brings above the peak is left there."""
    largest_tint = float(tint(settings.method, adapted_cd_m2).max())
    return not (settings.per_pixel or may_exceed(settings.method, float(shares.high.max()), largest_tint))


def _above_peak(high: Tiles, shares: _Shares, adapted_cd_m2: float, method: NightMethod) -> NDArray[np.bool_]:
    """Where a component may exceed the display's peak: rods see no more than its largest, and tint that."""
    brighter = 1 + shares.high * max(float(tint(method, adapted_cd_m2).max()) - 1, 0)
    return np.asarray(high[:3].max(0) * brighter > 1)


def _shares(
    range_: Range,
    change: Change,
    adapted_cd_m2: float,
    settings: NightColour,
    scene: Range | None,
    scene_change: Change,
) -> _Shares:
    shape = range_.low.shape[1:]
    if settings.per_pixel:
        if scene is None:
            raise FrameError("night colour per pixel: pass the range of the frame in cd/m² as well")
        around = scene.widened(scene_change)
        low, high = share(around.high[3], settings.method), share(around.low[3], settings.method)
        step = np.minimum(largest_step(around.low[3], scene_change[3], settings.method), high - low)
    else:
        low = high = np.full(shape, float(adapted_share(np.array([adapted_cd_m2]), settings)[0]))
        step = np.zeros(shape)
    if settings.method is not NightMethod.KRI_XY:
        return _Shares(low, high, step)
    moves = change.max(0) + scene_change[3] > 0
    least, largest = _sum_per_luminance(range_.widened(change) if moves.any() else range_)
    low, high = _of_blue(low, least), _of_blue(high, largest)
    return _Shares(low, high, np.where(moves, high - low, 0.0))


def _of_blue(sigma: Tiles, sum_per_luminance: Tiles) -> Tiles:
    blue = sigma * sum_per_luminance * BLUE_XY[1]
    return np.asarray(blue / (1 - sigma + blue))


def _sum_per_luminance(range_: Range) -> tuple[Tiles, Tiles]:
    """Least and largest (X + Y + Z)/Y of a tile's pixels.

    A ratio of two sums has them in corners of the range: largest where blue, by itself 16.7, is high and green, 1.7, is
    low, least the other way round; red, 3.0, may be either. All high stands in for corners that are black.
    """
    low, high = range_.low, range_.high
    all_high = _ratio(high[0], high[1], high[2])
    least = np.fmin(_ratio(low[0], high[1], low[2]), _ratio(high[0], high[1], low[2]))
    largest = np.fmax(_ratio(low[0], low[1], high[2]), _ratio(high[0], low[1], high[2]))
    # Where all is black there is no share to know.
    return np.nan_to_num(np.fmin(least, all_high), nan=1.0), np.nan_to_num(np.fmax(largest, all_high), nan=1.0)


def _ratio(red: Tiles, green: Tiles, blue: Tiles) -> Tiles:
    """(X + Y + Z)/Y, not a number for black."""
    rgb = (red, green, blue)
    with np.errstate(invalid="ignore"):
        return np.asarray(_sum(SUM_WEIGHTS, rgb) / _sum(LUMINANCE_WEIGHTS, rgb))


def _distance(range_: Range, adapted_cd_m2: float, method: NightMethod) -> Change:
    """Largest |tint·q − displayed| of a tile's pixels, in R, G, B and Y."""
    colour, seen_by = tint(method, adapted_cd_m2), np.array(weights(method))
    luminance = np.array(LUMINANCE_WEIGHTS)
    brightness = luminance @ colour
    difference = np.vstack([np.outer(colour, seen_by) - np.eye(3), brightness * seen_by - luminance])
    low, high = range_.low, range_.high
    out = np.empty_like(low)
    # Plane by plane: NumPy takes small arrays from memory that it has, larger ones from the system each time.
    for row, weighed in enumerate(difference.tolist()):
        least = _sum(weighed, [low[k] if weighed[k] > 0 else high[k] for k in range(3)])
        most = _sum(weighed, [high[k] if weighed[k] > 0 else low[k] for k in range(3)])
        np.maximum(most, -least, out=out[row])
    if method is NightMethod.RODS:
        return out
    # Rods that see as cones do see Y, whose range is often narrower than R's, G's and B's together.
    for k in range(3):
        by_luminance = np.maximum(colour[k] * high[3] - low[k], high[k] - colour[k] * low[3])
        np.minimum(out[k], by_luminance, out=out[k])
    np.minimum(out[3], abs(brightness - 1) * high[3], out=out[3])
    return out


def _through_tint(change: Change, adapted_cd_m2: float, method: NightMethod) -> list[Tiles]:
    """What a change of a pixel does to tint·q, in R, G, B and Y."""
    colour = tint(method, adapted_cd_m2)
    seen = _sum(weights(method), change)
    if method is not NightMethod.RODS:
        seen = np.minimum(seen, change[3])
    return [part * seen for part in (*colour, np.array(LUMINANCE_WEIGHTS) @ colour)]


def _sum(by: Sequence[float], rgb: Sequence[Tiles] | Change) -> Tiles:
    """Written out: for three terms a matrix product wakes threads that cost more than they do."""
    return np.asarray(by[0] * rgb[0] + by[1] * rgb[1] + by[2] * rgb[2])
