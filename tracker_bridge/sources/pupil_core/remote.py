"""Pupil Remote: the questions that may be asked of Pupil Capture, and what its answers mean.

One question, one answer, over a ZeroMQ REQ socket. Three things must never be sent: an empty request, which ends
Pupil Remote for good; `T`, which sets the clock under everybody and spoils a running calibration; a notification
without a subject, which ends Capture's eye processes. So a `Request` is one frame of text, made of a short list of
forms and of nothing else, and `Remote.ask` sends Requests only.
"""

from __future__ import annotations

import dataclasses
import math
import re
import time
from collections.abc import Callable
from typing import Final

import zmq

from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.pupil_core.datum import TIME_LIMIT_S, nanoseconds

DEFAULT_REMOTE: Final = "tcp://127.0.0.1:50020"
"""Where Pupil Capture listens unless told otherwise (its Network API menu)."""

TIMEOUT_S: Final = 1.0
"""How long an answer may take. Engineering choice: a local one takes 0.1 ms, one over a bad wireless net 0.1 s."""

MAX_NAME_LENGTH: Final = 200
"""Characters of a recording's name. Engineering choice: file systems stop at 255 bytes a folder."""

_ADDRESS = re.compile(r"tcp://(?P<host>[^\s:/\[\]]+):(?P<port>[1-9]\d{0,4})")
_ALLOWED = re.compile(r"SUB_PORT|[vtrCc]|R(?: [^\x00-\x1f\x7f]+)?")
_STOP_CHECK_MS = 50
"""How often a waiting question looks whether it was called off; an answer is taken at once."""


class RemoteError(SourceError):
    """Pupil Remote cannot be talked to."""


class RemoteSilentError(RemoteError):
    """No answer in time."""


class RemoteReplyError(RemoteError):
    """An answer that Pupil Remote would not give."""


class ForbiddenRequestError(SourceError):
    """A request that must not be sent."""


@dataclasses.dataclass(frozen=True, slots=True)
class RemoteAddress:
    """Host and port of Pupil Remote."""

    host: str
    port: int

    @classmethod
    def parse(cls, text: str) -> RemoteAddress:
        """`tcp://HOST:PORT`. Raises SourceError for anything else."""
        match = _ADDRESS.fullmatch(text)
        if match is None or int(match["port"]) > 65535:
            raise SourceError(
                f"{text!r} is no address of Pupil Remote: give it like {DEFAULT_REMOTE}, with the host and the port "
                "that Pupil Capture shows in its Network API menu"
            )
        return cls(match["host"], int(match["port"]))

    def __str__(self) -> str:
        return f"tcp://{self.host}:{self.port}"

    @property
    def silence(self) -> str:
        """What to tell a person when nobody answers there."""
        return (
            f"nobody answers at {self}: start Pupil Capture, see that its Network API plugin is on and shows this "
            "port, and that no firewall lies between"
        )

    def data(self, port: int) -> str:
        """The address of the data port on the same host."""
        return f"tcp://{self.host}:{port}"


@dataclasses.dataclass(frozen=True, slots=True)
class Request:
    """One request that does no harm. Making any other raises ForbiddenRequestError."""

    text: str

    def __post_init__(self) -> None:
        if _ALLOWED.fullmatch(self.text) is None:
            raise ForbiddenRequestError(
                f"{self.text!r} must not be sent to Pupil Remote: ask SUB_PORT, v or t, or start and stop with "
                "R, r, C, c"
            )

    @property
    def payload(self) -> bytes:
        """The bytes of its one frame, never none."""
        return self.text.encode()


SUB_PORT: Final = Request("SUB_PORT")
VERSION: Final = Request("v")
TIME: Final = Request("t")
STOP_RECORDING: Final = Request("r")
START_CALIBRATION: Final = Request("C")
STOP_CALIBRATION: Final = Request("c")


def start_recording(name: str = "") -> Request:
    """Starts a recording, under Capture's own name for it if none is given; "/" in a name makes folders.

    Raises SourceError for a name that leaves Capture's folder of recordings, or cannot be one.
    """
    if not name:
        return Request("R")
    parts = name.split("/")
    if name != name.strip() or not name.isprintable() or len(name) > MAX_NAME_LENGTH or "\\" in name or "~" in name:
        reason = f"use up to {MAX_NAME_LENGTH} printable characters, none of them \\ or ~, no space around them"
    elif ".." in parts or "" in parts:
        reason = "use folders below Capture's own, like study/person_07"
    else:
        return Request(f"R {name}")
    raise SourceError(f"{name!r} cannot name a recording: {reason}")


def port_of(answer: str) -> int:
    """The port in an answer to SUB_PORT."""
    port = int(answer) if re.fullmatch(r"\d{1,5}", answer, re.ASCII) else 0
    if not 0 < port <= 65535:
        raise RemoteReplyError(
            f"whoever listens there answers SUB_PORT with {answer[:60]!r}: that is not Pupil Remote. Give the port "
            "that Pupil Capture shows in its Network API menu"
        )
    return port


def pupil_ns_of(answer: str) -> int:
    """Pupil's time in an answer to `t`, nanoseconds."""
    try:
        seconds = float(answer)
    except ValueError:
        seconds = math.nan
    if not abs(seconds) < TIME_LIMIT_S:
        raise RemoteReplyError(
            f"Pupil Remote answers `t` with {answer[:60]!r}, which is no time: restart Pupil Capture"
        )
    return nanoseconds(seconds)


def version_of(answer: str) -> str:
    """The version in an answer to `v`; "of unknown version" where Capture is too old to be asked."""
    return answer if re.fullmatch(r"v?\d+(\.\d+)+[\w.+-]{0,40}", answer) else "of unknown version"


def check_accepted(answer: str) -> None:
    """An answer to R, r, C or c: raises RemoteReplyError unless Capture has taken note of it."""
    if answer != "OK":
        raise RemoteReplyError(f"Pupil Remote answers {answer[:60]!r}")


@dataclasses.dataclass(frozen=True, slots=True)
class Answer:
    """What was answered, and when on this machine's monotonic clock."""

    sent_ns: int
    text: str
    received_ns: int


class Remote:
    """A REQ socket that is replaced whenever an answer fails to come: the old one would wait for it for ever.

    For one thread. `stopped` is looked at while waiting.
    """

    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        address: RemoteAddress,
        *,
        stopped: Callable[[], bool],
        timeout_s: float,
    ) -> None:
        self._context = context
        self._address = address
        self._stopped = stopped
        self._timeout_s = timeout_s
        self._socket: zmq.Socket[bytes] | None = None

    def ask(self, request: Request) -> Answer:
        """Sends a request and waits for the answer. Raises RemoteSilentError if none comes in time."""
        try:
            return self._ask(request.payload)
        except zmq.ZMQError as error:
            self.close()
            raise RemoteSilentError(f"{self._address.silence} ({error.strerror})") from None
        except RemoteError:
            self.close()
            raise

    def _ask(self, payload: bytes) -> Answer:
        if self._socket is None:
            self._socket = self._context.socket(zmq.REQ)
            self._socket.setsockopt(zmq.LINGER, 0)
            self._socket.connect(str(self._address))
        sent_ns = time.monotonic_ns()
        self._socket.send(payload, zmq.DONTWAIT)
        deadline_ns = sent_ns + round(self._timeout_s * 1e9)
        while not self._socket.poll(_STOP_CHECK_MS):
            if self._stopped() or time.monotonic_ns() > deadline_ns:
                raise RemoteSilentError(self._address.silence)
        frames = self._socket.recv_multipart()
        received_ns = time.monotonic_ns()
        try:
            return Answer(sent_ns, b"".join(frames).decode(), received_ns)
        except UnicodeDecodeError:
            raise RemoteReplyError(
                f"whoever listens at {self._address} is not Pupil Remote: it sends no text"
            ) from None

    def close(self) -> None:
        """Closes the socket; what was not sent is dropped, never sent late."""
        if self._socket is not None:
            self._socket.close(linger=0)
            self._socket = None
