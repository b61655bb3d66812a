"""Value noise: smooth, random, and a function of its argument alone (RIT 3.2, 3.3)."""

from __future__ import annotations

import math

OCTAVES = 3
"""Each twice as fast and half as strong as the one before (RIT 3.2)."""
_WORD = 2**64 - 1
_GOLDEN = 0x9E3779B97F4A7C15


def value_noise(x: float, stream: int) -> float:
    """Noise at a finite `x`, in [−1, 1], continuous with its first derivative; another `stream`, another noise."""
    total = weights = 0.0
    for octave in range(OCTAVES):
        weight = 0.5**octave
        total += weight * _smooth_lattice(x * 2.0**octave, (stream * OCTAVES + octave) & _WORD)
        weights += weight
    return total / weights


def _smooth_lattice(x: float, stream: int) -> float:
    """Random values at the whole numbers, and a smooth step from each to the next."""
    index = math.floor(x)
    share = x - index
    before, after = _value(index, stream), _value(index + 1, stream)
    return before + (after - before) * share * share * (3.0 - 2.0 * share)


def _value(index: int, stream: int) -> float:
    """The value at a whole number, uniform in [−1, 1)."""
    return _mixed(_mixed(stream) ^ (index & _WORD)) * 2.0**-63 - 1.0


def _mixed(word: int) -> int:
    """A bijection of 64-bit words that scatters neighbours (SplitMix64; Steele, Lea & Flood 2014)."""
    word = (word + _GOLDEN) & _WORD
    word = ((word ^ word >> 30) * 0xBF58476D1CE4E5B9) & _WORD
    word = ((word ^ word >> 27) * 0x94D049BB133111EB) & _WORD
    return word ^ word >> 31
