"""What Pupil Capture was told to do, until it reports what became of it. Pure: times are passed in.

Pupil Remote's `OK` means only that it heard. What happened is said by a notification, and where something stands in
the way (a calibration runs already, the folder cannot be written) by a line in Capture's log at best. So each order
waits for its notification, and fails by name if that does not come.
"""

from __future__ import annotations

import dataclasses
import enum
from typing import Final

from entoptic.tracker_bridge.events import TaskKind, TaskOutcome, TrackerTask
from entoptic.tracker_bridge.samples import NS_PER_S
from entoptic.tracker_bridge.sources.pupil_core.remote import Request


class Command(enum.StrEnum):
    """What Capture can be told; the value completes "was told to …"."""

    START_RECORDING = "start a recording"
    STOP_RECORDING = "stop its recording"
    START_CALIBRATION = "start its gaze calibration"
    STOP_CALIBRATION = "stop its gaze calibration"


@dataclasses.dataclass(frozen=True, slots=True)
class Order:
    """One command, given at a time of the bridge's clock."""

    command: Command
    request: Request
    given_ns: int


@dataclasses.dataclass(frozen=True, slots=True)
class _Expected:
    kind: TaskKind
    outcomes: frozenset[TaskOutcome]
    within_s: float


_ENDED: Final = frozenset({TaskOutcome.SUCCEEDED, TaskOutcome.FAILED})

EXPECTED: Final = {
    Command.START_RECORDING: _Expected(TaskKind.RECORDING, frozenset({TaskOutcome.STARTED}), 5.0),
    Command.STOP_RECORDING: _Expected(TaskKind.RECORDING, frozenset({TaskOutcome.STOPPED}), 10.0),
    Command.START_CALIBRATION: _Expected(TaskKind.GAZE_CALIBRATION, frozenset({TaskOutcome.STARTED}), 5.0),
    Command.STOP_CALIBRATION: _Expected(TaskKind.GAZE_CALIBRATION, _ENDED | {TaskOutcome.STOPPED}, 5.0),
}
"""What each command is answered with, and within what time.

Engineering choices, at least ten times what was measured on Capture 3.6: a recording or a calibration started after
7 ms, a recording stopped after 12 ms, a calibration after 0.33 s.
"""

FIT: Final = _Expected(TaskKind.GAZE_CALIBRATION, _ENDED, 60.0)
"""What follows when a calibration has been stopped: 5.2 s of fitting were measured."""


@dataclasses.dataclass(frozen=True, slots=True)
class _Open:
    order: Order
    expected: _Expected
    since_ns: int

    @property
    def until_ns(self) -> int:
        return self.since_ns + round(self.expected.within_s * NS_PER_S)


class OpenTasks:
    """The orders that have not been answered for."""

    def __init__(self) -> None:
        self._open: list[_Open] = []
        self._remark = ""
        self._remarked_ns = 0

    def expect(self, order: Order) -> None:
        """An order is about to be sent."""
        self._open.append(_Open(order, EXPECTED[order.command], order.given_ns))

    def note(self, task: TrackerTask) -> None:
        """Capture reports: the oldest order that this answers is done, or waits for the calibration's fit."""
        for open_ in self._open:
            if open_.expected.kind is task.kind and task.outcome in open_.expected.outcomes:
                self._open.remove(open_)
                stopped = open_.order.command is Command.STOP_CALIBRATION and task.outcome is TaskOutcome.STOPPED
                if stopped:
                    self._open.append(_Open(open_.order, FIT, task.t_ns))
                return

    def remark(self, text: str, t_ns: int) -> None:
        """Capture logged something, which may be why an order has no answer."""
        self._remark, self._remarked_ns = text, t_ns

    def refused(self, order: Order, reason: str, t_ns: int) -> tuple[TrackerTask, ...]:
        """The order did not reach Capture, or was not understood."""
        for open_ in self._open:
            if open_.order is order:
                self._open.remove(open_)
                detail = f"Pupil Capture was told to {order.command}: {reason}"
                return (TrackerTask(t_ns, open_.expected.kind, TaskOutcome.FAILED, detail),)
        return ()

    def overdue(self, now_ns: int) -> tuple[TrackerTask, ...]:
        """A failure for each order whose time is up."""
        late = [open_ for open_ in self._open if open_.until_ns <= now_ns]
        if not late:
            return ()
        self._open = [open_ for open_ in self._open if open_.until_ns > now_ns]
        return tuple(TrackerTask(now_ns, open_.expected.kind, TaskOutcome.FAILED, self._why(open_)) for open_ in late)

    def _why(self, open_: _Open) -> str:
        detail = (
            f"Pupil Capture was told to {open_.order.command} and has not reported that it "
            f"{'ended' if open_.expected is FIT else 'did'} within {open_.expected.within_s:g} s"
        )
        if self._remarked_ns >= open_.since_ns and self._remark:
            return f"{detail}; its log says: {self._remark}"
        return f"{detail}; look at its window"
