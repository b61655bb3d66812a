"""What may go wrong, on request: `NAME[=VALUE][@START[:DURATION]]`, such as `silence@5s:2s` or `drift=200ppm`.

START is the time since the program started, at once unless given; a fault lasts to the end unless DURATION is given or
the table says otherwise. Of the faults that strike single messages, every tenth message is hit.
"""

from __future__ import annotations

import enum
import re
from collections import Counter
from collections.abc import Iterable
from typing import Final, NamedTuple

import msgpack  # type: ignore[import-untyped]  # ships no types
import msgspec

from entoptic.tracker_bridge.capture_twin import CaptureError

_EVERY: Final = 10
"""Engineering choice: often enough for a short test, rare enough that the rest still makes sense."""


class FaultError(CaptureError):
    """A fault is not known or not well put: the message says which there are."""


class Fault(enum.StrEnum):
    """What may go wrong."""

    RESTART = "restart"
    """The program dies and comes back: other ports of the backbone, the same of Pupil Remote, no last answers."""
    SILENCE = "silence"
    """Nothing comes from the eyes; Pupil Remote still answers."""
    LATE = "late"
    """The eyes' data come later than they should; their times are right."""
    DUPLICATE = "duplicate"
    """All of the eyes' data come twice."""
    CORRUPT = "corrupt"
    """Some of the eyes' data are damaged: cut short, no msgpack, empty, not a number, without contents."""
    BACKWARDS = "backwards"
    """Some of the eyes' data come behind the next ones of their kind."""
    DRIFT = "drift"
    """Pupil time runs at another rate than this machine's clock."""
    TIMEBASE = "timebase"
    """Somebody sets Pupil time."""
    STUCK = "stuck"
    """Requests are never answered, not even when it is over."""


class Form(NamedTuple):
    """How a fault is written."""

    unit: str | None
    """Of its value; None where it has none."""
    value: float | None
    """Unless given; None where it must be."""
    duration_s: float | None
    """Unless given; None for ever."""
    example: str


FORMS: Final[dict[Fault, Form]] = {
    Fault.RESTART: Form(None, None, 2.0, "restart@5s"),
    Fault.SILENCE: Form(None, None, None, "silence@5s:2s"),
    Fault.LATE: Form("s", 3.0, None, "late=3s"),
    Fault.DUPLICATE: Form(None, None, None, "duplicate"),
    Fault.CORRUPT: Form(None, None, None, "corrupt"),
    Fault.BACKWARDS: Form(None, None, None, "backwards"),
    Fault.DRIFT: Form("ppm", None, None, "drift=200ppm"),
    Fault.TIMEBASE: Form("s", None, None, "timebase=+100s@5s"),
    Fault.STUCK: Form(None, None, 2.0, "stuck@5s:2s"),
}

_SPEC = re.compile(
    r"(?P<name>[a-z]+)(=(?P<value>[+-]?\d+(\.\d+)?)(?P<unit>[a-z]*))?"
    r"(@(?P<start>\d+(\.\d+)?)s?(:(?P<duration>\d+(\.\d+)?)s?)?)?"
)


class PlannedFault(msgspec.Struct, frozen=True):
    """A fault, and when it happens."""

    fault: Fault
    value: float
    """In the fault's unit; 0 for a fault without one."""
    start_s: float
    end_s: float

    def is_on(self, t_s: float) -> bool:
        """Whether it happens at a time since the start."""
        return self.start_s <= t_s < self.end_s


def read_fault(spec: str) -> PlannedFault:
    """The fault that `spec` describes. Raises FaultError."""
    match = _SPEC.fullmatch(spec.strip())
    if match is None or match["name"] not in set(Fault):
        known = ", ".join(form.example for form in FORMS.values())
        raise FaultError(f"'{spec}' is no fault: choose from {known}")
    fault = Fault(match["name"])
    form = FORMS[fault]
    if form.unit is None and match["value"] is not None:
        raise FaultError(f"'{spec}': {fault} takes no value: write {form.example}")
    if form.unit is not None and match["value"] is None and form.value is None:
        raise FaultError(f"'{spec}': {fault} needs a value: write {form.example}")
    if match["unit"] and match["unit"] != form.unit:
        raise FaultError(f"'{spec}': {fault} is given in {form.unit}, not in {match['unit']}: write {form.example}")
    value = float(match["value"]) if match["value"] is not None else form.value or 0.0
    if fault is Fault.LATE and value < 0.0:
        raise FaultError(f"'{spec}': data cannot come before they are measured: write {form.example}")
    start_s = float(match["start"] or 0.0)
    duration_s = float(match["duration"]) if match["duration"] is not None else form.duration_s
    return PlannedFault(fault, value, start_s, float("inf") if duration_s is None else start_s + duration_s)


class Faults:
    """The planned faults as they happen."""

    def __init__(self, planned: Iterable[PlannedFault]) -> None:
        self._planned = tuple(planned)
        self._begun: set[PlannedFault] = set()
        self._seen: Counter[bytes] = Counter()
        self._held: dict[bytes, list[bytes]] = {}
        self._damaged = 0

    def on(self, fault: Fault, t_s: float) -> PlannedFault | None:
        """A fault of this kind that happens now."""
        return next((plan for plan in self._planned if plan.fault is fault and plan.is_on(t_s)), None)

    def begun(self, t_s: float) -> list[PlannedFault]:
        """The faults that have begun since the last call."""
        new = [plan for plan in self._planned if plan.start_s <= t_s and plan not in self._begun]
        self._begun.update(new)
        return new

    def apply(self, t_s: float, message: list[bytes]) -> list[tuple[float, list[bytes]]]:
        """What becomes of a message of the eyes' data: messages with the s by which each is late."""
        if self.on(Fault.SILENCE, t_s):
            return []
        topic = message[0]
        self._seen[topic] += 1
        is_tenth = self._seen[topic] % _EVERY == 0
        if self.on(Fault.CORRUPT, t_s) and is_tenth:
            message = _DAMAGES[self._damaged % len(_DAMAGES)](message)
            self._damaged += 1
        messages = [message]
        if (held := self._held.pop(topic, None)) is not None:
            messages.append(held)
        elif self.on(Fault.BACKWARDS, t_s) and is_tenth:
            self._held[topic] = message
            return []
        if self.on(Fault.DUPLICATE, t_s):
            messages = [each for each in messages for _ in range(2)]
        late = self.on(Fault.LATE, t_s)
        return [(0.0 if late is None else late.value, each) for each in messages]


def _cut_short(message: list[bytes]) -> list[bytes]:
    return [message[0], message[1][: len(message[1]) // 2]]


def _no_msgpack(message: list[bytes]) -> list[bytes]:
    return [message[0], b"\xc1" * len(message[1])]


def _empty_map(message: list[bytes]) -> list[bytes]:
    return [message[0], msgpack.packb({})]


def _not_a_number(message: list[bytes]) -> list[bytes]:
    nan = float("nan")
    return [message[0], msgpack.packb(msgpack.unpackb(message[1]) | {"confidence": nan, "timestamp": nan})]


def _no_contents(message: list[bytes]) -> list[bytes]:
    return [message[0]]


_DAMAGES: Final = (_cut_short, _no_msgpack, _empty_map, _not_a_number, _no_contents)
