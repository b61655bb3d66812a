"""Which colour of the display has a hue and a luminance and is as saturated as the display can be: a table.

Hue is that of Oklab (Ottosson 2020, "A perceptual color space for image processing"), made such that blue mixed with
white does not turn purple as it does in CIELAB or in light itself. It is a function of chromaticity alone.
"""

from __future__ import annotations

import functools
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.frame import LUMINANCE_WEIGHTS

TO_LMS = (
    (0.4122214708, 0.5363325363, 0.0514459929),
    (0.2119034982, 0.6806995451, 0.1073969566),
    (0.0883024619, 0.2817188376, 0.6299787005),
)
"""Oklab's cones of linear Rec.709."""
TO_A = (1.9779984951, -2.4285922050, 0.4505937099)
TO_B = (0.0259040371, 0.7827717662, -0.8086757660)
"""Oklab's a and b of the cones' cube roots."""
HUES, LUMINANCES = 512, 64
"""Cells of the table. Engineering choice: 0.2° of hue, and 260 kB that stay in a core's cache."""
_DIRECTIONS = 8192
"""Of colours of one luminance around grey, from which the table is read off."""
_LEAST = 1e-3
"""The table's first luminance, and what its last one lacks to 1: closer to black and to white, directions no longer
change."""

Values = TypeVar("Values", NDArray[np.float64], jax.Array)


def turn(a: Values, b: Values) -> Values:
    """Oklab's hue from 0 to 4, a quarter turn for each, by a ratio where an arc tangent would give an angle."""
    xp = jnp if isinstance(a, jax.Array) else np
    along = a / xp.maximum(xp.abs(a) + xp.abs(b), np.float32(1e-9))
    return xp.where(b >= 0, 1 - along, 3 + along)


@functools.cache
def directions() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Red and blue of a direction away from grey, at equal luminance, in which the display ends at a hue.

    Two tables (HUES + 1)·(LUMINANCES + 1), hue by hue, of `turn`·HUES/4 and luminance·LUMINANCES. Around blue the
    display's edge bends inwards by 0.15° of hue, and the same hue lies on it thrice: there one of them is taken.
    """
    weights = np.array(LUMINANCE_WEIGHTS)
    # Two directions at right angles in the plane of no luminance.
    first = np.array([1.0, -weights[0] / weights[1], 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(weights / np.linalg.norm(weights), first)
    angles = np.linspace(0, 2 * np.pi, _DIRECTIONS, endpoint=False)
    around = np.outer(first, np.cos(angles)) + np.outer(second, np.sin(angles))
    table = np.empty((2, HUES + 1, LUMINANCES + 1), np.float32)
    for k, luminance in enumerate(np.clip(np.linspace(0, 1, LUMINANCES + 1), _LEAST, 1 - _LEAST)):
        edge = luminance + around / np.maximum(around.max(0) / (1 - luminance), -around.min(0) / luminance)
        roots = np.cbrt(np.array(TO_LMS) @ np.maximum(edge, 0))
        hues = np.unwrap(turn(np.array(TO_A) @ roots, np.array(TO_B) @ roots), period=4)
        sense = 1.0 if hues[-1] > hues[0] else -1.0
        hues = np.maximum.accumulate(sense * hues)
        turns = np.concatenate([hues - 4, hues, hues + 4])
        at = np.interp(
            sense * np.linspace(0, 4, HUES + 1),
            turns,
            np.concatenate([angles - 2 * np.pi, angles, angles + 2 * np.pi]),
        )
        table[0, :, k] = first[0] * np.cos(at) + second[0] * np.sin(at)
        table[1, :, k] = first[2] * np.cos(at) + second[2] * np.sin(at)
    return table[0].ravel(), table[1].ravel()
