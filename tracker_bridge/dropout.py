"""Which measured diameters to trust, and what a renderer shows meanwhile.

Theory of operation: a lid that closes first covers part of the pupil, so the tracker reports, at good confidence, a
pupil that shrinks faster than any iris can; then it loses the pupil; then the same backwards. So a sample is trusted
when its confidence is good, its diameter is a pupil's and it has not changed faster than an iris can. When trust
ends, the diameter held is the one from before the lid came into play (rolled back), not the last one; when it comes
back, the first samples after it still show the lid and are passed over. No sample is delayed: the filter's latency
is zero, its price is the roll-back at onset, at most one speed window late.
"""

from __future__ import annotations

import collections
import dataclasses

from tracker_bridge.samples import (
    BlinkOffset,
    BlinkOnset,
    Event,
    Phase,
    PupilBack,
    PupilLost,
    PupilSample,
)

MIN_CONFIDENCE = 0.6
"""Half-closed lids pass at 0.6 and above too, hence the speed gate; below it Pupil Capture's diameters are noise."""
MIN_MODEL_CONFIDENCE = 0.5
"""Engineering choice: pye3d reports 0.1 for a lost eye model and 0.9–1 for a good one."""
DIAMETER_RANGE_MM = (1.0, 9.0)
"""No human pupil lies outside."""
MAX_SPEED_MM_S = 12.0
"""A light reflex peaks near 7 mm/s; lids shrink a pupil at 20–100 mm/s. Over a 25 ms window this threw away the least
good data for the least error around blinks (RMS 0.025 mm against 0.227 mm with confidence alone)."""
SPEED_WINDOW_NS = 25_000_000
ROLL_BACK_NS = 50_000_000
"""How far before the first mistrusted sample the held diameter is taken from."""
SETTLE_NS = 50_000_000
"""How long samples must be good again before they are trusted."""
LOST_AFTER_NS = 500_000_000
SLEW_MM_S = 10.0
"""How fast the shown diameter moves back to the measured one after a blink: a jump would flicker."""
CLOSED_OPENNESS = 0.5
"""A lid over half the eye is a blink, for trackers that measure openness."""


@dataclasses.dataclass(frozen=True, slots=True)
class Shown:
    """What one sample makes of one eye."""

    phase: Phase
    diameter_mm: float | None
    """The diameter to render with; None until one was trusted."""
    events: tuple[Event, ...]


class DropoutFilter:
    """The filter of one eye: feed it that eye's samples in the order of their time."""

    def __init__(self) -> None:
        self._plausible: collections.deque[tuple[int, float]] = collections.deque()
        self._trusted: collections.deque[tuple[int, float]] = collections.deque()
        self._phase = Phase.LOST
        self._held_mm: float | None = None
        self._shown: tuple[int, float] | None = None
        self._catching_up = False
        self._mistrusted_since_ns: int | None = None
        self._good_since_ns: int | None = None
        self._blink_onset_ns: int | None = None

    def step(self, sample: PupilSample) -> Shown:
        """The state after one more sample."""
        diameter_mm = self._trust(sample)
        if diameter_mm is None:
            return self._mistrust(sample)
        return self._track(sample, diameter_mm)

    def _trust(self, sample: PupilSample) -> float | None:
        """The sample's diameter if it can be believed as it stands."""
        t_ns, diameter_mm = sample.t_ns, sample.diameter_mm
        if (
            diameter_mm is None
            or sample.confidence < MIN_CONFIDENCE
            or (sample.model_confidence is not None and sample.model_confidence < MIN_MODEL_CONFIDENCE)
            or not DIAMETER_RANGE_MM[0] <= diameter_mm <= DIAMETER_RANGE_MM[1]
        ):
            self._plausible.clear()
            self._good_since_ns = None
            return None
        while len(self._plausible) > 1 and self._plausible[1][0] <= t_ns - SPEED_WINDOW_NS:
            self._plausible.popleft()
        self._plausible.append((t_ns, diameter_mm))
        then_ns, then_mm = self._plausible[0]
        # Over less than the window a sample's own noise would look like speed.
        elapsed_ns = max(t_ns - then_ns, SPEED_WINDOW_NS)
        if abs(diameter_mm - then_mm) > MAX_SPEED_MM_S * elapsed_ns * 1e-9:
            self._good_since_ns = None
            return None
        if self._good_since_ns is None:
            self._good_since_ns = t_ns
        settling = self._mistrusted_since_ns is not None and t_ns - self._good_since_ns < SETTLE_NS
        return None if settling else diameter_mm

    def _mistrust(self, sample: PupilSample) -> Shown:
        t_ns = sample.t_ns
        events: list[Event] = []
        if self._mistrusted_since_ns is None:
            self._mistrusted_since_ns = t_ns
            self._held_mm = self._before(t_ns - ROLL_BACK_NS)
        if self._phase is not Phase.LOST:
            if self._blink_onset_ns is None and self._lid_shows(sample):
                self._blink_onset_ns = self._mistrusted_since_ns
                events.append(BlinkOnset(self._mistrusted_since_ns, sample.eye))
            if t_ns - self._mistrusted_since_ns >= LOST_AFTER_NS:
                self._phase = Phase.LOST
                events.append(PupilLost(t_ns, sample.eye))
            else:
                self._phase = Phase.DROPOUT if self._blink_onset_ns is None else Phase.BLINK
        return Shown(self._phase, self._show(t_ns, self._held_mm), tuple(events))

    def _track(self, sample: PupilSample, diameter_mm: float) -> Shown:
        t_ns = sample.t_ns
        events: list[Event] = []
        if self._mistrusted_since_ns is not None:
            self._trusted.clear()
            self._catching_up = True
            if self._blink_onset_ns is not None:
                events.append(BlinkOffset(t_ns, sample.eye, t_ns - self._blink_onset_ns))
            if self._phase is Phase.LOST:
                events.append(PupilBack(t_ns, sample.eye))
            self._mistrusted_since_ns = self._blink_onset_ns = None
        self._phase = Phase.TRACKING
        while len(self._trusted) > 1 and self._trusted[1][0] <= t_ns - ROLL_BACK_NS:
            self._trusted.popleft()
        self._trusted.append((t_ns, diameter_mm))
        self._held_mm = diameter_mm
        return Shown(self._phase, self._show(t_ns, diameter_mm), tuple(events))

    def _lid_shows(self, sample: PupilSample) -> bool:
        if sample.openness is not None:
            return sample.openness < CLOSED_OPENNESS
        # A plausible diameter that was refused is one that moved too fast; downwards that is a lid.
        shrinking = len(self._plausible) > 1 and self._plausible[-1][1] < self._plausible[0][1]
        return shrinking and self._good_since_ns is None

    def _before(self, t_ns: int) -> float | None:
        """The newest trusted diameter that is no younger than `t_ns`, or the oldest there is."""
        older = [mm for when_ns, mm in self._trusted if when_ns <= t_ns]
        if older:
            return older[-1]
        return self._trusted[0][1] if self._trusted else self._held_mm

    def _show(self, t_ns: int, target_mm: float | None) -> float | None:
        if target_mm is None:
            return None
        if self._shown is not None and (self._catching_up or self._mistrusted_since_ns is not None):
            then_ns, then_mm = self._shown
            step_mm = SLEW_MM_S * (t_ns - then_ns) * 1e-9
            self._catching_up = abs(target_mm - then_mm) > step_mm
            target_mm = min(max(target_mm, then_mm - step_mm), then_mm + step_mm)
        self._shown = (t_ns, target_mm)
        return target_mm
