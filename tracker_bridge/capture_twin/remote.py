"""Pupil Remote: its answers, with the faults of the real one. No sockets; standin.py has them.

| request | answer |
|---|---|
| SUB_PORT, PUB_PORT | the port of the backbone, decimal |
| t | Pupil time in s |
| T 1234.5 | Timesync successful. (sets Pupil time) |
| v | the version |
| R, R name; r | OK: start, stop a recording |
| C; c | OK: start, stop a gaze calibration |
| notify.x, then a msgpack map | Message forwarded. |
| anything else | Unknown command. |

Only the first byte of a request counts, but for the two ports, and its argument begins at the third. A request that is
empty, or no UTF-8, ends Pupil Remote: the real one fails on it, and nothing starts it again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, Protocol

VERSION: Final = "3.6.14"
"""What `v` answers: the version whose behaviour was looked at."""


class RemoteKilledError(Exception):
    """The request has killed Pupil Remote."""


class Capture(Protocol):
    """What Pupil Remote needs of the program around it."""

    @property
    def ports(self) -> tuple[int, int]:
        """The backbone's ports: that for subscribers, that for publishers."""
        ...

    def pupil_s(self) -> float:
        """Pupil time now."""
        ...

    def set_pupil_s(self, pupil_s: float) -> None:
        """Sets Pupil time."""
        ...

    def notify(self, subject: str, **fields: Any) -> None:
        """Sends a notification of the program's own to all."""
        ...

    def forward(self, frames: list[bytes]) -> None:
        """Sends a client's message to all."""
        ...


def answer(request: list[bytes], capture: Capture) -> str:
    """What Pupil Remote answers to a request of one or more frames. Raises RemoteKilledError where it dies of it."""
    try:
        text = request[0].decode()
    except UnicodeDecodeError:
        raise RemoteKilledError("a request was no UTF-8") from None
    if len(request) > 1:
        capture.forward(request)
        return "Message forwarded."
    if not text:
        raise RemoteKilledError("a request was empty")
    if text in _PORTS:
        return str(capture.ports[_PORTS[text]])
    command = _COMMANDS.get(text[0])
    return "Unknown command." if command is None else command(text[2:], capture)


def _start_recording(name: str, capture: Capture) -> str:
    capture.notify("recording.should_start", session_name=name)
    return "OK"


def _notify(subject: str) -> Callable[[str, Capture], str]:
    def command(_: str, capture: Capture) -> str:
        capture.notify(subject)
        return "OK"

    return command


def _set_time(text: str, capture: Capture) -> str:
    try:
        pupil_s = float(text)
    except ValueError:
        return f"'{text}' cannot be converted to float."
    capture.set_pupil_s(pupil_s)
    return "Timesync successful."


_PORTS: Final = {"SUB_PORT": 0, "PUB_PORT": 1}
_COMMANDS: Final[dict[str, Callable[[str, Capture], str]]] = {
    "R": _start_recording,
    "r": _notify("recording.should_stop"),
    "C": _notify("calibration.should_start"),
    "c": _notify("calibration.should_stop"),
    "T": _set_time,
    "t": lambda _, capture: repr(capture.pupil_s()),
    "v": lambda *_: VERSION,
}
