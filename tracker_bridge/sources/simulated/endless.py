"""Simulated eyes for live sessions: without an end, before a light that is set while they live.

They are drawn a stretch at a time, each with a seed of its own, which takes 20 ms. At the end of a stretch they blink,
and behind the lid they look where the next one begins. What eyes and lids do depends on the time since they began
alone: if they are started again they go on where they would be. The pupil starts from the light that is set until then.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator

import msgspec
import numpy as np
from numpy.typing import NDArray

from entoptic.tracker_bridge.events import ClockEstimated
from entoptic.tracker_bridge.samples import NS_PER_S, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Item, SourceInfo, Tick
from entoptic.tracker_bridge.sources.played import ticks_until
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings
from entoptic.tracker_bridge.sources.simulated.lid import Blink, openness_at
from entoptic.tracker_bridge.sources.simulated.live import (
    BLOCK_S,
    LivePupil,
    live_seeds,
    measured_groups,
    refuse_schedule,
    slice_of,
)
from entoptic.tracker_bridge.sources.simulated.truth import Truth

STRETCH_S = 20
"""Whole seconds. Engineering choice: three more blinks a minute than drawn, and none that is late for its drawing."""
BLINK_S, BEFORE_S = 0.36, 0.13
"""A blink, and how much of it lies before the border between two stretches, where the lid is shut."""
SEEDS = 2**32
SEED_STEP = 7919
"""From one stretch's seed to the next one's: so that neighbouring seeds are not the same person later."""


class EndlessEyes:
    """A live source of simulated samples, by the clock; `set_luminance` is its light.

    `begun_ns` is its time zero on the monotonic clock; `settings.seconds` is not heeded. Raises SourceError that names
    the setting that is out of range.
    """

    def __init__(self, settings: SimulatedSettings, begun_ns: int) -> None:
        refuse_schedule(settings)
        self.settings = msgspec.structs.replace(settings, seconds=float(STRETCH_S))
        self._begun_ns = begun_ns
        self._joined_ns: int | None = None
        """The pupil's time zero: when samples were first asked for."""
        self._pupil = self._pupil_in(settings.luminance[0][1])
        self._noise_rng = np.random.default_rng(live_seeds(settings.seed)[1])
        self._drawn(0)  # what it imports takes seconds, which samples that are asked for do not have
        self._info = SourceInfo(
            name=f"Simulated eyes {settings.seed}, live",
            t_start_ns=begun_ns,
            t_end_ns=None,
            notes=("Nobody's eyes: every sample is computed.",),
            live=True,
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
            self._pupil = self._pupil_in(luminance_cd_m2)
        else:
            self._pupil.set_luminance((t_ns - self._joined_ns) / NS_PER_S, luminance_cd_m2)

    def _pupil_in(self, luminance_cd_m2: float) -> LivePupil:
        lit = msgspec.structs.replace(self.settings, luminance=((0.0, luminance_cd_m2),))
        return LivePupil(lit, live_seeds(self.settings.seed)[0])

    def samples(self) -> Iterator[Item]:
        """Samples as they are measured, from now on."""
        block = max(round(BLOCK_S * self.settings.rate_hz), 1)
        now_ns = time.monotonic_ns()
        self._joined_ns = joined_ns = max(now_ns, self._begun_ns)
        yield ClockEstimated(now_ns, self._begun_ns, 0.0, 0)
        for number in itertools.count((joined_ns - self._begun_ns) // (STRETCH_S * NS_PER_S)):
            stretch = self._drawn(number)
            times_ns = stretch.t_ns + (self._begun_ns + number * STRETCH_S * NS_PER_S)
            for start in range(int(np.searchsorted(times_ns, now_ns)), times_ns.size, block):
                groups = self._live(stretch, slice(start, start + block), times_ns, joined_ns)
                for group in groups:
                    yield from ticks_until(group[0].t_ns)
                    yield from group
                yield Tick(groups[-1][0].t_ns)

    def _live(
        self, stretch: Truth, part: slice, times_ns: NDArray[np.int64], joined_ns: int
    ) -> list[list[PupilSample | GazeSample]]:
        pupil_diameters_mm = self._pupil.pupil_diameters_mm(np.maximum(times_ns[part] - joined_ns, 0) / NS_PER_S)
        drawn = slice_of(stretch, part, pupil_diameters_mm)
        return measured_groups(self._noise_rng, drawn, self.settings, times_ns[part].tolist())

    def _drawn(self, number: int) -> Truth:
        """A stretch, its times from 0 on, with the blinks at its ends."""
        seed = (self.settings.seed + number * SEED_STEP) % SEEDS
        drawn = SimulatedEyes(msgspec.structs.replace(self.settings, seed=seed)).truth
        if self.settings.blinks_per_minute > 0.0:
            t_s = drawn.t_ns / NS_PER_S
            blinks = [Blink(STRETCH_S - BEFORE_S, BLINK_S)]
            if number > 0:
                blinks.insert(0, Blink(-BEFORE_S, BLINK_S))
            np.minimum(drawn.openness, openness_at(t_s, blinks), out=drawn.openness)
        return drawn
