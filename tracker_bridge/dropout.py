"""The live mode: what to show of one pupil, sample by sample, and when it blinked, fell out, or was lost.

Theory of operation: trust.py judges each sample. When a pupil is no longer whole, the diameter held is the one from
before a lid came into play (rolled back), not the last one; when it comes back, the first samples still show the lid
and are passed over until it has been whole for a while; dropout_interval.py says what the time between is.

Latency: none; no sample is delayed. The price is the roll-back at onset, at most one speed window late. Events carry
the right times but are told later: BlinkOnset up to interval.MIN_COVER_NS and a sample after the pupil has gone,
BlinkOffset when the pupil is trusted again, and both together where a lid left the pupil to see (lids.py), when it
is up again. In silence time passes by `tick`, or else with the next sample.
"""

from __future__ import annotations

import collections
import dataclasses
import statistics

from entoptic.tracker_bridge.dropout_interval import LOST_AFTER_NS, DropoutInterval, Lids
from entoptic.tracker_bridge.events import BlinkOffset, BlinkOnset, Event, PupilBack, PupilLost
from entoptic.tracker_bridge.extrapolation import BASELINE_NS, Extrapolation
from entoptic.tracker_bridge.lids import LidDips, estimated_openness
from entoptic.tracker_bridge.samples import Eye, Phase, PupilSample
from entoptic.tracker_bridge.trust import DIAMETER_RANGE_MM, Gate, Measure, Sight

ROLL_BACK_NS = 50_000_000
"""How far before the first mistrusted sample the held diameter is taken from. Engineering choice: the gate sees a lid
up to one speed window, 25 ms, after it has touched the pupil."""
SILENT_AFTER_NS = 100_000_000
"""Without any sample for so long a pupil has dropped out. Engineering choice: three samples at 30 Hz."""
TOUCHED_SHARE = 0.97
"""Walking back from the first mistrusted sample, the lid came when the pupil was last at this share of what is held.
Engineering choice: above the noise of a good tracker."""
SLEW_MM_S = 10.0
"""How fast the shown diameter moves back to the measured one after a blink: a jump would flicker. Engineering choice:
faster than the iris, slower than the eye notices."""


@dataclasses.dataclass(frozen=True, slots=True)
class Shown:
    """What one sample, or time that passed without one, makes of one eye."""

    phase: Phase
    pupil_diameter_mm: float | None
    """The diameter to render with; None until one was trusted, and for ever where the source has no millimetres."""
    events: tuple[Event, ...]
    t_ns: int
    """When it is so."""
    openness: float | None
    """0 … 1: as the source gave it, or else estimated from the pupil; None where neither can be."""


class DropoutFilter:
    """The filter of one eye: feed it that eye's samples in the order of their time."""

    def __init__(self) -> None:
        self._gate = Gate()
        self._lids = Lids()
        self._dips = LidDips()
        self._last_offset_ns: int | None = None
        self._trusted: collections.deque[tuple[int, float]] = collections.deque()
        self._phase = Phase.LOST
        self._interval: DropoutInterval | None = None
        self._shown: tuple[int, float] | None = None
        self._catching_up = False
        self._newest: PupilSample | None = None
        self._sample_periods_ns: collections.deque[int] = collections.deque(maxlen=5)
        self._seen = False

    def step(self, sample: PupilSample) -> Shown:
        """The state after one more sample."""
        t_ns = sample.t_ns
        events = self._pass_time(t_ns)
        if self._newest is not None:
            self._sample_periods_ns.append(t_ns - self._newest.t_ns)
        self._newest = sample
        measure = self._gate.measure
        sight, size = self._gate.judge(sample)
        if self._gate.measure > measure:
            # Millimetres after pixels, or the first diameter at all: what was held means nothing now.
            self._trusted.clear()
            if self._interval is not None:
                self._interval.extrapolation = None
        closed = self._lids.closed(sample.openness)
        if closed:
            sight, size = Sight.HIDDEN, None
        if self._interval is None and sight is not Sight.STEADY:
            self._interval = self._begin_interval(t_ns, ROLL_BACK_NS)
        if self._interval is not None:
            self._interval.add(sample, sight, size, closed, self._sample_period_ns())
            if not self._interval.is_over(t_ns):
                events += self._dipped(sample)
                events += self._report(self._interval, sample.eye, t_ns)
                self._phase = self._interval.phase(sight) if self._seen else Phase.LOST
                return self._as_shown(t_ns, events, sample.openness, size)
            events += self._end_interval(self._interval, sample)
        events += self._dipped(sample)
        self._trust(t_ns, size)
        return self._as_shown(t_ns, events, sample.openness, size)

    def tick(self, t_ns: int) -> Shown | None:
        """The state when no sample came until t_ns; None where that changes nothing."""
        before = self._phase
        events = self._pass_time(t_ns)
        return self._as_shown(t_ns, events, None, None) if events or self._phase is not before else None

    def has_shown(self, t_ns: int, pupil_diameter_mm: float) -> None:
        """Another diameter was shown instead while the pupil was lost: its own goes on from there."""
        self._shown, self._catching_up = (t_ns, pupil_diameter_mm), True

    def _pass_time(self, t_ns: int) -> list[Event]:
        """What silence up to t_ns makes of the pupil."""
        if self._newest is None or t_ns - self._newest.t_ns < SILENT_AFTER_NS:
            return []
        if self._interval is None:
            self._interval = self._begin_interval(self._newest.t_ns, 0)
        self._interval.fall_silent()
        events = self._report(self._interval, self._newest.eye, t_ns)
        self._phase = self._interval.phase(Sight.HIDDEN) if self._seen else Phase.LOST
        return events

    def _sample_period_ns(self) -> int:
        """The source's usual one; its median, since a sample may be missing."""
        return statistics.median_low(self._sample_periods_ns) if self._sample_periods_ns else 0

    def _begin_interval(self, t_ns: int, roll_back_ns: int) -> DropoutInterval:
        before = [(when_ns, size) for when_ns, size in self._trusted if when_ns <= t_ns - roll_back_ns]
        extrapolation = Extrapolation(before or [self._trusted[0]]) if self._trusted else None
        onset_ns = t_ns
        for when_ns, size in reversed(self._trusted):
            if extrapolation is None or size >= TOUCHED_SHARE * extrapolation.at(when_ns):
                break
            onset_ns = when_ns
        # A pupil that was never seen cannot be lost.
        return DropoutInterval(t_ns, onset_ns, extrapolation, lost=not self._seen)

    def _report(self, interval: DropoutInterval, eye: Eye, t_ns: int) -> list[Event]:
        """What of a dropout interval has to be told by t_ns and was not yet."""
        events: list[Event] = []
        if interval.blink and not interval.blink_reported and self._seen:
            interval.blink_reported = True
            events.append(BlinkOnset(interval.onset_ns, eye))
        if not interval.lost and t_ns - interval.since_ns >= LOST_AFTER_NS:
            interval.lost = True
            events.append(PupilLost(interval.since_ns + LOST_AFTER_NS, eye))
        return events

    def _dipped(self, sample: PupilSample) -> list[Event]:
        """A blink that left the pupil to see, and is over."""
        dip = None if sample.openness is None else self._dips.add(sample.t_ns, sample.openness)
        if dip is None or not self._seen or (self._interval is not None and self._interval.blink):
            return []
        onset_ns, end_ns = dip
        if self._last_offset_ns is not None and onset_ns <= self._last_offset_ns:
            return []
        self._last_offset_ns = end_ns
        if self._interval is not None:
            self._interval.onset_ns = max(self._interval.onset_ns, end_ns)
        return [BlinkOnset(onset_ns, sample.eye), BlinkOffset(end_ns, sample.eye, end_ns - onset_ns)]

    def _end_interval(self, interval: DropoutInterval, sample: PupilSample) -> list[Event]:
        events: list[Event] = []
        if interval.blink_reported:
            self._last_offset_ns = sample.t_ns
            events.append(BlinkOffset(sample.t_ns, sample.eye, sample.t_ns - interval.onset_ns))
        if interval.lost and self._seen:
            events.append(PupilBack(sample.t_ns, sample.eye))
        self._interval = None
        self._trusted.clear()
        self._catching_up = True
        return events

    def _trust(self, t_ns: int, size: float | None) -> None:
        self._phase = Phase.TRACKING
        self._seen = True
        if size is not None:
            while self._trusted and self._trusted[0][0] < t_ns - ROLL_BACK_NS - BASELINE_NS:
                self._trusted.popleft()
            self._trusted.append((t_ns, size))

    def _as_shown(self, t_ns: int, events: list[Event], openness: float | None, size: float | None) -> Shown:
        if openness is None:
            openness = self._estimated_openness(t_ns, size)
        return Shown(self._phase, self._pupil_diameter_mm(t_ns), tuple(events), t_ns, openness)

    def _estimated_openness(self, t_ns: int, size: float | None) -> float | None:
        if self._interval is None:
            return 1.0 if self._phase is Phase.TRACKING else None
        if not self._interval.lid or not self._seen:
            return None
        if size is None or self._interval.extrapolation is None:
            return 0.0
        whole = self._interval.extrapolation.at(t_ns)
        return estimated_openness(size / whole, whole if self._gate.measure is Measure.MM else None)

    def _pupil_diameter_mm(self, t_ns: int) -> float | None:
        """The diameter measured or supposed, reached at no more than SLEW_MM_S where it would jump."""
        if self._gate.measure is not Measure.MM:
            return None
        if self._interval is None:
            target_mm: float | None = self._trusted[-1][1]
        elif self._interval.extrapolation is not None:
            low_mm, high_mm = DIAMETER_RANGE_MM
            target_mm = min(max(self._interval.extrapolation.at(t_ns), low_mm), high_mm)
        else:
            target_mm = None
        if target_mm is not None and self._shown is not None and (self._catching_up or self._interval is not None):
            reached_mm = slewed_mm(self._shown, t_ns, target_mm)
            self._catching_up, target_mm = reached_mm != target_mm, reached_mm
        if target_mm is not None:
            self._shown = (t_ns, target_mm)
        return target_mm


def slewed_mm(shown: tuple[int, float], t_ns: int, target_mm: float) -> float:
    """How near a diameter that was shown before (t_ns, mm) comes to another one by t_ns, at SLEW_MM_S."""
    then_ns, then_mm = shown
    step_mm = SLEW_MM_S * max(t_ns - then_ns, 0) * 1e-9
    return min(max(target_mm, then_mm - step_mm), then_mm + step_mm)
