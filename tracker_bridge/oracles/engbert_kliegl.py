"""Microsaccades of a whole recording, the offline form: Engbert & Kliegl 2003 as the Microsaccade Toolbox has it.

Positions are degrees, evenly sampled, shape (n, 2); samples are counted from 0. The online form is microsaccades.py.
Engbert & Kliegl 2003, Vision Res. 43, 1035; Engbert & Mergenthaler 2006, PNAS 103, 7192; Engbert, Sinn, Mergenthaler &
Trukenbrod 2015, "Microsaccade Toolbox for R".
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LAMBDA = 5.0
"""Threshold in units of σ: the toolbox's default. Engbert & Kliegl 2003 took 6."""

MIN_SAMPLES = 3
"""The toolbox's default: 6 ms at 500 Hz. A movement of exactly so many samples counts."""

MIN_GAP_S = 0.02
"""Between two movements: what comes sooner is the overshoot of the first (Engbert & Mergenthaler 2006)."""


class Movement(NamedTuple):
    """A saccade or microsaccade of one eye."""

    first: int
    """The first sample above the threshold."""
    last: int
    """The last one."""
    peak_velocity_deg_s: float
    azimuth_deg: float
    """From the first sample to the last, to the right."""
    elevation_deg: float
    azimuth_extent_deg: float
    """Between the two extremes on the way, positive where the rightmost comes last."""
    elevation_extent_deg: float

    @property
    def extent_deg(self) -> float:
        """The amplitude, overshoot included."""
        return float(np.hypot(self.azimuth_extent_deg, self.elevation_extent_deg))


def velocities_deg_s(positions_deg: Floats, rate_hz: float) -> Floats:
    """Velocity over five samples, (x₊₂ + x₊₁ − x₋₁ − x₋₂)·rate/6, for three samples or more; shape (n, 2).

    The second sample and the last but one have the difference of their neighbours, the outermost have 0.
    """
    x = positions_deg
    velocity = np.zeros_like(x)
    velocity[2:-2] = (x[4:] + x[3:-1] - x[1:-3] - x[:-4]) * (rate_hz / 6.0)
    velocity[[1, -2]] = (x[[2, -1]] - x[[0, -3]]) * (rate_hz / 2.0)
    return velocity


def noise_deg_s(velocity_deg_s: Floats) -> Floats:
    """σ per axis, from medians so that the movements themselves hardly count: √median((v − median v)²), shape (2,).

    The paper writes median(v²) − median(v)² under the root, which differs where the median is not 0; this is what the
    toolbox does. The true standard deviation of normal noise is 1.48 times as large. Where more than half of the
    velocities are equal, so that this is 0, it is their standard deviation.
    """
    sigma = np.sqrt(np.median((velocity_deg_s - np.median(velocity_deg_s, axis=0)) ** 2, axis=0))
    return np.where(sigma < 1e-10, np.std(velocity_deg_s, axis=0), sigma)


def excess(velocity_deg_s: Floats, sigma_deg_s: Floats, factor: float) -> Floats:
    """How far each velocity lies outside the threshold's ellipse: above 1 is outside; shape (n,)."""
    radius = factor * sigma_deg_s
    return np.asarray(np.sum((velocity_deg_s / np.where(radius > 0.0, radius, np.inf)) ** 2, axis=1), dtype=np.float64)


def movements(
    positions_deg: Floats,
    rate_hz: float,
    *,
    factor: float = LAMBDA,
    min_samples: int = MIN_SAMPLES,
    sigma_deg_s: Floats | None = None,
) -> list[Movement]:
    """The movements of one eye, in order. `sigma_deg_s`, shape (2,), may come from elsewhere, as a longer recording."""
    velocity = velocities_deg_s(positions_deg, rate_hz)
    sigma = noise_deg_s(velocity) if sigma_deg_s is None else sigma_deg_s
    outside = excess(velocity, sigma, factor) > 1.0
    edges = np.flatnonzero(np.diff(outside, prepend=False, append=False))
    runs = ((int(start), int(end) - 1) for start, end in edges.reshape(-1, 2))
    return [
        _movement(first, last, positions_deg[first : last + 1], velocity[first : last + 1])
        for first, last in runs
        if last - first + 1 >= min_samples
    ]


def _movement(first: int, last: int, x: Floats, v: Floats) -> Movement:
    lowest, highest = np.argmin(x, axis=0), np.argmax(x, axis=0)
    extent = np.sign(highest - lowest) * np.ptp(x, axis=0)
    return Movement(first, last, float(np.hypot(*v.T).max()), *(x[-1] - x[0]).tolist(), *extent.tolist())


def binocular(left: Sequence[Movement], right: Sequence[Movement]) -> list[tuple[Movement, Movement]]:
    """The movements that both eyes make, as (left, right): of each cluster of overlapping ones the larger of each eye.

    Movements that touch, the one ending on the sample before the other's first, are one cluster.
    """
    clusters: list[tuple[list[Movement], list[Movement]]] = []
    end = -2
    for movement, eye in sorted(itertools.chain(((m, 0) for m in left), ((m, 1) for m in right))):
        if movement.first > end + 1:
            clusters.append(([], []))
        clusters[-1][eye].append(movement)
        end = max(end, movement.last)
    return [(_larger(of_left), _larger(of_right)) for of_left, of_right in clusters if of_left and of_right]


def _larger(some: Iterable[Movement]) -> Movement:
    return max(some, key=lambda movement: movement.extent_deg)


def without_overshoots(some: Sequence[Movement], rate_hz: float) -> list[Movement]:
    """The same movements of one eye without those that begin less than 20 ms after the one before has ended."""
    kept: list[Movement] = []
    end: float = -np.inf
    for movement in some:
        if (movement.first - end) / rate_hz >= MIN_GAP_S:
            kept.append(movement)
        end = movement.last
    return kept
