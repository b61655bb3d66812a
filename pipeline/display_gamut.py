"""The colours that a display has: linear Rec.709 components from 0 to 1, 1 being its peak."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.fast_math import larger, smaller
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS

WEIGHTS = np.array(LUMINANCE_WEIGHTS)


def components_at(
    least_y: NDArray[np.float64], most_y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Between which components (3, rows, columns) lie of colours that the display has, by their luminance.

    A component alone may make all of the luminance, or all that white has more.
    """
    weights = WEIGHTS[:, None, None]
    return np.maximum(1 - (1 - np.minimum(least_y, 1)) / weights, 0), np.minimum(most_y / weights, 1)


def within_peak(planes: Sequence[Float[Array, "n y x"]]) -> tuple[Float[Array, "n y x"], ...]:
    """Colours without a component below 0, mixed with white of their luminance until none is above the peak.

    Keeps the dominant wavelength. For pale colours, as tints make them of what the display has, that is Oklab's hue
    within 3°; saturated ones would turn, blue to purple by 22°.
    """
    red, green, blue = planes
    r, g, b = (np.float32(weight) for weight in LUMINANCE_WEIGHTS)
    luminance = smaller(r * red + g * green + b * blue, np.float32(1))
    largest = larger(larger(red, green), blue)
    keep = jnp.where(largest > 1, (1 - luminance) / (largest - luminance), 1)
    return tuple(luminance + (plane - luminance) * keep for plane in planes)


def change_within_peak(change: NDArray[np.float64], beyond: NDArray[np.bool_]) -> NDArray[np.float64]:
    """What `within_peak` makes at most of a change (4, rows, columns), where a component may be above the peak.

    What is left of a component c, of luminance Y, with the largest M, is Y + t·(c − Y), t = (1 − Y)/(M − Y). With
    q = (c − Y)/(M − Y), not below 1 − 1/w for its weight w, it changes by (1 − t)(1 − q)·δY + t·δc − t·q·δM.
    """
    if not beyond.any():
        return change
    out = change.copy()
    for k, weight in enumerate(LUMINANCE_WEIGHTS):
        moved = np.maximum(change[3] / weight, change[k] + (1 / weight - 1) * change[:3].max(0))
        out[k] = np.where(beyond, np.minimum(moved, np.maximum(change[k], 1)), change[k])
    return out


def moved_within_peak(above: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far `within_peak` moves each component at most, (3, …), where components may be above the peak by so much.

    By (M − 1)·|q|, with M and q as above: the largest falls by what it is above, another rises by 1/w − 1 times that.
    """
    moved = np.empty_like(above)
    for k, weight in enumerate(LUMINANCE_WEIGHTS):
        moved[k] = np.maximum(above[k], (1 / weight - 1) * np.maximum(above[k - 1], above[k - 2]))
    return moved
