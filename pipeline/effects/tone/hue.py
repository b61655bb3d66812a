"""Colours beyond the display's: from tone-mapped components of any size to components in [0, 1]."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.tone.settings import Hue
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS

WEIGHTS = np.array(LUMINANCE_WEIGHTS)


def weighted(planes: Sequence[Float[Array, "eye y x"]], weights: Sequence[float]) -> Float[Array, "eye y x"]:
    """A weighted sum of three planes."""
    red, green, blue = (np.float32(weight) * plane for weight, plane in zip(weights, planes, strict=True))
    return red + green + blue


def divisor(
    planes: Sequence[Float[Array, "eye y x"]],
    y: Float[Array, "eye y x"],
    gain: Float[Array, "eye #y #x"],
    offset: Float[Array, "eye 1 1"],
    hue: Hue,
) -> Float[Array, "eye #y #x"]:
    """What components·gain + offset, of luminance y·gain + offset, are divided by before they end at 1."""
    match hue:
        case Hue.RGB:
            # By pairs: a reduction over three planes costs more.
            largest = jnp.maximum(jnp.maximum(planes[0], planes[1]), planes[2])
            return jnp.maximum(largest * gain + offset, 1)
        case Hue.XYY:
            return jnp.maximum(y * gain + offset, 1)
        case Hue.CLIP:
            return jnp.ones_like(gain)


def range_within(
    low: NDArray[np.float64], high: NDArray[np.float64], hue: Hue
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What may stand in each component after that, where this stood before; (3, rows, columns) each."""
    return np.minimum(low / _divisor(high, hue), 1), np.minimum(high / _divisor(low, hue), 1)


def change_within(
    change: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64], hue: Hue
) -> NDArray[np.float64]:
    """How much each component may change after that, where it changed by `change`, between `low` and `high`.

    With the divisor m, |p'/m' − p/m| ≤ (|p' − p| + p/m·|m' − m|)/m'. No component of p/m is above 1, nor, divided by
    luminance, above one over its weight.
    """
    least = _divisor(low, hue)
    match hue:
        case Hue.CLIP:
            # What is above the peak before and after is the peak.
            return np.minimum(change, np.maximum(1 - low, 0))
        case Hue.RGB:
            moved, most = change.max(0), np.ones((3, 1, 1))
        case Hue.XYY:
            moved, most = np.tensordot(WEIGHTS, change, 1), 1 / WEIGHTS[:, None, None]
    moved = np.minimum(moved, _divisor(high, hue) - least)
    return np.minimum((change + np.minimum(high / least, most) * moved) / least, 1)


def _divisor(rgb: NDArray[np.float64], hue: Hue) -> NDArray[np.float64]:
    match hue:
        case Hue.CLIP:
            return np.ones(rgb.shape[1:])
        case Hue.RGB:
            return np.asarray(np.maximum(rgb.max(0), 1))
        case Hue.XYY:
            return np.asarray(np.maximum(np.tensordot(WEIGHTS, rgb, 1), 1))
