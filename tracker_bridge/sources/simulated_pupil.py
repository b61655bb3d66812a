"""A simulated pupil: its steady size, its reflex to light, and its unrest."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_REFERENCE_AGE_YEARS = 28.58
"""Mean age of the observers behind the formula for the young (Watson & Yellott 2012)."""

LATENCY_S = 0.21
_SMOOTHING_S = 0.075
_FAST_S, _SLOW_S = (0.1, 1.2), (1.1, 3.4)
"""The light reflex: a pure delay, then two equal halves that follow the steady size with a time constant each for
constriction and for dilation, then the iris's own sluggishness. Fitted to the five mean responses to 1 s flashes from
1 to 180 µW that were measured with a PLR-3000 pupillometer and published with PyPlr (Martin et al. 2022, Behav. Res.
Methods 54, 2720): within 9.5 % of the diameter from −1 to 7.4 s, with one factor from power to luminance for all, and
within 10.5 % to 8 s, where the weakest flash leaves the measured pupil wider than it was before."""

STEP_S = 0.01
"""Time step of the reflex; its filters are exact at any step."""

_P_MAX_MM = 9.0
_OCTAVES = 3


def watson_yellott_mm(luminance_cd_m2: float, field_deg2: float, age_years: float) -> float:
    """Steady diameter in mm of both pupils when both eyes see a field of this luminance and area.

    The unified formula of Watson & Yellott 2012, J. Vision 12(10):12, with the factor 1 that it has for two eyes.

    Luminance from 0; age from 20 to 83 years, where its data lie.
    """
    x: float = (luminance_cd_m2 * field_deg2 / 846.0) ** 0.41
    young = 7.75 - 5.75 * x / (x + 2.0)
    return young + (age_years - _REFERENCE_AGE_YEARS) * (0.02132 - 0.009562 * young)


def light_reflex_mm(
    seconds: float, steps: Sequence[tuple[float, float]], field_deg2: float, age_years: float
) -> Floats:
    """Diameter in mm every STEP_S from 0 to `seconds`, under light of (from when in s, cd/m²) steps in order.

    The first luminance has been there for ever.
    """
    steady = [watson_yellott_mm(luminance, field_deg2, age_years) for _, luminance in steps]
    from_step = [math.ceil((t_s + LATENCY_S) / STEP_S - 1e-6) for t_s, _ in steps]
    fast_in, fast_out, slow_in, slow_out, smooth = (
        -math.expm1(-STEP_S / tau_s) for tau_s in (*_FAST_S, *_SLOW_S, _SMOOTHING_S)
    )
    fast = slow = diameter = steady[0]
    at = 0
    diameters = np.empty(math.ceil(seconds / STEP_S) + 1)
    for step in range(diameters.size):
        diameters[step] = diameter
        while at + 1 < len(steps) and step >= from_step[at + 1]:
            at += 1
        goal = steady[at]
        fast += (goal - fast) * (fast_in if goal < fast else fast_out)
        slow += (goal - slow) * (slow_in if goal < slow else slow_out)
        diameter += ((fast + slow) / 2 - diameter) * smooth
    return diameters


def with_hippus_mm(rng: np.random.Generator, diameters_mm: Floats, gain: float) -> Floats:
    """The same diameters, every STEP_S, with the pupil's unrest: Ritschel et al. 2009, eq. 1, in mm.

    The paper gives the noise no amplitude; `gain` is it (0.1 makes ± 0.17 mm at 4 mm, what is seen in healthy eyes).
    Its t/p is taken as an integral over time, so that the noise does not jump when p changes.
    """
    phase = np.cumsum(STEP_S / diameters_mm)
    swing = _P_MAX_MM / diameters_mm * np.sqrt(1.0 - np.minimum(diameters_mm / _P_MAX_MM, 1.0))
    return diameters_mm + gain * _value_noise(rng, phase) * swing


def _value_noise(rng: np.random.Generator, at: Floats) -> Floats:
    """Smooth noise within ± 1 at rising places from 0: random values at whole numbers, in octaves of half amplitude."""
    total = np.zeros_like(at)
    for octave in range(_OCTAVES):
        place = at * 2**octave
        values = rng.uniform(-1.0, 1.0, int(place[-1]) + 2)
        left = place.astype(np.int64)
        between = place - left
        ease = between**2 * (3.0 - 2.0 * between)
        total += (values[left] * (1.0 - ease) + values[left + 1] * ease) / 2**octave
    return total / sum(0.5**octave for octave in range(_OCTAVES))
