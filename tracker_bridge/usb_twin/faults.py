"""What can go wrong with a USB tracker, as text: "unplug@5s:2s" is unplugged 5 s after the start, for 2 s."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Literal, get_args

import msgspec

from entoptic.tracker_bridge.source import SourceError

FaultKind = Literal["unplug", "stall", "timeout", "short", "long", "garbage"]

USUAL_S = {"unplug": 2.0, "timeout": 0.5}
"""How long those last that must last, where nothing is said. Engineering choice: as long as a person needs to plug a
cable in again; and longer than any pause between reports."""

_FORM = re.compile(r"([a-z]+)@(\d+(?:\.\d+)?)s(?::(\d+(?:\.\d+)?)s)?")


class Fault(msgspec.Struct, frozen=True):
    """Something that goes wrong with the simulated tracker.

    unplug: gone from the USB, with its clock beginning again when it is back. stall: the endpoint is halted until that
    is cleared. timeout: nothing is sent. short, long: reports end too early, or go on. garbage: random packets.
    """

    kind: FaultKind
    start_ns: int
    """From the tracker's first report on."""
    duration_ns: int
    """0: one report; a stall lasts until it is cleared."""

    def covers(self, elapsed_ns: int) -> bool:
        """Whether it goes on at this time."""
        return self.start_ns <= elapsed_ns < self.end_ns

    @property
    def end_ns(self) -> int:
        """When it is over."""
        return self.start_ns + self.duration_ns


def parse_faults(texts: Sequence[str]) -> tuple[Fault, ...]:
    """Faults of the form KIND@START or KIND@START:DURATION, both in seconds with an "s".

    Raises SourceError for any other text.
    """
    return tuple(_parse(text) for text in texts)


def _parse(text: str) -> Fault:
    found = _FORM.fullmatch(text)
    kinds = get_args(FaultKind)
    if found is None or found[1] not in kinds or (found[1] == "stall" and found[3] is not None):
        raise SourceError(
            f"{text!r} is no fault: write KIND@START or KIND@START:DURATION, such as unplug@5s:2s or stall@3s; "
            f"kinds are {', '.join(kinds)}, and a stall has no duration"
        )
    duration_s = float(found[3]) if found[3] is not None else USUAL_S.get(found[1], 0.0)
    return Fault(msgspec.convert(found[1], FaultKind), round(float(found[2]) * 1e9), round(duration_s * 1e9))
