"""How much glare can change each tile of a frame, from the tiles' ranges alone.

A pixel gives away a share of its own light and gets the same shares of the light around it, so it changes by no more
than the sum, over rings around it, of what the kernel scatters there times how far the light there can differ from its
own. A plain wall hardly changes; a wall beside a lamp does. Beyond the frame's edge it is dark.
"""

from __future__ import annotations

import functools
import math

import numpy as np
import scipy.ndimage
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare.kernel import Mixture, Veil
from entoptic.pipeline.effects.glare.settings import GlareLevel
from entoptic.pipeline.effects.glare.veil import amounts
from entoptic.pipeline.effects.glare.window import falloff, float32_limit_cd_m2, window_of
from entoptic.pipeline.frame import View
from entoptic.pipeline.measure import SOURCE_RATIO, Measurement
from entoptic.pipeline.optics import radial
from entoptic.pipeline.ranges import Change, Range

VEIL_MARGIN = 0.1
"""Of what a veil brings: its tiles are up to 2 % off at 9–10° (docs/optics.md), and the share that comes from within
the frame is summed coarsely here."""
VEIL_SWING = 2e-6
"""Of the brightest light's veil: by how much cubic tiles swing where none arrives. Measured: 1e-6."""
FIELD = 48
"""The field is summed in so many parts along each axis, and a veil looked at in a quarter as many places."""
ROUNDED = 3e-8
"""Rounding of a convolution in float32, as a share of the brightest light that is convolved so. Measured: 2e-8 from one
channel to another of a frame half of which is lit."""
STEEPEST = 3.0
"""The falloff's steepest slope, per reach."""


def reduced(
    kernel: Mixture,
    measured: Measurement,
    gaze_px: tuple[float, float],
    asked: GlareLevel,
    ceiling_cd_m2: float | None = None,
) -> Change:
    """The most that the veil alone differs from the level asked for, in cd/m²."""
    range_ = measured.range_cd_m2
    if asked is GlareLevel.VEIL:
        return np.zeros_like(range_.low)
    low, high = range_.low[:3], range_.high[:3]
    if ceiling_cd_m2 is not None or asked is GlareLevel.SOURCES:
        above = max(ceiling_cd_m2 or 0.0, SOURCE_RATIO * measured.mean_cd_m2 if asked is GlareLevel.SOURCES else 0.0)
        low, high = np.zeros_like(low), np.where(range_.high[3] > above, high, 0)
    return _of_light(low, high, kernel, measured, gaze_px, asked)


def _of_light(
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    kernel: Mixture,
    measured: Measurement,
    gaze_px: tuple[float, float],
    asked: GlareLevel,
) -> Change:
    """The most that the kernels of light in this range change of each tile."""
    tile_px = measured.range_cd_m2.tile_px
    change, ring_low, ring_high, reach = np.zeros((4, *low.shape[1:])), low.copy(), high, 0
    # A tile that the frame's edge cuts is dark beyond it.
    if measured.view.height_px % tile_px:
        ring_low[:, -1] = 0
    if measured.view.width_px % tile_px:
        ring_low[:, :, -1] = 0
    for tiles, scattered in _rings(kernel, tile_px):
        grown = (1, *(2 * (tiles - reach) + 1,) * 2)
        ring_low = scipy.ndimage.minimum_filter(ring_low, grown, mode="constant")
        ring_high = scipy.ndimage.maximum_filter(ring_high, grown, mode="constant")
        reach = tiles
        change += np.einsum("oi,iyx->oyx", scattered, np.maximum(ring_high - low, high - ring_low))
    if asked is GlareLevel.WINDOW:
        change = _in_window(change, high, kernel, measured.view, gaze_px, tile_px)
    if asked in (GlareLevel.WINDOW, GlareLevel.FRAME):
        change += ROUNDED * min(float(measured.range_cd_m2.high.max()), float32_limit_cd_m2(measured))
    return change


def after(measured: Measurement, change: Change, stays: float) -> Range:
    """What may stand in each tile once glare has run: of luminance at least what stays in its pixel."""
    range_ = measured.range_cd_m2
    wide = range_.widened(change)
    wide.low[3] = np.maximum(wide.low[3], stays * range_.low[3])
    return wide


def propagate(change: Change, kernel: Mixture) -> Change:
    """The most that glare makes of a change before it: all of it, from wherever it is largest."""
    gain = np.sum([weight * component.gain for component, weight in kernel], axis=0)
    return np.broadcast_to((gain @ change[:3].max(axis=(1, 2)))[:, None, None], change.shape)


def veil(kernel: Mixture, measured: Measurement, ceiling_cd_m2: float | None = None) -> Change:
    """The most that the veil changes, in cd/m².

    Each pixel gives its veil's share away and gets what lies between the darkest and the brightest frame's.
    """
    low, high = measured.range_cd_m2.low, measured.range_cd_m2.high
    if ceiling_cd_m2 is not None:
        low, high = np.zeros_like(low), np.where(high[3] > ceiling_cd_m2, high, 0)
    brightest, darkest = high.max(axis=(1, 2), keepdims=True), low.min(axis=(1, 2), keepdims=True)
    change = np.zeros_like(low)
    for function, share in amounts(kernel).items():
        least, most = _within(measured.view, function, *low.shape[1:], measured.range_cd_m2.tile_px)
        gains = np.minimum(most * (1 + VEIL_MARGIN), 1) * brightest - low
        loses = high - least * (1 - VEIL_MARGIN) * darkest
        change += share * (np.maximum(gains, loses).clip(0) + VEIL_SWING * brightest)
    return change


@functools.lru_cache(maxsize=16)
def _within(
    view: View, veil: Veil, rows: int, columns: int, tile_px: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least and largest share of a veil's light that comes from within the frame, at the corners of each tile."""

    def directions(at: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        v, u = np.meshgrid(at * view.height_px / view.focal_px, at * view.width_px / view.focal_px, indexing="ij")
        away = np.sqrt(1 + u * u + v * v).reshape(-1, 1)
        return np.stack([u, v, np.ones_like(u)], -1).reshape(-1, 3) / away, away[:, 0] ** -3

    at = np.linspace(-0.5, 0.5, FIELD // 4)
    places, _ = directions(at)
    parts, solid_angles = directions((np.arange(FIELD) + 0.5) / FIELD - 0.5)
    deg = np.degrees(np.arccos(np.clip(places @ parts.T, -1, 1)))
    weights = solid_angles * (view.width_px / view.focal_px) * (view.height_px / view.focal_px) / FIELD**2
    density = np.where(deg <= radial.EDGE_DEG, veil.density(deg), 0)
    seen = (density @ weights / radial.hemisphere_volume(veil.density)).reshape(len(at), len(at))
    down, right = (
        np.stack(
            [np.interp(np.minimum(np.arange(count + 1) * tile_px / size, 1) - 0.5, at, one) for one in np.eye(len(at))],
            1,
        )
        for count, size in ((rows, view.height_px), (columns, view.width_px))
    )
    corners = down @ seen @ right.T
    of_tile = [corners[y : y + rows, x : x + columns] for y in (0, 1) for x in (0, 1)]
    return np.min(of_tile, axis=0), np.max(of_tile, axis=0)


def _in_window(
    change: Change,
    high: NDArray[np.float64],
    kernel: Mixture,
    view: View,
    gaze_px: tuple[float, float],
    tile_px: int,
) -> Change:
    """The same where light is weighed by a window's falloff w: w(q)·L(q) − w(p)·L(p), of a pixel p and those around it,
    is w(q)·(L(q) − L(p)), and L(p)·(w(q) − w(p)), which is no more than the falloff's slope times their distance.
    """
    reach_px = _reach_px(view, kernel)
    kernel_px = math.sqrt(2) * (kernel[0][0].scatters.shape[2] // 2)
    nearest, farthest = _away(view, gaze_px, tile_px, change.shape[1:])
    near, far = np.maximum(nearest - kernel_px, 0) / reach_px, (farthest + kernel_px) / reach_px
    # The falloff is steepest halfway, at three quarters of the reach.
    at = np.clip(0.75, near, far)
    slope = np.where((at > 0.5) & (at < 1), STEEPEST * 16 * (at - 0.5) * (1 - at), 0) / reach_px
    moment_px = np.sum([weight * component.moment_px for component, weight in kernel], axis=0)
    return np.asarray(falloff(near) * change + slope * np.einsum("oi,iyx->oyx", moment_px, high))


def _reach_px(view: View, kernel: Mixture) -> float:
    return window_of(view, kernel[0][0].scatters.shape[2] // 2).reach_px


def _away(
    view: View, gaze_px: tuple[float, float], tile_px: int, shape: tuple[int, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far from the gaze the nearest and the farthest pixel of each tile are at least and at most."""
    nearest, farthest = [], []
    for count, gaze, size in zip(shape, gaze_px[::-1], (view.height_px, view.width_px), strict=True):
        begin, end = np.arange(count) * tile_px - gaze, np.minimum(np.arange(1, count + 1) * tile_px, size) - gaze
        nearest.append(np.maximum(np.maximum(begin, -end), 0))
        farthest.append(np.maximum(np.abs(begin), np.abs(end)))
    return np.hypot(nearest[0][:, None], nearest[1]), np.hypot(farthest[0][:, None], farthest[1])


def _rings(kernel: Mixture, tile_px: int) -> list[tuple[int, NDArray[np.float64]]]:
    """Of each ring: how many tiles it reaches, and what is scattered into it, (4, 3): to red, green, blue and Y."""
    radius_px = kernel[0][0].scatters.shape[2] // 2
    reaches = [2**k for k in range(max(1, math.ceil(math.log2(max(radius_px / tile_px, 1))) + 1))]
    edges = tuple(tiles * tile_px for tiles in reaches)
    masses = np.sum([weight * component.rings(edges) for component, weight in kernel], axis=0)
    return [(tiles, masses[k]) for k, tiles in enumerate(reaches)]
