"""Simulated eye movements: fixations with slow drift, microsaccades within them and saccades between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from entoptic.tracker_bridge.sources.simulated.lid import Blink

Floats = NDArray[np.float64]

MAIN_SEQUENCE_DEG_S = 100.0
"""Peak velocity of a movement of 1°. Peak velocity grows with the square root of the amplitude (Lebedev, Van Gelder &
Tsui 1996, Invest. Ophthalmol. Vis. Sci. 37, 2750), and microsaccades lie on the same curve as saccades (Zuber, Stark &
Cook 1965, Science 150, 1459). The constant is an engineering choice within the published main sequences: 100 °/s at 1°,
320 °/s at 10° and, with the profile below, microsaccades of 6–24 ms."""

_VIGOUR_SPREAD, _VIGOUR_LIMITS = 0.08, (0.8, 1.2)
"""Scatter of single movements about the main sequence (log-normal). Engineering choice within published scatter."""

PEAK_TO_MEAN = 1.875
"""Of the velocity of a minimum-jerk movement 10τ³ − 15τ⁴ + 6τ⁵ (Flash & Hogan 1985)."""

MICROSACCADE_DEG = (0.15, 1.0)
_SACCADE_DEG = (1.5, 20.0)
_FIELD_DEG = (12.0, 8.0)
"""Fixations lie within ± this. Engineering choice: people turn their head for more."""

_SHORTEST_GAP_S = 0.15
"""Between two movements: about the shortest intersaccadic interval of fixation (Engbert & Kliegl 2003)."""

_FROM_BLINK_S = 0.15
"""No movement begins or ends closer to a blink. Engineering choice: what a tracker shows there cannot be labelled."""

_DRIFT_S, _DRIFT_SMOOTHING_S = 1.0, 0.04
"""Time constants of the drift's wander and of its smoothing; with a wander of 0.1° its speed is 0.5 °/s, the usual
figure for fixation (Rolfs 2009, Vision Res. 49, 2415)."""


class Movement(NamedTuple):
    """A saccade or microsaccade of both eyes."""

    kind: Literal["microsaccade", "saccade"]
    onset_s: float
    duration_s: float
    azimuth_deg: float
    elevation_deg: float

    @property
    def end_s(self) -> float:
        """When the eye has arrived."""
        return self.onset_s + self.duration_s

    @property
    def amplitude_deg(self) -> float:
        """How far the eye goes."""
        return math.hypot(self.azimuth_deg, self.elevation_deg)

    @property
    def peak_velocity_deg_s(self) -> float:
        """How fast it is at its fastest."""
        return PEAK_TO_MEAN * self.amplitude_deg / self.duration_s


def draw_movements(
    rng: np.random.Generator,
    seconds: float,
    blinks: Sequence[Blink],
    saccades_per_minute: float,
    microsaccades_per_second: float,
) -> list[Movement]:
    """Movements at random times, in order, none of them near a blink or the end.

    Saccades go to random places in the field; microsaccades wander and come back, more of them sideways. The rates
    are those of the times that a blink leaves free.
    """
    movements: list[Movement] = []
    fixation_s = 60.0 / saccades_per_minute if saccades_per_minute > 0.0 else math.inf
    gap_s = 1.0 / microsaccades_per_second if microsaccades_per_second > 0.0 else math.inf
    # The place looked at, and the present distance from it, as azimuth + i·elevation.
    target, offset = 0j, 0j
    t_s = 0.0
    next_saccade_s = _after(rng, t_s, fixation_s)
    while True:
        next_microsaccade_s = _after(rng, t_s, gap_s)
        is_saccade = next_saccade_s <= next_microsaccade_s
        next_s = min(next_saccade_s, next_microsaccade_s)
        if math.isinf(next_s):
            return movements
        goal = _elsewhere(rng, target + offset) if is_saccade else target
        way = goal - target - offset if is_saccade else _microsaccade(rng, offset)
        amplitude = abs(way)
        vigour = float(np.clip(math.exp(rng.normal(0.0, _VIGOUR_SPREAD)), *_VIGOUR_LIMITS))
        duration_s = PEAK_TO_MEAN * math.sqrt(amplitude) / (MAIN_SEQUENCE_DEG_S * vigour)
        onset_s = _clear_of(blinks, next_s, duration_s)
        if onset_s + duration_s >= seconds:
            return movements
        movements.append(Movement("saccade" if is_saccade else "microsaccade", onset_s, duration_s, way.real, way.imag))
        t_s = onset_s + duration_s
        if is_saccade:
            target, offset = goal, 0j
            next_saccade_s = _after(rng, t_s, fixation_s)
        else:
            offset += way
            next_saccade_s = max(next_saccade_s, t_s + _SHORTEST_GAP_S)


def _after(rng: np.random.Generator, t_s: float, mean_s: float) -> float:
    """A random time after t_s, on average mean_s later."""
    if math.isinf(mean_s):
        return math.inf
    return t_s + _SHORTEST_GAP_S + rng.exponential(max(mean_s - _SHORTEST_GAP_S, 0.0))


def _elsewhere(rng: np.random.Generator, place: complex) -> complex:
    """A place in the field, one saccade away."""
    while True:
        goal = complex(*rng.uniform(-1.0, 1.0, 2) * _FIELD_DEG)
        if _SACCADE_DEG[0] <= abs(goal - place) <= _SACCADE_DEG[1]:
            return goal


def _microsaccade(rng: np.random.Generator, offset: complex) -> complex:
    """The way of a microsaccade. Its amplitude is log-uniform: the small ones are the frequent ones."""
    amplitude = math.exp(rng.uniform(*np.log(MICROSACCADE_DEG)))
    sideways = rng.choice((0.0, math.pi)) + rng.normal(0.0, 0.5)
    # Beyond 0.3° from the target they correct it; engineering choice that keeps the wander under a degree.
    home = math.atan2(-offset.imag, -offset.real) + rng.normal(0.0, 0.3)
    angle = home if abs(offset) > 0.3 else sideways
    return amplitude * complex(math.cos(angle), math.sin(angle))


def _clear_of(blinks: Sequence[Blink], onset_s: float, duration_s: float) -> float:
    """The onset, put off until the movement is clear of every blink."""
    for blink in blinks:
        if onset_s + duration_s > blink.onset_s - _FROM_BLINK_S and onset_s < blink.end_s + _FROM_BLINK_S:
            onset_s = blink.end_s + _FROM_BLINK_S
    return onset_s


def positions_deg(t_s: Floats, movements: Sequence[Movement]) -> Floats:
    """Azimuth and elevation, shape (2, n), that the movements add up to at n rising times, from (0, 0)."""
    steps = np.zeros((2, t_s.size))
    under_way = np.zeros((2, t_s.size))
    for movement in movements:
        way = np.array([[movement.azimuth_deg], [movement.elevation_deg]])
        start, end = np.searchsorted(t_s, (movement.onset_s, movement.end_s))
        phase = (t_s[start:end] - movement.onset_s) / movement.duration_s
        under_way[:, start:end] += way * (phase**3 * (10.0 + phase * (6.0 * phase - 15.0)))
        steps[:, end : end + 1] += way
    return np.cumsum(steps, axis=1) + under_way


def drift_deg(rng: np.random.Generator, count: int, step_s: float, wander_deg: float) -> Floats:
    """Slow drift along two axes, shape (2, count): a smoothed random walk with a pull home.

    Its standard deviation is wander_deg per axis, all but the 2 % that the smoothing takes.
    """
    from scipy.signal import lfilter  # takes a second to import, and every command opens sources

    keep, smooth = math.exp(-step_s / _DRIFT_S), math.exp(-step_s / _DRIFT_SMOOTHING_S)
    steps = rng.normal(0.0, wander_deg * math.sqrt(1.0 - keep**2), (2, count))
    walk = lfilter([1.0], [1.0, -keep], steps)
    return np.asarray(lfilter([1.0 - smooth], [1.0, -smooth], walk), dtype=np.float64)
