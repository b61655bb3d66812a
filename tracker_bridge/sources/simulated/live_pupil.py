"""Pupils that answer to light while they live: the arithmetic of pupil.py one step at a time, for light that nobody
knows beforehand.
"""

from __future__ import annotations

import collections
import math

import numpy as np
from numpy.typing import NDArray

from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedSettings
from entoptic.tracker_bridge.sources.simulated.pupil import _OCTAVES, _P_MAX_MM, STEP_S, ReflexSteps, first_step

_OCTAVE_WEIGHTS = tuple(math.ldexp(1.0, -octave) / (2.0 - math.ldexp(2.0, -_OCTAVES)) for octave in range(_OCTAVES))
"""Halves from octave to octave, 1 in all."""


class LightReflex:
    """The reflex of pupil.light_reflex_mm, one STEP_S at a time, under light that is set while it runs.

    The first luminance has been there for ever.
    """

    def __init__(self, luminance_cd_m2: float, field_deg2: float, age_years: float) -> None:
        self._reflex = ReflexSteps(luminance_cd_m2, field_deg2, age_years)
        self._luminance = luminance_cd_m2
        self._coming: collections.deque[tuple[int, float]] = collections.deque()
        self._step = 0

    def set_luminance(self, t_s: float, luminance_cd_m2: float) -> None:
        """The light from a time on; of lights at earlier times than one already set the last to come holds."""
        at = first_step(t_s)
        while self._coming and self._coming[-1][0] >= at:
            self._coming.pop()
        self._coming.append((at, luminance_cd_m2))

    def next_mm(self) -> float:
        """The diameter at the present step, without unrest; then one step on."""
        diameter = self._reflex.pupil_diameter_mm
        while self._coming and self._step >= self._coming[0][0]:
            self._luminance = self._coming.popleft()[1]
        self._reflex.step(self._luminance)
        self._step += 1
        return diameter


class Hippus:
    """The unrest of pupil.with_hippus_mm, one STEP_S at a time."""

    def __init__(self, seed: np.random.SeedSequence, gain: float) -> None:
        self._gain = gain
        self._rngs = [np.random.default_rng(child) for child in seed.spawn(_OCTAVES)]
        self._values: list[list[float]] = [[] for _ in self._rngs]
        self._phase = 0.0

    def next_mm(self, pupil_diameter_mm: float) -> float:
        """The diameter with its unrest; then one step on."""
        self._phase += STEP_S / pupil_diameter_mm
        noise = math.fsum(weight * self._octave(octave) for octave, weight in enumerate(_OCTAVE_WEIGHTS))
        swing = _P_MAX_MM / pupil_diameter_mm * math.sqrt(1.0 - min(pupil_diameter_mm / _P_MAX_MM, 1.0))
        return pupil_diameter_mm + self._gain * noise * swing

    def _octave(self, octave: int) -> float:
        place = math.ldexp(self._phase, octave)
        left, values = int(place), self._values[octave]
        while len(values) < left + 2:
            values.append(self._rngs[octave].uniform(-1.0, 1.0))
        between = place - left
        ease = between**2 * (3.0 - 2.0 * between)
        return values[left] * (1.0 - ease) + values[left + 1] * ease


class LivePupil:
    """Both pupils under light that is set while they live: reflex and unrest, at any rising times from 0."""

    def __init__(self, settings: SimulatedSettings, luminance_cd_m2: float, seed: np.random.SeedSequence) -> None:
        """`luminance_cd_m2`: the light that has been there for ever. `seed`: of the unrest."""
        self._reflex = LightReflex(luminance_cd_m2, settings.field_deg2, settings.age_years)
        self._hippus = Hippus(seed, settings.hippus)
        self._grid_mm: collections.deque[float] = collections.deque()
        self._first = 0
        """The step of the grid's first diameter; those before are forgotten."""

    def set_luminance(self, t_s: float, luminance_cd_m2: float) -> None:
        """The light from a time on; the pupil answers LATENCY_S later."""
        self._reflex.set_luminance(t_s, luminance_cd_m2)

    def pupil_diameters_mm(self, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """The diameters at some times, none of them before those asked for last."""
        first, last = int(t_s[0] / STEP_S), math.ceil(t_s[-1] / STEP_S)
        while self._first + len(self._grid_mm) <= last:
            self._grid_mm.append(self._hippus.next_mm(self._reflex.next_mm()))
        while self._first < first:
            self._grid_mm.popleft()
            self._first += 1
        grid_s = np.arange(self._first, self._first + len(self._grid_mm)) * STEP_S
        return np.interp(t_s, grid_s, self._grid_mm)
