"""Colours beyond the display's: from tone-mapped components of any size to components in [0, 1]."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from pipeline.effects.tone.settings import Hue
from pipeline.frame import LUMINANCE_WEIGHTS
from pipeline.measure import luminance

WEIGHTS = np.array(LUMINANCE_WEIGHTS)


def within(rgb: Float[Array, "eye 3 y x"], hue: Hue) -> Float[Array, "eye 3 y x"]:
    """Components of 0 and more brought within [0, 1]."""
    match hue:
        case Hue.RGB:
            rgb = rgb / jnp.maximum(rgb.max(1, keepdims=True), 1)
        case Hue.XYY:
            rgb = rgb / jnp.maximum(luminance(rgb)[:, None], 1)
        case Hue.CLIP:
            pass
    return jnp.minimum(rgb, 1)


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
