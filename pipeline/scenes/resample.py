"""Fewer or more pixels with the same light: each new one is the mean over the area it covers.

Done once when an image is read or a view changes, on the processor and never a frame, so in NumPy.
"""

from __future__ import annotations

import numpy as np


def area_mean(values: np.ndarray, count: int) -> np.ndarray:
    """`values` with `count` elements along the last axis, each the mean over its stretch of the old ones.

    Exact for any ratio: the stretches are cut at the borders of both, nothing is subtracted, so a dark pixel beside
    the sun keeps its digits and nothing turns negative. The mean along the axis stays.
    """
    old = values.shape[-1]
    if old == count:
        return values
    # Borders in units of 1/(old·count) are integers, so that equal borders are found equal.
    borders = np.union1d(np.arange(old + 1) * count, np.arange(count + 1) * old)
    source, target = borders[:-1] // count, borders[:-1] // old
    lengths = (np.diff(borders) / old).astype(np.float32)
    starts = np.searchsorted(target, np.arange(count))
    pieces = values[..., source] * lengths
    return np.asarray(np.add.reduceat(pieces, starts, axis=-1, dtype=np.float64), dtype=values.dtype)


def resize(image: np.ndarray, height_px: int, width_px: int) -> np.ndarray:
    """An image (…, y, x) of another size, area for area."""
    rows = np.swapaxes(area_mean(np.swapaxes(image, -1, -2), height_px), -1, -2)
    return np.ascontiguousarray(area_mean(rows, width_px))
