"""The fine radial lines that a formula of the angle alone does not have (SPE 3.2).

Antialiased radial lines of random intensity are drawn on the kernel's grid, one set for the ciliary corona and another
for the halo, and levelled so that every small neighbourhood keeps the mean 1. A kernel times these lines has the same
light in every neighbourhood as before, so the formula keeps its calibration.

A line is one pixel wide at every distance, so a fixed number of lines leaves ever wider gaps, in which no neighbourhood
could have the mean 1. Here new lines begin all the way out, each where there is room for one in SPACING_PX of the
circumference; once begun, a line goes on to the kernel's edge. Line i is the same line on every kernel: a smaller
kernel is the middle of a larger one.
"""

from __future__ import annotations

import enum
import heapq
import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

SPACING_PX = 6.0
"""Mean distance of neighbouring lines. Engineering choice: far enough for lines of one pixel to be seen as lines."""
MIDDLE = 0.4
"""A new line lies anywhere in this middle part of the widest gap. Engineering choice: random to look at, and still no
gap wider than 1.7 times the mean."""
NEIGHBOURHOOD_PX = 2 * SPACING_PX
"""Standard deviation of the Gaussian neighbourhood whose mean is 1: four lines lie within it. Engineering choice."""
LEVELLINGS = (1.0, 1.5, 1.5, 1.5)
"""Powers of the neighbourhoods' means to divide by, one after the other. Engineering choice: brings them to within 15 %
of 1 everywhere and to 2 % in the root mean square; with powers of 1 it takes six."""

_REACH = 3.0
"""Standard deviations at which the neighbourhood ends."""


class Flare(enum.IntEnum):
    """Which set of lines: they have different physical causes (SPE 3.2). The value seeds its random stream."""

    CORONA = 101
    """Ciliary corona, for f1 and f2."""
    HALO = 102
    """Lenticular halo, for f3."""


def flare_lines(seed: int, flare: Flare, rows_radius_px: int, columns_radius_px: int) -> NDArray[np.float64]:
    """What to multiply a kernel of sides 2·radius + 1 with; non-negative, every neighbourhood's mean 1, the centre 1.

    The same for the same seed of an observer (≥ 0) and set of lines.
    """
    # Neighbourhoods at the kernel's edge are levelled with what lies beyond it.
    margin = math.ceil(len(LEVELLINGS) * _REACH * NEIGHBOURHOOD_PX)
    lines = _drawn(seed, flare, rows_radius_px + margin, columns_radius_px + margin)
    for power in LEVELLINGS:
        lines /= gaussian_filter(lines, NEIGHBOURHOOD_PX, truncate=_REACH) ** power
    rows, columns = 2 * rows_radius_px + 1, 2 * columns_radius_px + 1
    lines = lines[margin : margin + rows, margin : margin + columns]
    y, x = np.ogrid[-rows_radius_px : rows_radius_px + 1, -columns_radius_px : columns_radius_px + 1]
    # Nearer than one spacing there is no room for lines, and most of the light.
    begun = _smooth_step(np.hypot(y, x) / SPACING_PX - 0.5)
    return 1 + begun * (lines - 1)


def with_flare_lines(kernel: NDArray[np.float64], lines: NDArray[np.float64]) -> NDArray[np.float64]:
    """A kernel, or one for each channel (…, rows, columns), with lines in it and each one's sum unchanged.

    Neighbourhoods have the mean 1 in a level field, not quite on a slope: what is left, 1 % or so, and more where a
    halo is but a pixel or two wide, is scaled away.
    """
    drawn = kernel * lines
    was, now = (of.sum(axis=(-2, -1), keepdims=True) for of in (kernel, drawn))
    return np.asarray(drawn * np.divide(was, now, out=np.ones_like(was), where=now != 0))


def _smooth_step(position: NDArray[np.float64]) -> NDArray[np.float64]:
    position = np.clip(position, 0, 1)
    return position * position * (3 - 2 * position)


def _drawn(seed: int, flare: Flare, rows_radius_px: int, columns_radius_px: int) -> NDArray[np.float64]:
    """The sum of the lines: of each, a pixel gets the intensity times 1 − its distance from the line in pixels.

    Along its longer axis a line has a step in each pixel; across it, the three nearest pixels can be within one pixel.
    """
    count = math.ceil(2 * math.pi * math.hypot(rows_radius_px, columns_radius_px) / SPACING_PX)
    angle, intensity = _lines(seed, flare, count)
    begins_px = SPACING_PX * np.arange(count, dtype=np.float64) / (2 * math.pi)
    along, across = np.cos(angle), np.sin(angle)
    picture = np.zeros((2 * rows_radius_px + 1, 2 * columns_radius_px + 1))
    level = np.abs(along) >= np.abs(across)
    _draw(picture, along[level], across[level], begins_px[level], intensity[level])
    _draw(picture.T, across[~level], along[~level], begins_px[~level], intensity[~level])
    return picture


def _lines(seed: int, flare: Flare, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angles in radians and intensities of the first lines, each put into the widest gap that those before it left."""
    # Line by line, so that more lines leave the first ones as they are.
    place, intensity = np.random.default_rng([seed, flare]).random((count, 2)).T
    turns = [place[0]]
    gaps = [(-1.0, turns[0])]
    for share in 0.5 + MIDDLE * (place[1:] - 0.5):
        wide, start = gaps[0]
        turns.append(start - share * wide)
        heapq.heapreplace(gaps, (share * wide, start))
        heapq.heappush(gaps, ((1 - share) * wide, turns[-1]))
    return 2 * math.pi * np.array(turns), intensity


def _draw(
    picture: NDArray[np.float64],
    along: NDArray[np.float64],
    across: NDArray[np.float64],
    begins_px: NDArray[np.float64],
    intensity: NDArray[np.float64],
) -> None:
    """Draws lines in the directions (along, across), |along| ≥ |across|, from the middle of a picture to its edge."""
    rows_radius, columns_radius = picture.shape[0] // 2, picture.shape[1] // 2
    for x in range(-columns_radius, columns_radius + 1):
        this_way = np.nonzero(along * x > 0)[0]
        y = x * across[this_way] / along[this_way]
        distance_px = x / along[this_way]
        fade = _smooth_step((distance_px - begins_px[this_way]) / (begins_px[this_way] / 2 + SPACING_PX))
        weight = intensity[this_way] * fade
        for row in np.rint(y)[None, :] + np.array([[-1], [0], [1]]):
            part = weight * np.maximum(0, 1 - np.abs(row - y) * np.abs(along[this_way]))
            inside = np.abs(row) <= rows_radius
            np.add.at(picture[:, x + columns_radius], row[inside].astype(int) + rows_radius, part[inside])
