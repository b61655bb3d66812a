"""The recording mode: the states of the live mode, 50 ms later and better, for whoever does not render at once.

Theory of operation: each state waits until the states of the next LAG_NS are there. They show whether a lid was about
to close, so that what it had already touched can be cut out, and, near the end of a gap, the diameter at which the
pupil comes back, towards which the diameter then goes in a straight line; gaps that are shorter than the lag are
straight lines altogether. Before that the pupil goes on as it went (extrapolation.py). Both eyes' diameters are those
at the state's own time, interpolated between their samples, whenever their cameras took them. Directions of gaze,
openness and events are those of the live mode.

Latency: LAG_NS, exactly: a state leaves with the first record that is so much later, `tick` included.
"""

from __future__ import annotations

import collections
from collections.abc import Iterator

import msgspec

from entoptic.tracker_bridge.extrapolation import BASELINE_NS, Extrapolation
from entoptic.tracker_bridge.samples import Eye, EyeState, OneEyeState, Phase
from entoptic.tracker_bridge.trust import DIAMETER_RANGE_MM

LAG_NS = 50_000_000
"""Engineering choice: ten samples at 200 Hz, as much as a lid needs from its first touch of the pupil to covering it,
twice over."""


class FixedLagSmoother:
    """Feed it the live mode's states in order; `tick` what passes without one, and `flush` at the end."""

    def __init__(self) -> None:
        self._waiting: collections.deque[EyeState] = collections.deque()
        self._eyes = {eye: _Diameters() for eye in Eye}

    def step(self, state: EyeState) -> Iterator[EyeState]:
        """The states that are LAG_NS or more older than this one and have not left yet."""
        self._waiting.append(state)
        for eye, diameters in self._eyes.items():
            diameters.add(state.of(eye))
        return self.tick(state.t_ns)

    def tick(self, t_ns: int) -> Iterator[EyeState]:
        """The states that are LAG_NS or more older than t_ns, since no other will come from before it."""
        while self._waiting and self._waiting[0].t_ns <= t_ns - LAG_NS:
            yield self._better(self._waiting.popleft())

    def flush(self) -> Iterator[EyeState]:
        """All states that are left, at the end of a stream."""
        while self._waiting:
            yield self._better(self._waiting.popleft())

    def _better(self, state: EyeState) -> EyeState:
        right, left = (self._eyes[eye].better(state.t_ns, state.of(eye)) for eye in (Eye.RIGHT, Eye.LEFT))
        return msgspec.structs.replace(state, right=right, left=left, lag_ns=LAG_NS)


class _Mark(msgspec.Struct):
    """What was known of a pupil at a time."""

    t_ns: int
    pupil_diameter_mm: float | None
    """As measured, and trusted from both sides; else None."""
    lid: bool


class _Diameters:
    """One eye's diameters, LAG_NS after they were measured."""

    def __init__(self) -> None:
        self._ahead: collections.deque[_Mark] = collections.deque()
        self._trusted: collections.deque[tuple[int, float]] = collections.deque()
        self._extrapolation: Extrapolation | None = None
        self._sampled_ns: int | None = None
        self._phase: Phase | None = None
        self._shown: tuple[int, float] | None = None

    def add(self, one: OneEyeState) -> None:
        """The live mode's newest."""
        is_new = one.t_ns is not None and one.t_ns != self._sampled_ns
        if one.t_ns is not None and (is_new or one.phase is not self._phase):
            # In silence the phase changes without a sample, just behind the last one.
            t_ns = one.t_ns if is_new else one.t_ns + 1
            if one.phase is Phase.TRACKING:
                self._ahead.append(_Mark(t_ns, one.measured_mm, lid=False))
            else:
                # What came just before is not to be trusted either.
                for mark in reversed(self._ahead):
                    if mark.t_ns <= t_ns - LAG_NS:
                        break
                    mark.pupil_diameter_mm = None
                self._ahead.append(_Mark(t_ns, None, lid=one.phase in (Phase.CLOSING, Phase.BLINK)))
        self._sampled_ns, self._phase = one.t_ns, one.phase

    def better(self, t_ns: int, one: OneEyeState) -> OneEyeState:
        """The eye at t_ns, which never goes backwards."""
        while self._ahead and self._ahead[0].t_ns <= t_ns:
            self._pass(self._ahead.popleft())
        after = next(((m.t_ns, m.pupil_diameter_mm) for m in self._ahead if m.pupil_diameter_mm is not None), None)
        pupil_diameter_mm = self._pupil_diameter_mm(t_ns, after)
        borrowed = one.borrowed and after is None
        if borrowed or pupil_diameter_mm is None:
            # The other eye's diameter, or none: there is nothing to do better.
            self._shown = None if one.pupil_diameter_mm is None else (t_ns, one.pupil_diameter_mm)
            return one
        self._shown = (t_ns, pupil_diameter_mm)
        phase = one.phase
        if phase is Phase.TRACKING and self._extrapolation is not None:
            phase = Phase.CLOSING if any(mark.lid for mark in self._ahead) else Phase.DROPOUT
        return msgspec.structs.replace(one, phase=phase, pupil_diameter_mm=pupil_diameter_mm, borrowed=False)

    def _pass(self, mark: _Mark) -> None:
        if mark.pupil_diameter_mm is None:
            if self._extrapolation is None and self._trusted:
                self._extrapolation = Extrapolation(self._trusted)
            return
        if self._extrapolation is not None:
            self._extrapolation = None
            self._trusted.clear()
        while self._trusted and self._trusted[0][0] < mark.t_ns - BASELINE_NS:
            self._trusted.popleft()
        self._trusted.append((mark.t_ns, mark.pupil_diameter_mm))

    def _pupil_diameter_mm(self, t_ns: int, after: tuple[int, float] | None) -> float | None:
        before = self._trusted[-1] if self._trusted else None
        if self._extrapolation is None and before is not None:
            if before[0] == t_ns:
                return before[1]
            if after is not None and self._ahead[0].t_ns == after[0]:
                return _between(before, after, t_ns)
        if after is not None and self._shown is not None:
            return _between(self._shown, after, t_ns)
        if self._extrapolation is not None:
            low_mm, high_mm = DIAMETER_RANGE_MM
            return min(max(self._extrapolation.at(t_ns), low_mm), high_mm)
        return None if before is None else before[1]


def _between(before: tuple[int, float], after: tuple[int, float], t_ns: int) -> float:
    """On the straight line through two points (t_ns, diameter), at a time between them."""
    share = (t_ns - before[0]) / (after[0] - before[0])
    return before[1] + share * (after[1] - before[1])
