"""A simulated pair of eyes that live now and answer to light that is set while they do: the twin of a live tracker.

Lids, gaze and tracker are those of eyes.py, for the same seed the same ones; the pupil takes the same light
reflex one step at a time, since nobody knows the light beforehand. Samples are made in blocks of 100 ms, less than the
reflex's latency: no light that is set after a block was made could have changed it.
"""

from __future__ import annotations

import collections
import dataclasses
import math
import time
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from entoptic.tracker_bridge.samples import NS_PER_S, Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Item, SourceError, SourceInfo, Tick
from entoptic.tracker_bridge.sources.played import ticks_until
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings
from entoptic.tracker_bridge.sources.simulated.pupil import _OCTAVES, _P_MAX_MM, STEP_S, ReflexSteps, first_step
from entoptic.tracker_bridge.sources.simulated.tracker import PX_PER_MM, measure
from entoptic.tracker_bridge.sources.simulated.truth import Truth

BLOCK_S = 0.1
"""How far samples are made ahead; under LATENCY_S, and as long as a live source may go without a Tick."""

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

    def __init__(self, settings: SimulatedSettings, hippus_seed: np.random.SeedSequence) -> None:
        self._reflex = LightReflex(settings.luminance[0][1], settings.field_deg2, settings.age_years)
        self._hippus = Hippus(hippus_seed, settings.hippus)
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


class SimulatedLiveEyes:
    """A live source of simulated samples, by the clock for `settings.seconds`; `set_luminance` is its light.

    With `paced=False` it is as fast as it is read and its times run from 0: a simulation of a live source, for tests
    and for whoever cannot wait. Raises SourceError that names the setting that is out of range.
    """

    def __init__(self, settings: SimulatedSettings, *, paced: bool = True) -> None:
        refuse_schedule(settings)
        drawn = SimulatedEyes(settings)
        self.settings = settings
        self._paced = paced
        self._drawn: Truth = drawn.truth
        self._pupil_diameter_mm = np.full(self._drawn.t_ns.size, math.nan)
        self._lived = 0
        hippus_seed, noise_seed = live_seeds(settings.seed)
        self._pupil = LivePupil(settings, hippus_seed)
        self._noise_rng = np.random.default_rng(noise_seed)
        self._start_ns = time.monotonic_ns() if paced else 0
        self._info = SourceInfo(
            name=f"Simulated eyes {settings.seed}, live",
            t_start_ns=self._start_ns,
            t_end_ns=self._start_ns + int(self._drawn.t_ns[-1]),
            notes=("Nobody's eyes: every sample is computed.",),
            live=paced,
        )

    @property
    def info(self) -> SourceInfo:
        """What this source is."""
        return self._info

    @property
    def truth(self) -> Truth:
        """What the eyes have done so far, labelled; its times run from 0 at `info.t_start_ns`."""
        lived = slice(self._lived)
        until_ns = int(self._drawn.t_ns[self._lived - 1]) if self._lived else -1
        return dataclasses.replace(
            slice_of(self._drawn, lived, self._pupil_diameter_mm[lived]),
            events=tuple(event for event in self._drawn.events if event.offset_ns <= until_ns),
        )

    def set_luminance(self, luminance_cd_m2: float, t_ns: int) -> None:
        """The light before the eyes from a time of this source on, cd/m²; the pupil answers 0.2 s later."""
        self._pupil.set_luminance((t_ns - self._start_ns) / NS_PER_S, luminance_cd_m2)

    def samples(self) -> Iterator[Item]:
        """Samples as they are measured: at each time both pupils, then the direction of each eye and of both."""
        block = max(round(BLOCK_S * self.settings.rate_hz), 1)
        while self._lived < self._drawn.t_ns.size:
            groups = self._live(slice(self._lived, self._lived + block))
            for group in groups:
                if self._paced:
                    yield from ticks_until(group[0].t_ns)
                yield from group
            yield Tick(groups[-1][0].t_ns)

    def _live(self, part: slice) -> list[list[PupilSample | GazeSample]]:
        """The samples of some times, a list for each."""
        times = self._drawn.t_ns[part]
        pupil_diameter_mm = self._pupil.pupil_diameters_mm(times / NS_PER_S)
        self._pupil_diameter_mm[part] = pupil_diameter_mm
        self._lived += times.size
        drawn = slice_of(self._drawn, part, pupil_diameter_mm)
        return measured_groups(self._noise_rng, drawn, self.settings, (times + self._start_ns).tolist())


def refuse_schedule(settings: SimulatedSettings) -> None:
    """Raises SourceError where light is known beforehand."""
    if len(settings.luminance) != 1:
        raise SourceError("live simulated eyes take one luminance at the start; set the others while they live")


def live_seeds(seed: int) -> tuple[np.random.SeedSequence, np.random.SeedSequence]:
    """Of the pupil's unrest and the tracker's noise, apart from the five streams that SimulatedEyes draws."""
    hippus_seed, noise_seed = np.random.SeedSequence(seed).spawn(7)[5:]
    return hippus_seed, noise_seed


def slice_of(drawn: Truth, part: slice, pupil_diameter_mm: NDArray[np.float64]) -> Truth:
    """Some times of what was drawn, with other pupils."""
    return Truth(
        drawn.events,
        drawn.t_ns[part],
        drawn.azimuth_deg[:, part],
        drawn.elevation_deg[:, part],
        pupil_diameter_mm,
        drawn.openness[part],
    )


def measured_groups(
    rng: np.random.Generator, drawn: Truth, settings: SimulatedSettings, times_ns: list[int]
) -> list[list[PupilSample | GazeSample]]:
    """What a tracker measures, the samples of each time: both pupils, then the direction of each eye and of both."""
    m = measure(rng, drawn, settings.noise_deg, settings.diameter_noise_mm)
    px = np.maximum(m.pupil_diameter_mm, 0.0) * PX_PER_MM
    pupils = np.stack([m.pupil_diameter_mm, m.confidence, m.model_confidence, px, m.openness], axis=-1).tolist()
    gazes = np.stack([m.azimuth_deg, m.elevation_deg, m.confidence], axis=-1)
    each, both = gazes.tolist(), gazes.mean(axis=0).tolist()
    return [
        [
            *(PupilSample(t_ns, eye, *pupils[eye][at]) for eye in Eye),
            *(GazeSample(t_ns, eye, *each[eye][at]) for eye in Eye),
            GazeSample(t_ns, None, *both[at]),
        ]
        for at, t_ns in enumerate(times_ns)
    ]
