"""What a frame contains: all that planning and adaptation need to know of it, in one pass over its pixels."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import scipy.ndimage
from jaxtyping import Array, Float
from numpy.typing import NDArray

from pipeline.frame import LUMINANCE_WEIGHTS, Frame, View

TILES = 128
"""Low resolution: at most 128 tiles along the longer side (LUI §5.1)."""
HISTOGRAM_LOG10 = np.linspace(-6.0, 10.0, 65)
"""Edges of the luminance histogram, log10 cd/m²: starlight to beyond the sun, four bins a decade."""
SHARES_BELOW_CD_M2 = (10.0, 3.0, 0.01)
"""Upper end of mesopic vision with a margin, of mesopic vision by Ferwerda, and of scotopic vision."""
MAX_SOURCES = 16


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
    min_cd_m2: float
    max_cd_m2: float
    mean_cd_m2: float
    histogram: NDArray[np.int64]
    """Tiles in each bin of HISTOGRAM_LOG10; what lies outside counts in the first and the last."""
    share_below: dict[float, float]
    """Share of pixels darker than each of SHARES_BELOW_CD_M2."""
    sources: tuple[LightSource, ...]
    """Brightest first, MAX_SOURCES at most: tiles whose peak is a local maximum and 30 times the mean of the image.

    Neighbouring tiles of the same peak are one light.
    """


def measure(frame: Frame) -> tuple[Measurement, ...]:
    """A measurement of each eye's image."""
    height, width = frame.rgb_cd_m2.shape[2:]
    tile_px = -(-max(height, width) // TILES)
    per_eye = jax.device_get(_reduce(frame.rgb_cd_m2, tile_px))
    return tuple(
        _interpret(frame.view, tile_px, *(np.asarray(quantity[eye]) for quantity in per_eye))
        for eye in range(frame.rgb_cd_m2.shape[0])
    )


def luminance(rgb: Float[Array, "*eye 3 y x"]) -> Float[Array, "*eye y x"]:
    """Luminance of linear Rec.709 RGB, in the unit of the RGB."""
    red, green, blue = (np.float32(weight) for weight in LUMINANCE_WEIGHTS)
    return red * rgb[..., 0, :, :] + green * rgb[..., 1, :, :] + blue * rgb[..., 2, :, :]


@functools.partial(jax.jit, static_argnames="tile_px")
def _reduce(rgb: Float[Array, "eye 3 y x"], tile_px: int) -> tuple[Array, ...]:
    y = luminance(rgb)
    rows, columns = -(-y.shape[1] // tile_px), -(-y.shape[2] // tile_px)
    pad = ((0, 0), (0, rows * tile_px - y.shape[1]), (0, columns * tile_px - y.shape[2]))

    def tiles(values: Array, fill: float) -> Float[Array, "eye row tile column tile"]:
        padded = jnp.pad(values, pad, constant_values=np.float32(fill))
        return padded.reshape(-1, rows, tile_px, columns, tile_px)

    covered = tiles(jnp.ones_like(y), 0.0).sum((2, 4))
    tile_mean = tiles(y, 0.0).sum((2, 4)) / covered
    tile_max = tiles(y, 0.0).max((2, 4))
    below = jnp.stack([(y < np.float32(limit)).mean((1, 2)) for limit in SHARES_BELOW_CD_M2], 1)
    mean = (tile_mean * covered).sum((1, 2)) / (y.shape[1] * y.shape[2])
    return tile_mean, tile_max, y.min((1, 2)), y.max((1, 2)), mean, below


def _interpret(
    view: View,
    tile_px: int,
    tile_mean: NDArray[np.float32],
    tile_max: NDArray[np.float32],
    darkest: NDArray[np.float32],
    brightest: NDArray[np.float32],
    mean: NDArray[np.float32],
    below: NDArray[np.float32],
) -> Measurement:
    with np.errstate(divide="ignore"):
        log = np.clip(np.log10(tile_mean), HISTOGRAM_LOG10[0], HISTOGRAM_LOG10[-1])
    return Measurement(
        view=view,
        tile_px=tile_px,
        tile_mean_cd_m2=tile_mean,
        min_cd_m2=float(darkest),
        max_cd_m2=float(brightest),
        mean_cd_m2=float(mean),
        histogram=np.histogram(log, HISTOGRAM_LOG10)[0],
        share_below=dict(zip(SHARES_BELOW_CD_M2, below.tolist(), strict=True)),
        sources=_sources(tile_max, float(mean), tile_px),
    )


def _sources(tile_max: NDArray[np.float32], mean_cd_m2: float, tile_px: int) -> tuple[LightSource, ...]:
    bordered = np.pad(tile_max, 1, constant_values=-1)
    neighbours = np.lib.stride_tricks.sliding_window_view(bordered, (3, 3)).max((2, 3))
    lights, _ = scipy.ndimage.label((tile_max >= neighbours) & (tile_max > 30 * mean_cd_m2), np.ones((3, 3)))
    labels, first = np.unique(lights, return_index=True)
    rows, columns = np.unravel_index(first[labels > 0], lights.shape)
    brightest = np.argsort(-tile_max[rows, columns], kind="stable")[:MAX_SOURCES]
    return tuple(
        LightSource((columns[k] + 0.5) * tile_px, (rows[k] + 0.5) * tile_px, float(tile_max[rows[k], columns[k]]))
        for k in brightest
    )
