"""Colours beyond the display's, one by one, in float64: to white at one hue of Oklab.

Oklab as Ottosson 2020 states it, of CIE XYZ; the colour sought is found by halving an angle around grey.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.oracles.adaptation import luminance
from entoptic.pipeline.oracles.night_colour import RGB_TO_XYZ

Reals = NDArray[np.float64]

XYZ_TO_LMS = np.array(
    [
        [0.8189330101, 0.3618667424, -0.1288597137],
        [0.0329845436, 0.9293118715, 0.0361456387],
        [0.0482003018, 0.2643662691, 0.6338517070],
    ]
)
LMS_TO_LAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)
CLIPPED, MAPPED = 0.01, 0.06
"""Beyond the display by so much of the distance from grey: up to the first clipped, from the second on mapped."""
TRADED = 0.75
"""Exponent of luminance lost for what the brightest component is too bright."""


def hue(rgb: Reals) -> Reals:
    """Oklab's, radians; (3, …) linear Rec.709."""
    _, a, b = np.tensordot(LMS_TO_LAB, np.cbrt(np.tensordot(XYZ_TO_LMS @ RGB_TO_XYZ, rgb, 1)), 1)
    return np.asarray(np.arctan2(b, a))


def to_white(rgb: Reals) -> Reals:
    """An image (3, y, x), 1 = the display's peak, any values, as the display shows it."""
    flat = rgb.reshape(3, -1).copy()
    y = np.minimum(luminance(rgb), 1).ravel()
    flat[:, (y <= 0) & (flat.min(0) < 0)] = 0
    with np.errstate(divide="ignore", invalid="ignore"):
        by_peak, by_black = (flat.max(0) - y) / np.maximum(1 - y, 1e-7), (y - flat.min(0)) / y
    share = np.clip((np.fmax(by_peak, by_black) - 1 - CLIPPED) / (MAPPED - CLIPPED), 0, 1)
    share[y <= 0] = 0
    out = np.clip(flat, 0, 1)
    out[:, (y >= 1) & (share > 0)] = 1
    left = (share > 0) & (y < 1)
    # A blue within the triangle of chromaticities fills its peak.
    fills = np.clip((by_peak - 1) * 20, 0, 1) * np.clip(1 - (by_black - 1) * 20, 0, 1)
    dimmed = y * np.maximum(flat.max(0), 1) ** (-TRADED * (1 - y))
    out[:, left] += share[left] * (_edge(flat[:, left], dimmed[left], fills[left]) - out[:, left])
    return np.asarray(out.reshape(rgb.shape))


def _edge(rgb: Reals, y: Reals, fills: Reals) -> Reals:
    """Where the display ends at colours' hues (3, pixel): directions around grey of their luminance, by halves."""
    weights = RGB_TO_XYZ[1]
    from_grey = rgb / (weights @ rgb) - 1
    across = np.cross(weights, from_grey, axisb=0, axisc=0)
    across *= np.linalg.norm(from_grey, axis=0) / np.linalg.norm(across, axis=0)
    wanted = hue(rgb)

    def ends(angle: Reals, black: Reals | float = 1.0) -> Reals:
        direction = from_grey * np.cos(angle) + across * np.sin(angle)
        return np.asarray(y + direction / np.maximum(direction.max(0) / (1 - y), -black * direction.min(0) / y))

    def off(angle: Reals) -> Reals:
        """Hue of the display's edge there against the one wanted."""
        return np.asarray((hue(np.maximum(ends(angle), 0)) - wanted + np.pi) % (2 * np.pi) - np.pi)

    low, high = np.full_like(y, -1.0), np.full_like(y, 1.0)
    sense = np.sign(off(high) - off(low))
    for _ in range(50):
        middle = (low + high) / 2
        above = sense * off(middle) > 0
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.clip(ends((low + high) / 2, 1 - fills), 0, 1)
