"""Colours beyond the display's: from tone-mapped components of any size to components in [0, 1].

What pixels are divided by, where that is what becomes of them; gamut.py has the way that keeps hue. And, for both, what
that makes of ranges and of changes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.display_gamut import WEIGHTS, components_at
from entoptic.pipeline.effects.tone.settings import Hue
from entoptic.pipeline.fast_math import larger

TRADED = 0.75
"""A colour too bright for the display is dimmed by its largest component to this power, less towards white: what
is lost as luminance keeps chroma. Engineering choice by looking at lamps: with 0 a red one is a white disc with a hard
edge, with 1 a blue one's glow a flat disc."""
DARKER, BRIGHTER = 0.06, 0.18
"""gamut.py makes a colour darker than it is dimmed by at most so much of what it lacks to white, and brighter by so
much of its luminance: what is hardly beyond the display is clipped, and so are blues. By search: 0.014 and 0.145."""
PALE, SINKS, SLIPS = 0.01, (0.78, 0.99, 0.97), 0.004
"""Where no component is less than the first of the largest, each is, dimmed, at least its share of the lesser of itself
and luminance, less the third. By search, 0.80, 1.0, 0.98, 0.003: from cyan and blue to white red sinks at first."""
STEEPEST = 16.0
"""At most so many times a change over a component's weight is what gamut.py makes of it. By search over 16 million
pairs, 14.7: near blue, Oklab's hue hardly changes along the display's edge, and a small change goes far."""
STEEPEST_LUMINANCE = 26.0, 2.6
"""The same of luminance: of its own change and of the largest component's. By search, 24 and 2.4."""


@dataclasses.dataclass(frozen=True, eq=False)
class Mapped:
    """What may stand in each tile between the operator and what brings it within the display's."""

    low: NDArray[np.float64]
    """(3, rows, columns): least components; of colours with a component below 0 no bound."""
    high: NDArray[np.float64]
    """(3, rows, columns): largest components."""
    y: NDArray[np.float64]
    """(2, rows, columns): least and largest luminance."""
    below: NDArray[np.bool_]
    """(rows, columns): where a component of the scene may lie below 0."""

    @property
    def may_be_beyond(self) -> NDArray[np.bool_]:
        """Where a colour may lie beyond the display's."""
        return np.asarray(self.below | (self.high.max(0) > 1))


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
            largest = larger(larger(planes[0], planes[1]), planes[2])
            return larger(largest * gain + offset, 1)
        case Hue.XYY:
            return larger(y * gain + offset, 1)
        case Hue.CLIP | Hue.OKLAB:
            return jnp.ones_like(gain)


def range_within(mapped: Mapped, hue: Hue) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What may stand in each component after that; (3, rows, columns) each."""
    if hue is Hue.OKLAB:
        return _to_white(mapped)
    low, high = mapped.low, mapped.high
    return np.minimum(low / _divisor(high, hue), 1), np.minimum(high / _divisor(low, hue), 1)


def change_within(
    change: NDArray[np.float64], y_change: NDArray[np.float64], mapped: Mapped, hue: Hue
) -> NDArray[np.float64]:
    """How much components and luminance may change after that, (4, rows, columns), where they changed by so much.

    With the divisor m, |p'/m' − p/m| ≤ (|p' − p| + p/m·|m' − m|)/m'. No component of p/m is above 1, nor, divided by
    luminance, above one over its weight.
    """
    low, high = mapped.low, mapped.high
    least = _divisor(low, hue)
    match hue:
        case Hue.OKLAB:
            return _change_to_white(change, y_change, mapped)
        case Hue.CLIP:
            # What is above the peak before and after is the peak.
            return with_luminance(np.minimum(change, np.maximum(1 - low, 0)))
        case Hue.RGB:
            moved, most = change.max(0), np.ones((3, 1, 1))
        case Hue.XYY:
            moved, most = np.tensordot(WEIGHTS, change, 1), 1 / WEIGHTS[:, None, None]
    moved = np.minimum(moved, _divisor(high, hue) - least)
    return with_luminance(np.minimum((change + np.minimum(high / least, most) * moved) / least, 1))


def with_luminance(rgb: NDArray[np.float64]) -> NDArray[np.float64]:
    """Three components and the luminance they make together."""
    both = np.empty((4, *rgb.shape[1:]))
    both[:3] = rgb
    np.matmul(WEIGHTS, rgb.reshape(3, -1), out=both[3].reshape(-1))
    return both


def _to_white(mapped: Mapped) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    low, high, beyond = mapped.low, mapped.high, mapped.may_be_beyond
    y_low, y_high = np.minimum(mapped.y, 1)
    # Y·m^(−TRADED·(1 − Y)) rises with luminance and falls with the largest component m.
    dimmed = np.maximum(high.max(0), 1) ** (-TRADED * (1 - y_low))
    darkest = y_low * dimmed
    least, most = components_at(darkest - DARKER * (1 - darkest), (1 + BRIGHTER) * y_high)
    sinks = np.array(SINKS)[:, None, None]
    pale = ~mapped.below & (low.min(0) >= PALE * high.max(0))
    least = np.maximum(least, np.where(pale, sinks * dimmed * np.minimum(low, y_low) - SLIPS, 0))
    return np.where(beyond, np.minimum(low, least), low), np.where(beyond, most, high)


def _change_to_white(change: NDArray[np.float64], y_change: NDArray[np.float64], mapped: Mapped) -> NDArray[np.float64]:
    out = with_luminance(change)
    np.minimum(out[3], y_change, out=out[3])
    beyond = mapped.may_be_beyond
    if not beyond.any():
        return out
    low, high = range_within(mapped, Hue.OKLAB)
    # A change of brightness alone leaves hue as it is, however large a component below 0 may be.
    largest = np.maximum(change.max(0), y_change)
    moved = np.minimum(STEEPEST / WEIGHTS[:, None, None] * largest, high - low)
    by_luminance, by_largest = STEEPEST_LUMINANCE
    brighter = np.minimum(by_luminance * y_change + by_largest * largest, np.tensordot(WEIGHTS, moved, 1))
    out[:3], out[3] = np.where(beyond, moved, out[:3]), np.where(beyond, brighter, out[3])
    return out


def _divisor(rgb: NDArray[np.float64], hue: Hue) -> NDArray[np.float64]:
    match hue:
        case Hue.CLIP | Hue.OKLAB:
            return np.ones(rgb.shape[1:])
        case Hue.RGB:
            return np.asarray(np.maximum(rgb.max(0), 1))
        case Hue.XYY:
            return np.asarray(np.maximum(np.tensordot(WEIGHTS, rgb, 1), 1))
