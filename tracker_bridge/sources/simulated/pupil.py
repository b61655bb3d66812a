"""A simulated pupil: its steady size, its reflex to light, and its unrest."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_REFERENCE_AGE_YEARS = 28.58
"""Mean age of the observers behind the formula for the young (Watson & Yellott 2012)."""

LATENCY_S = 0.20
_SURGE_DECADES_PER_MM, _ADAPTATION_S = 5.0, 0.09
_FAST_SHARE = 0.65
_FAST_DILATION_S = 1.65
_SLOW_CONSTRICTION_S, _SLOW_DILATION_S = 1.5, 4.0
_SMOOTHING_S = 0.15
"""The light reflex: a pure delay; a drive that exceeds the light while that is new; a fast part, which constricts at
once, and a slow one, which follow the size that the drive asks for; then the iris's own sluggishness, two equal lags.

The surge lets the pupil turn while a weak flash is still on and only after a bright one is over. It is some decades of
luminance for each mm by which the steady size is smaller than the one the eye is adapted to: at first every flash
saturates the pupil, then the drive falls back to the light, the sooner the weaker that is (and when light goes, below
it). That cones adapt within a light while other receptors hold the pupil is measured (McDougal & Gamlin 2010, Vision
Res. 50, 72); this form of it is an engineering choice. It makes small steps overshoot, which no
measurement here holds: from 10 to 12 cd/m² the pupil shrinks by 0.4 mm and stays 0.1 mm smaller, and light that goes
10 % up and down five times a second keeps it 0.3 mm smaller.

Fitted to the five mean responses to 1 s flashes from 1 to 180 µW that were measured with a PLR-3000 pupillometer and
published with PyPlr (Martin et al. 2022, Behav. Res. Methods 54, 2720), with one factor from power to luminance for
all: latency, minimum and time of the minimum within 7 %, the whole course within 9.5 % of the diameter from −1 to 7.4 s
and within 10.5 % to 8 s, where the weakest flash leaves the measured pupil wider than it was before. Responses of 8 s
show little of the slow constants: dilations from 4 to 10 s fitted alike, and the shortest is taken."""

STEP_S = 0.01
"""Time step of the reflex. Its filters are exact at any step; what goes into them is constant within one, which moves
no diameter by more than 0.01 mm."""

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


class ReflexSteps:
    """The light reflex without its pure delay, one STEP_S at a time. The first luminance has been there for ever."""

    def __init__(self, luminance_cd_m2: float, field_deg2: float, age_years: float) -> None:
        self._field_deg2, self._age_years = field_deg2, age_years
        self._light(luminance_cd_m2)
        self._adapted = self._fast = self._slow = self._smoothed = self.pupil_diameter_mm = self._steady
        """What each filter holds, as the diameter that it asks for, mm."""
        self._adapt, self._fast_out, self._slow_in, self._slow_out = (
            -math.expm1(-STEP_S / tau_s)
            for tau_s in (_ADAPTATION_S, _FAST_DILATION_S, _SLOW_CONSTRICTION_S, _SLOW_DILATION_S)
        )
        self._lag_kept = math.exp(-STEP_S / _SMOOTHING_S)

    def step(self, luminance_cd_m2: float) -> None:
        """One STEP_S on, under this light, which came LATENCY_S ago; `pupil_diameter_mm` is then what it is."""
        if luminance_cd_m2 != self._luminance:
            self._light(luminance_cd_m2)
        surge = 10.0 ** (_SURGE_DECADES_PER_MM * (self._adapted - self._steady))
        goal = watson_yellott_mm(self._luminance * surge, self._field_deg2, self._age_years)
        self._adapted += (self._steady - self._adapted) * self._adapt
        self._fast = min(goal, self._fast + (goal - self._fast) * self._fast_out)
        self._slow += (goal - self._slow) * (self._slow_in if goal < self._slow else self._slow_out)
        both = _FAST_SHARE * self._fast + (1.0 - _FAST_SHARE) * self._slow
        # Both lags at once, for what goes into them is constant over the step.
        lag_mm = self._smoothed - both
        self._smoothed = both + lag_mm * self._lag_kept
        self.pupil_diameter_mm = (
            both + (self.pupil_diameter_mm - both + lag_mm * STEP_S / _SMOOTHING_S) * self._lag_kept
        )

    def _light(self, luminance_cd_m2: float) -> None:
        self._luminance = luminance_cd_m2
        self._steady = watson_yellott_mm(luminance_cd_m2, self._field_deg2, self._age_years)


def first_step(t_s: float) -> int:
    """The first step of the reflex that a light from this time on takes part in."""
    return math.ceil((t_s + LATENCY_S) / STEP_S - 1e-6)


def light_reflex_mm(
    seconds: float, steps: Sequence[tuple[float, float]], field_deg2: float, age_years: float
) -> Floats:
    """Diameter in mm every STEP_S from 0 to `seconds`, under light of (from when in s, cd/m²) steps in order.

    The first luminance has been there for ever.
    """
    from_step = [first_step(t_s) for t_s, _ in steps]
    reflex = ReflexSteps(steps[0][1], field_deg2, age_years)
    at = 0
    diameters = np.empty(math.ceil(seconds / STEP_S) + 1)
    for step in range(diameters.size):
        diameters[step] = reflex.pupil_diameter_mm
        while at + 1 < len(steps) and step >= from_step[at + 1]:
            at += 1
        reflex.step(steps[at][1])
    return diameters


def with_hippus_mm(rng: np.random.Generator, pupil_diameters_mm: Floats, gain: float) -> Floats:
    """The same diameters, every STEP_S, with the pupil's unrest: Ritschel et al. 2009, eq. 1, in mm.

    The paper gives the noise no amplitude; `gain` is it (0.1 makes ± 0.17 mm at 4 mm, what is seen in healthy eyes).
    Its t/p is taken as an integral over time, so that the noise does not jump when p changes.
    """
    phase = np.cumsum(STEP_S / pupil_diameters_mm)
    swing = _P_MAX_MM / pupil_diameters_mm * np.sqrt(1.0 - np.minimum(pupil_diameters_mm / _P_MAX_MM, 1.0))
    return pupil_diameters_mm + gain * _value_noise(rng, phase) * swing


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
