"""What a frame contains: all that planning and adaptation need to know of it, in one pass over its pixels."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import scipy.ndimage
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, Frame, View
from entoptic.pipeline.ranges import Range

TILES = 128
"""Low resolution: at most 128 tiles along the longer side (LUI 5.1)."""
HISTOGRAM_LOG10 = np.linspace(-6.0, 10.0, 65)
"""Edges of the luminance histogram, log10 cd/m²: starlight to beyond the sun, four bins a decade."""
RANGE_TILES = 32
"""Ranges are kept of at most so many tiles along the longer side. Engineering choice: with 64, planning
takes 15 ms instead of 6."""
DARKEST_CD_M2 = np.float32(1e-6)
"""A tile that is darker counts as this bright in the average of logarithms: below starlight by a thousand."""
MAX_SOURCES = 16
SOURCE_RATIO = 30
"""A source is this much brighter than the frame's mean. Engineering choice."""


Fold = Callable[[Array, Array], Array]
START: dict[Fold, float] = {jnp.minimum: np.inf, jnp.maximum: -np.inf, jnp.add: 0.0}
"""What folding begins with."""


@dataclasses.dataclass(frozen=True)
class LightSource:
    """A bright spot: a tile whose brightest pixel stands out."""

    x_px: float
    y_px: float
    peak_cd_m2: float


@dataclasses.dataclass(frozen=True)
class Measurement:
    """What one eye's image contains."""

    view: View
    tile_px: int
    tile_mean_cd_m2: NDArray[np.float32]
    """Mean luminance of each tile, shape (tile rows, tile columns)."""
    range_cd_m2: Range
    """Least and largest of each tile's pixels; its tiles are larger (RANGE_TILES)."""
    min_cd_m2: float
    max_cd_m2: float
    mean_cd_m2: float
    log_average_cd_m2: NDArray[np.float64]
    """Of red, green and blue: of their tiles' means, on average of the logarithm, so that a lamp hardly counts."""
    sources: tuple[LightSource, ...]
    """Brightest first, MAX_SOURCES at most: tiles whose peak is a local maximum and SOURCE_RATIO times the mean of the
    image.

    Neighbouring tiles of the same peak are one light.
    """

    @property
    def histogram(self) -> NDArray[np.int64]:
        """Tiles in each bin of HISTOGRAM_LOG10; what lies outside counts in the first and the last."""
        with np.errstate(divide="ignore"):
            log = np.clip(np.log10(self.tile_mean_cd_m2), HISTOGRAM_LOG10[0], HISTOGRAM_LOG10[-1])
        return np.histogram(log, HISTOGRAM_LOG10)[0]

    def share_below(self, luminance_cd_m2: float) -> float:
        """Share of the image's tiles whose mean is darker."""
        return float((self.tile_mean_cd_m2 < luminance_cd_m2).mean())


def measure(frame: Frame) -> tuple[Measurement, ...]:
    """A measurement of each eye's image."""
    height, width = frame.rgb_cd_m2.shape[2:]
    tile_px = -(-max(height, width) // TILES)
    pool = math.ceil(max(height, width) / (tile_px * RANGE_TILES))
    per_eye = jax.device_get(_reduce(frame.rgb_cd_m2, tile_px, pool))
    return tuple(
        _interpret(frame.view, tile_px, pool, *(quantity[eye] for quantity in per_eye))
        for eye in range(frame.rgb_cd_m2.shape[0])
    )


def averaged(measured: Measurement) -> Measurement:
    """A measurement as if every tile were grey and as bright all over as it is on average, its tiles twice as large."""
    pool = 2 * measured.range_cd_m2.tile_px // measured.tile_px
    mean = measured.tile_mean_cd_m2.astype(np.float64)
    for axis in (0, 1):
        begins = np.arange(0, mean.shape[axis], pool)
        counts = np.diff(np.append(begins, mean.shape[axis]))
        mean = np.add.reduceat(mean, begins, axis=axis) / np.expand_dims(counts, 1 - axis)
    grey = np.broadcast_to(mean, (4, *mean.shape))
    return dataclasses.replace(measured, range_cd_m2=Range(grey, grey, pool * measured.tile_px))


def luminance(rgb: Float[Array, "*eye 3 y x"]) -> Float[Array, "*eye y x"]:
    """Luminance of linear Rec.709 RGB, in the unit of the RGB."""
    red, green, blue = (np.float32(weight) for weight in LUMINANCE_WEIGHTS)
    return red * rgb[..., 0, :, :] + green * rgb[..., 1, :, :] + blue * rgb[..., 2, :, :]


@functools.partial(jax.jit, static_argnames=("tile_px", "pool"))
def _reduce(
    rgb: Float[Array, "eye 3 y x"], tile_px: int, pool: int
) -> tuple[
    Float[Array, "eye 4 rows columns"],
    Float[Array, "eye 4 rows columns"],
    Float[Array, "eye row column"],
    Float[Array, "eye row column"],
    Float[Array, "eye 3"],
]:
    """Least and largest of red, green, blue and luminance of tiles pooled; luminance's largest and sum of each tile; of
    red, green and blue their average by tiles' logarithms.
    """
    y = luminance(rgb)
    low, high, sums = _by_tile((rgb, rgb, rgb), (jnp.minimum, jnp.maximum, jnp.add), tile_px)
    low_y, high_y = _by_tile((y, y), (jnp.minimum, jnp.maximum), tile_px)
    low, high = jnp.concatenate([low, low_y[:, None]], 1), jnp.concatenate([high, high_y[:, None]], 1)
    low, high = _by_tile((low, high), (jnp.minimum, jnp.maximum), pool)
    return low, high, high_y, luminance(sums), _log_average(sums, rgb.shape[2], rgb.shape[3], tile_px)


def _log_average(
    sums: Float[Array, "eye 3 row column"], height: int, width: int, tile_px: int
) -> Float[Array, "eye 3"]:
    rows, columns = (
        np.minimum(tile_px, size - tile_px * np.arange(-(-size // tile_px), dtype=np.float32))
        for size in (height, width)
    )
    mean = sums / (rows[:, None] * columns)
    average = jnp.exp(jnp.log(jnp.maximum(mean, DARKEST_CD_M2)).mean(axis=(2, 3)))
    return jnp.where(sums.max(axis=(2, 3)) > 0, average, 0)


def _by_tile(images: tuple[Array, ...], folds: tuple[Fold, ...], tile_px: int) -> tuple[Array, ...]:
    """Several folds of images of one shape in one pass: rows first, which XLA vectorises, and with no padded copy."""
    for axis in (images[0].ndim - 2, images[0].ndim - 1):
        images = _along(images, folds, tile_px, axis)
    return images


def _along(images: tuple[Array, ...], folds: tuple[Fold, ...], tile_px: int, axis: int) -> tuple[Array, ...]:
    starts = tuple(np.float32(START[fold]) for fold in folds)

    def fold_all(ours: tuple[Array, ...], theirs: tuple[Array, ...]) -> tuple[Array, ...]:
        return tuple(fold(one, other) for fold, one, other in zip(folds, ours, theirs, strict=True))

    size = images[0].shape[axis]
    whole = size - size % tile_px
    parts = []
    for begin, end in ((0, whole), (whole, size)):
        if begin < end:
            sliced = [jax.lax.slice_in_dim(image, begin, end, axis=axis) for image in images]
            side = min(tile_px, end - begin)
            tiles = [part.reshape(*part.shape[:axis], -1, side, *part.shape[axis + 1 :]) for part in sliced]
            parts.append(jax.lax.reduce(tuple(tiles), starts, fold_all, (axis + 1,)))
    return tuple(jnp.concatenate(part, axis) for part in zip(*parts, strict=True))


def _interpret(
    view: View,
    tile_px: int,
    pool: int,
    low: NDArray[np.float32],
    high: NDArray[np.float32],
    tile_max: NDArray[np.float32],
    total: NDArray[np.float32],
    log_average: NDArray[np.float32],
) -> Measurement:
    rows, columns = (
        np.minimum(tile_px, size - tile_px * np.arange(-(-size // tile_px))) for size in (view.height_px, view.width_px)
    )
    tile_mean = (total / (rows[:, None] * columns)).astype(np.float32)
    mean = float(total.sum(dtype=np.float64)) / (view.height_px * view.width_px)
    return Measurement(
        view=view,
        tile_px=tile_px,
        tile_mean_cd_m2=tile_mean,
        range_cd_m2=Range(low.astype(np.float64), high.astype(np.float64), tile_px * pool),
        min_cd_m2=float(low[3].min()),
        max_cd_m2=float(high[3].max()),
        mean_cd_m2=mean,
        log_average_cd_m2=log_average.astype(np.float64),
        sources=_sources(tile_max, mean, tile_px),
    )


def _sources(tile_max: NDArray[np.float32], mean_cd_m2: float, tile_px: int) -> tuple[LightSource, ...]:
    if tile_max.max() <= SOURCE_RATIO * mean_cd_m2:
        return ()
    stands_out = tile_max > SOURCE_RATIO * mean_cd_m2
    lights, _ = scipy.ndimage.label((tile_max >= _largest_around(tile_max)) & stands_out, np.ones((3, 3)))
    at = np.flatnonzero(lights)
    _, first = np.unique(lights.ravel()[at], return_index=True)
    rows, columns = np.unravel_index(at[first], lights.shape)
    brightest = np.argsort(-tile_max[rows, columns], kind="stable")[:MAX_SOURCES]
    return tuple(
        LightSource((columns[k] + 0.5) * tile_px, (rows[k] + 0.5) * tile_px, float(tile_max[rows[k], columns[k]]))
        for k in brightest
    )


def _largest_around(tile_max: NDArray[np.float32]) -> NDArray[np.float32]:
    """The largest of each tile and its neighbours."""
    for axis in (0, 1):
        one, other = np.moveaxis(tile_max, axis, 0), tile_max.copy()
        around = np.moveaxis(other, axis, 0)
        np.maximum(around[1:], one[:-1], out=around[1:])
        np.maximum(around[:-1], one[1:], out=around[:-1])
        tile_max = other
    return tile_max
