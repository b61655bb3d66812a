"""From a source's items to states and events: pure, in order, and never later than it must be.

Theory of operation: samples of one time, following one another, make one state, as soon as the next item shows that
they are all there; a live source shows it by a tick. Each eye and kind of sample goes forwards in time by itself: what
comes late, twice or backwards, or from the future, is left out and counted. A pupil never holds up a gaze.
"""

from __future__ import annotations

import collections
import dataclasses
import statistics
from collections.abc import Iterable, Iterator

from entoptic.described import DescribedEnum
from entoptic.tracker_bridge.dropout import DropoutFilter, Shown, slewed_mm
from entoptic.tracker_bridge.events import (
    ClockEstimated,
    ClockJumped,
    Event,
    SourceSilent,
)
from entoptic.tracker_bridge.fixed_lag import FixedLagSmoother
from entoptic.tracker_bridge.microsaccades import COVERED, MIN_CONFIDENCE, SaccadeDetector
from entoptic.tracker_bridge.pupil_map import PupilMap
from entoptic.tracker_bridge.samples import Direction, Eye, EyeState, GazeSample, OneEyeState, Phase, PupilSample
from entoptic.tracker_bridge.source import Item, Tick
from entoptic.tracker_bridge.trust import DIAMETER_RANGE_MM

SAME_TIME_NS = 50_000_000
"""Two eyes' samples within it count as of one moment: a tracker at 30 Hz takes its eyes 33 ms apart at most."""
PATIENCE_NS = 250_000_000
"""How far a sample may lie behind the newest, or behind the time; silence counts from then on, and what comes later is
left out. Engineering choice: half of what makes a pupil lost. Older than that, a gaze is no use to any display."""
FUTURE_NS = 1_000_000_000
"""No clock is that wrong: a sample from further ahead has a broken time, and would make all others look late."""
DIFFERENCE_COUNT = 1000
"""Samples behind the usual difference between both pupils: its median over the last 5 s at 200 Hz."""


@dataclasses.dataclass
class _EyeMemory:
    filter: DropoutFilter = dataclasses.field(default_factory=DropoutFilter)
    shown: Shown | None = None
    sample: PupilSample | None = None
    gaze: Direction | None = None
    lent: tuple[int, float] | None = None
    """What of the other eye's pupil was shown in this one's stead, mm, and when; None where this one's own was."""

    def state(self, borrowed_mm: float | None) -> OneEyeState:
        if self.sample is None or self.shown is None:
            return OneEyeState(Phase.LOST, borrowed_mm, None, 0.0, None, self.gaze, borrowed=borrowed_mm is not None)
        borrows = borrowed_mm is not None
        return OneEyeState(
            phase=self.shown.phase,
            pupil_diameter_mm=borrowed_mm if borrows else self.shown.pupil_diameter_mm,
            measured_mm=self.sample.pupil_diameter_mm,
            confidence=self.sample.confidence,
            openness=self.shown.openness,
            gaze=self.gaze,
            t_ns=self.sample.t_ns,
            borrowed=borrows,
        )


class LatencyMode(DescribedEnum):
    """When states leave."""

    LIVE = "live", "At once."
    RECORDING = "recording", "After a fixed lag, with what came after them taken into account; see fixed_lag.py    ."


class Chain:
    """Samples in, states and events out. Latency: in the live mode none, but for waiting until a moment is whole."""

    def __init__(
        self, *, live: bool = False, latency_mode: LatencyMode = LatencyMode.LIVE, pupil_map: PupilMap | None = None
    ) -> None:
        """`live`: the source's ticks tell the time. `pupil_map`: what diameters mean, from a calibration."""
        self._live = live
        self._smoother = FixedLagSmoother() if latency_mode is LatencyMode.RECORDING else None
        self._pupil_map = pupil_map
        self._eyes = {eye: _EyeMemory() for eye in Eye}
        self._differences_mm: collections.deque[float] = collections.deque(maxlen=DIFFERENCE_COUNT)
        self._saccades = SaccadeDetector()
        self._both: Direction | None = None
        self._given_both: Direction | None = None
        self._uncertainty_ns: int | None = None if live else 0
        self._newest_ns: dict[tuple[type, Eye | None], int] = {}
        self._t_ns: int | None = None
        self._now_ns: int | None = None
        self._latest_ns: int | None = None
        self._moment_ns: int | None = None
        self._sequence = 0
        self.late_count = 0
        """Samples that came too late, twice, backwards or from the future, and were left out."""

    def use(self, pupil_map: PupilMap) -> None:
        """Takes diameters for what this map says, from the next item on."""
        if "px" in {each.unit for each in (self._pupil_map, pupil_map) if each is not None}:
            # The filters see other millimetres from now on, and would take the change for a lid.
            for memory in self._eyes.values():
                memory.filter, memory.lent = DropoutFilter(), None
            self._differences_mm.clear()
        self._pupil_map = pupil_map

    def step(self, item: Item) -> Iterator[EyeState | Event]:
        """What one more item makes: the state of the moment that it ends, and its events."""
        for record in self._step(item):
            yield from self._leave(record)
        if isinstance(item, Tick) and self._smoother is not None and self._now_ns is not None:
            for state in self._smoother.tick(self._now_ns - PATIENCE_NS):
                yield self._mapped(state)

    def flush(self) -> Iterator[EyeState | Event]:
        """What is still to leave at the end of a stream."""
        for record in self._end_moment():
            yield from self._leave(record)
        if self._smoother is not None:
            for state in self._smoother.flush():
                yield self._mapped(state)

    def _leave(self, record: EyeState | Event) -> Iterator[EyeState | Event]:
        """Through the smoother and the map. Events never wait."""
        if not isinstance(record, EyeState):
            yield record
        elif self._smoother is None:
            yield self._mapped(record)
        else:
            for state in self._smoother.step(record):
                yield self._mapped(state)

    def _mapped(self, state: EyeState) -> EyeState:
        return state if self._pupil_map is None else self._pupil_map.map_state(state)

    def _step(self, item: Item) -> Iterator[EyeState | Event]:
        if isinstance(item, PupilSample | GazeSample):
            if not self._in_time(item):
                self.late_count += 1
                return
            if item.t_ns != self._moment_ns:
                yield from self._end_moment()
                self._moment_ns = item.t_ns
            yield from self._pupil(item) if isinstance(item, PupilSample) else self._gaze(item)
            return
        yield from self._end_moment()
        if isinstance(item, Tick):
            yield from self._tick(item.t_ns)
            return
        if isinstance(item, ClockEstimated):
            self._uncertainty_ns = item.uncertainty_ns
        elif isinstance(item, ClockJumped | SourceSilent):
            self._uncertainty_ns = None
        yield item

    def _end_moment(self) -> Iterator[EyeState | Event]:
        """The state of the moment so far, if it has any sample."""
        if self._moment_ns is not None:
            moment_ns, self._moment_ns = self._moment_ns, None
            yield from self._silence(moment_ns - PATIENCE_NS)
            yield self._state(moment_ns)

    def _in_time(self, sample: PupilSample | GazeSample) -> bool:
        t_ns, kind = sample.t_ns, (type(sample), sample.eye)
        if self._latest_ns is not None and t_ns < self._latest_ns - PATIENCE_NS:
            return False
        # Between two ticks samples alone show how time passes.
        if self._now_ns is not None and self._latest_ns is not None and t_ns > self._latest_ns + FUTURE_NS:
            return False
        if t_ns <= self._newest_ns.get(kind, t_ns - 1):
            return False
        self._newest_ns[kind] = t_ns
        self._latest_ns = t_ns if self._latest_ns is None else max(t_ns, self._latest_ns)
        return True

    def _pupil(self, sample: PupilSample) -> Iterator[Event]:
        memory = self._eyes[sample.eye]
        sample = sample if self._pupil_map is None else self._pupil_map.apply(sample)
        if memory.lent is not None:
            memory.filter.has_shown(*memory.lent)
        memory.sample, memory.shown = sample, memory.filter.step(sample)
        self._compare(sample.eye)
        yield from memory.shown.events
        if memory.shown.phase in COVERED:
            yield from self._saccades.blind(sample.t_ns, sample.eye)

    def _gaze(self, sample: GazeSample) -> Iterator[Event]:
        yield from self._saccades.step(sample)
        if sample.confidence < MIN_CONFIDENCE:
            return
        direction = Direction(sample.azimuth_deg, sample.elevation_deg, sample.t_ns)
        if sample.eye is None:
            self._given_both = direction
        else:
            self._eyes[sample.eye].gaze = direction

    def _tick(self, now_ns: int) -> Iterator[EyeState | Event]:
        """Time without samples. A recording has none: its time is that of its samples."""
        if not self._live:
            return
        self._now_ns = now_ns if self._now_ns is None else max(now_ns, self._now_ns)
        self._latest_ns = self._now_ns if self._latest_ns is None else max(self._now_ns, self._latest_ns)
        phases = [memory.shown and memory.shown.phase for memory in self._eyes.values()]
        yield from self._silence(self._now_ns - PATIENCE_NS)
        if phases != [memory.shown and memory.shown.phase for memory in self._eyes.values()]:
            yield self._state(self._now_ns - PATIENCE_NS)

    def _silence(self, until_ns: int) -> Iterator[Event]:
        """Tells eyes that no sample came until then, and none is still on its way."""
        yield from self._saccades.tick(until_ns)
        for memory in self._eyes.values():
            if memory.sample is not None and memory.sample.t_ns < until_ns:
                shown = memory.filter.tick(until_ns)
                if shown is not None:
                    memory.shown = shown
                    yield from shown.events

    def _compare(self, eye: Eye) -> None:
        """Learns the usual difference between the pupils, right less left, while both are tracked."""
        if eye is not Eye.LEFT:
            return
        right, left = self._eyes[Eye.RIGHT].shown, self._eyes[Eye.LEFT].shown
        if right is None or left is None or not right.phase is left.phase is Phase.TRACKING:
            return
        if right.pupil_diameter_mm is not None and left.pupil_diameter_mm is not None:
            self._differences_mm.append(right.pupil_diameter_mm - left.pupil_diameter_mm)

    def _borrowed_mm(self, eye: Eye) -> float | None:
        """What a lost eye shows: both irises are driven alike, so the other pupil is the best guess there is."""
        own, other = self._eyes[eye].shown, self._eyes[Eye(1 - eye)].shown
        if (own is not None and own.phase is not Phase.LOST) or other is None or other.phase is Phase.LOST:
            return None
        if other.pupil_diameter_mm is None:
            return None
        difference_mm = statistics.median(self._differences_mm) if self._differences_mm else 0.0
        low_mm, high_mm = DIAMETER_RANGE_MM
        return min(
            max(other.pupil_diameter_mm + (difference_mm if eye is Eye.RIGHT else -difference_mm), low_mm), high_mm
        )

    def _lend(self, eye: Eye, t_ns: int) -> float | None:
        """What a lost eye shows of the other's pupil at t_ns: a jump there would flicker."""
        memory, target_mm = self._eyes[eye], self._borrowed_mm(eye)
        if target_mm is None:
            memory.lent = None
            return None
        before = memory.lent
        if before is None and memory.shown is not None and memory.shown.pupil_diameter_mm is not None:
            before = memory.shown.t_ns, memory.shown.pupil_diameter_mm
        if before is not None:
            target_mm = slewed_mm(before, t_ns, target_mm)
        memory.lent = t_ns, target_mm
        return target_mm

    def _state(self, t_ns: int) -> EyeState:
        self._t_ns = t_ns = t_ns if self._t_ns is None else max(t_ns, self._t_ns)
        self._look(t_ns)
        right = self._eyes[Eye.RIGHT].state(self._lend(Eye.RIGHT, t_ns))
        left = self._eyes[Eye.LEFT].state(self._lend(Eye.LEFT, t_ns))
        state = EyeState(self._sequence, t_ns, right, left, self._both, self._uncertainty_ns)
        self._sequence += 1
        return state

    def _look(self, t_ns: int) -> None:
        """Where both eyes look: as the source gives it; while it sees one eye alone, where that one looks."""
        newest = given = self._given_both
        if given is None or t_ns - given.t_ns > SAME_TIME_NS:
            mean = self._mean_direction(t_ns)
            if mean is not None and (given is None or mean.t_ns - given.t_ns > SAME_TIME_NS):
                newest = mean
        if newest is not None and (self._both is None or newest.t_ns >= self._both.t_ns):
            self._both = newest

    def _mean_direction(self, t_ns: int) -> Direction | None:
        """The mean of the eyes lately seen."""
        directions = [memory.gaze for memory in self._eyes.values() if memory.gaze is not None]
        fresh = [direction for direction in directions if t_ns - direction.t_ns <= SAME_TIME_NS]
        if not fresh:
            return None
        return Direction(
            sum(direction.azimuth_deg for direction in fresh) / len(fresh),
            sum(direction.elevation_deg for direction in fresh) / len(fresh),
            max(direction.t_ns for direction in fresh),
        )


def records_of(items: Iterable[Item], chain: Chain | None = None) -> Iterator[EyeState | Event]:
    """All states and events of a source's items, in order; the same to the bit each time."""
    chain = chain or Chain()
    for item in items:
        yield from chain.step(item)
    yield from chain.flush()
