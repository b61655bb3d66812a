"""Simulated eyes that live now, before a light that is set while they do: the twin of a live tracker.

Lids, gaze and tracker are those of eyes.py, for the same seed the same ones; the pupil takes the same light reflex one
step at a time (live_pupil.py). Samples are made in blocks of 100 ms, less than the reflex's latency: no light that is
set after a block was made could have changed it.

By the clock they have no end. They are drawn a stretch at a time, each with a seed of its own, which takes 20 ms. At
the end of a stretch they blink, and behind the lid they look where the next one begins. What eyes and lids do depends
on the time since they began alone: if they are started again they go on where they would be. The pupil starts from the
light that is set until then.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator

import numpy as np
from msgspec.structs import replace

from entoptic.tracker_bridge.events import ClockEstimated
from entoptic.tracker_bridge.samples import NS_PER_S
from entoptic.tracker_bridge.source import Item, SourceError, SourceInfo, Tick
from entoptic.tracker_bridge.sources.played import ticks_until
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings
from entoptic.tracker_bridge.sources.simulated.lid import Blink, openness_at
from entoptic.tracker_bridge.sources.simulated.live_pupil import LivePupil
from entoptic.tracker_bridge.sources.simulated.tracker import measure, samples_of
from entoptic.tracker_bridge.sources.simulated.truth import Truth

BLOCK_S = 0.1
"""How far samples are made ahead; under LATENCY_S, and as long as a live source may go without a Tick."""
STRETCH_S = 20
"""Whole seconds. Engineering choice: three more blinks a minute than drawn, and none that is late for its drawing."""
BLINK_S, BEFORE_S = 0.36, 0.13
"""A blink, and how much of it lies before the border between two stretches, where the lid is shut."""
SEEDS = 2**32
SEED_STEP = 7919
"""From one stretch's seed to the next one's: so that neighbouring seeds are not the same person later."""


class LiveEyes:
    """A live source of simulated samples, by the clock; `set_luminance` is its light.

    `begun_ns` is its time zero on the monotonic clock, and `settings.seconds` is not heeded. Without it the eyes are a
    simulation of a live source for whoever cannot wait: as fast as they are read, for `settings.seconds`, from 0 on.
    Raises SourceError that names the setting that is out of range.
    """

    def __init__(self, settings: SimulatedSettings, begun_ns: int | None = None) -> None:
        if len(settings.luminance) != 1:
            raise SourceError("live simulated eyes take one luminance at the start; set the others while they live")
        self._by_clock = begun_ns is not None
        self.settings = replace(settings, seconds=float(STRETCH_S)) if self._by_clock else settings
        self._begun_ns = begun_ns or 0
        self._joined_ns: int | None = None
        """The pupil's time zero: when samples were first asked for."""
        self._pupil = LivePupil(settings, settings.luminance[0][1], _seeds(settings)[0])
        self._noise_rng = np.random.default_rng(_seeds(settings)[1])
        self._drawn(0)  # what it imports takes seconds, which samples that are asked for do not have
        self._info = SourceInfo(
            name=f"Simulated eyes {settings.seed}, live",
            t_start_ns=self._begun_ns,
            t_end_ns=None if self._by_clock else round(settings.seconds * NS_PER_S),
            notes=("Nobody's eyes: every sample is computed.",),
            live=self._by_clock,
        )

    @property
    def info(self) -> SourceInfo:
        """What this source is."""
        return self._info

    def set_luminance(self, luminance_cd_m2: float, t_ns: int) -> None:
        """The light before the eyes from a time of this source on, cd/m²; the pupil answers 0.2 s later.

        Before samples are asked for: the light that has been there for ever.
        """
        if self._joined_ns is None:
            self._pupil = LivePupil(self.settings, luminance_cd_m2, _seeds(self.settings)[0])
        else:
            self._pupil.set_luminance((t_ns - self._joined_ns) / NS_PER_S, luminance_cd_m2)

    def samples(self) -> Iterator[Item]:
        """Samples as they are measured, from now on: at each time both pupils, then the directions of each and both."""
        block = max(round(BLOCK_S * self.settings.rate_hz), 1)
        now_ns = time.monotonic_ns() if self._by_clock else 0
        self._joined_ns = joined_ns = max(now_ns, self._begun_ns)
        if self._by_clock:
            yield ClockEstimated(now_ns, self._begun_ns, 0.0, 0)
        first = (joined_ns - self._begun_ns) // (STRETCH_S * NS_PER_S)
        for number in itertools.count(first) if self._by_clock else (0,):
            drawn = self._drawn(number)
            times_ns = drawn.t_ns + (self._begun_ns + number * STRETCH_S * NS_PER_S)
            for start in range(int(np.searchsorted(times_ns, now_ns)), times_ns.size, block):
                part = slice(start, start + block)
                pupil_diameters_mm = self._pupil.pupil_diameters_mm(
                    np.maximum(times_ns[part] - joined_ns, 0) / NS_PER_S
                )
                truth = drawn.part(part, pupil_diameters_mm)
                measured = measure(self._noise_rng, truth, self.settings.noise_deg, self.settings.diameter_noise_mm)
                for group in samples_of(measured, times_ns[part].tolist()):
                    if self._by_clock:
                        yield from ticks_until(group[0].t_ns)
                    yield from group
                yield Tick(int(times_ns[part][-1]))

    def _drawn(self, number: int) -> Truth:
        """A stretch, its times from 0 on, with the blinks at its ends."""
        seed = (self.settings.seed + number * SEED_STEP) % SEEDS
        drawn = SimulatedEyes(replace(self.settings, seed=seed)).truth
        if self._by_clock and self.settings.blinks_per_minute > 0.0:
            t_s = drawn.t_ns / NS_PER_S
            blinks = [Blink(STRETCH_S - BEFORE_S, BLINK_S)]
            if number > 0:
                blinks.insert(0, Blink(-BEFORE_S, BLINK_S))
            np.minimum(drawn.openness, openness_at(t_s, blinks), out=drawn.openness)
        return drawn


def _seeds(settings: SimulatedSettings) -> list[np.random.SeedSequence]:
    """Of the pupil's unrest and the tracker's noise, apart from the five streams that SimulatedEyes draws."""
    return np.random.SeedSequence(settings.seed).spawn(7)[5:]
