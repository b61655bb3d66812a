"""Where the screens of a pupil calibration are shown: any program that follows two ZeroMQ sockets, or nobody's display.

Theory of operation: commands are published (PUB), answers are collected (PULL), so that a display may come late, crash
and come back; a screen is asked for again every half second until it is answered. A display tells times of its own
clock. It is asked for that clock's time now and then, and the round trips say how it stands to the bridge's; the
sockets have a thread of their own, so that no tracker's silence lengthens a round trip. Messages: docs/calibration.md.
"""

from __future__ import annotations

import enum
import itertools
import queue
import threading
import time
from typing import Protocol

import msgspec
import zmq

from tracker_bridge.calibration import ShowScreen
from tracker_bridge.clock import RoundTripClock
from tracker_bridge.events import ClockEstimated
from tracker_bridge.publisher import PortInUseError
from tracker_bridge.samples import NS_PER_S

ASK_AT_FIRST_NS, ASK_LATER_NS = 20_000_000, NS_PER_S
FIRST_ASKS = 16
"""A burst, then once a second."""
ASK_AGAIN_NS = NS_PER_S // 2
_POLL_MS = 5


class Request(enum.StrEnum):
    """What the person before a display wants."""

    START = "start"
    """Or go on after a pause."""
    PAUSE = "pause"
    ABORT = "abort"


class ScreenShown(msgspec.Struct, frozen=True):
    """A screen was really shown at this time of the bridge's clock."""

    id: int
    t_ns: int


Answer = ScreenShown | Request


class Display(Protocol):
    """Shows screens and says when."""

    @property
    def name(self) -> str:
        """For a person and for the result."""
        ...

    @property
    def ready(self) -> bool:
        """Whether its clock is known."""
        ...

    @property
    def uncertainty_ns(self) -> int | None:
        """How far its times may be off; None where there is nothing to estimate."""
        ...

    def show(self, command: ShowScreen) -> None:
        """Asks for a screen; returns at once."""
        ...

    def tell(self, message: str, *, again: bool) -> None:
        """What came out, for the person before it; and whether they may start again."""
        ...

    def answers(self, now_ns: int) -> list[Answer]:
        """What has come since the last call."""
        ...


class NoDisplay:
    """Says that it shows every screen, one frame after it was asked, and starts at once: for simulated eyes alone."""

    name = "none: simulated"
    ready = True
    uncertainty_ns = None
    _FRAME_NS = NS_PER_S // 60

    def __init__(self) -> None:
        self._now_ns = 0
        self._due: list[ScreenShown] = []
        self._started = False

    def show(self, command: ShowScreen) -> None:
        """Takes a frame's time."""
        self._due.append(ScreenShown(command.id, self._now_ns + self._FRAME_NS))

    def tell(self, message: str, *, again: bool) -> None:
        """Nobody is there to be told; the next run starts at once."""
        self._started = not again

    def answers(self, now_ns: int) -> list[Answer]:
        """The screens whose time has come."""
        self._now_ns = now_ns
        answers: list[Answer] = [] if self._started else [Request.START]
        self._started = True
        answers += [shown for shown in self._due if shown.t_ns <= now_ns]
        self._due = [shown for shown in self._due if shown.t_ns > now_ns]
        return answers


class DisplayMessage(msgspec.Struct, frozen=True):
    """What a display may say; unknown keys are passed over."""

    shown: int | None = None
    """The id of a screen that was shown at `t_ns`."""
    answer: int | None = None
    """The number of a question for the clock, answered at `t_ns`."""
    t_ns: int | None = None
    """Of the display's own clock."""
    request: Request | None = None


class SocketDisplay:
    """A display behind two sockets. Close it. Raises PortInUseError."""

    def __init__(self, commands_address: str, answers_address: str, name: str = "a program on the sockets") -> None:
        self.name = name
        self.unreadable: str | None = None
        """Why the display's last message was refused, if one was."""
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._commands = self._bind(zmq.PUB, commands_address)
        self._collected = self._bind(zmq.PULL, answers_address)
        self.commands_address = self._commands.getsockopt_string(zmq.LAST_ENDPOINT)
        self.answers_address = self._collected.getsockopt_string(zmq.LAST_ENDPOINT)
        self._to_send: queue.SimpleQueue[ShowScreen | dict[str, object]] = queue.SimpleQueue()
        self._arrived: queue.SimpleQueue[Answer] = queue.SimpleQueue()
        self._decoder = msgspec.msgpack.Decoder(DisplayMessage)
        self._unanswered: ShowScreen | None = None
        self._again_ns = 0
        self._questions = itertools.count(1)
        self._closed = threading.Event()
        self._forget_clock()
        self._thread = threading.Thread(target=self._run, name="calibration-display", daemon=True)
        self._thread.start()

    @property
    def ready(self) -> bool:
        """Whether its clock is known."""
        return self._uncertainty_ns is not None

    @property
    def uncertainty_ns(self) -> int | None:
        """How far the times of screens may be off."""
        return self._uncertainty_ns

    def show(self, command: ShowScreen) -> None:
        """Asks for a screen."""
        self._to_send.put(command)

    def tell(self, message: str, *, again: bool) -> None:
        """Shows a sentence on the grey screen, and whether there is another run."""
        self._to_send.put({"message": message, "again": again})

    def answers(self, now_ns: int) -> list[Answer]:
        """What has come since the last call."""
        answers = []
        while not self._arrived.empty():
            answers.append(self._arrived.get())
        return answers

    def close(self) -> None:
        """Sends what is left, half a second at most."""
        self._closed.set()
        self._thread.join()
        self._context.destroy(linger=500)

    def _bind(self, kind: int, address: str) -> zmq.Socket[bytes]:
        socket = self._context.socket(kind)
        try:
            socket.bind(address)
        except zmq.ZMQError as error:
            self._context.destroy(linger=0)
            raise PortInUseError(
                f"cannot listen on {address}: {error.strerror}; choose another port, or tcp://127.0.0.1:* for any"
            ) from None
        return socket

    def _forget_clock(self) -> None:
        self._clock = RoundTripClock()
        self._asked: dict[int, int] = {}
        """When each question was asked that is not answered yet."""
        self._asks = 0
        self._ask_ns = 0
        self._uncertainty_ns: int | None = None

    def _run(self) -> None:
        while not self._closed.is_set():
            self._send_due()
            if self._collected.poll(_POLL_MS):
                self._receive(self._collected.recv(), time.monotonic_ns())
        self._send_due()

    def _send_due(self) -> None:
        while not self._to_send.empty():
            item = self._to_send.get()
            if isinstance(item, dict):
                self._send(item)
            else:
                self._unanswered, self._again_ns = item, 0
        now_ns = time.monotonic_ns()
        if self._unanswered is not None and now_ns >= self._again_ns:
            self._send(self._unanswered)
            self._again_ns = now_ns + ASK_AGAIN_NS
        if now_ns >= self._ask_ns:
            self._asks += 1
            self._ask_ns = now_ns + (ASK_AT_FIRST_NS if self._asks < FIRST_ASKS else ASK_LATER_NS)
            question = next(self._questions)
            self._asked = {old: sent_ns for old, sent_ns in self._asked.items() if old > question - FIRST_ASKS}
            self._asked[question] = time.monotonic_ns()
            self._send({"ask": question})

    def _send(self, message: ShowScreen | dict[str, object]) -> None:
        self._commands.send(msgspec.msgpack.encode(message))

    def _receive(self, message: bytes, now_ns: int) -> None:
        try:
            said = self._decoder.decode(message)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            self.unreadable = str(error)
            return
        if said.request is not None:
            if said.request is Request.START:
                # Whoever starts may be another program, or the same with a clock that starts anew.
                self._forget_clock()
            self._arrived.put(said.request)
        if said.t_ns is None:
            return
        if said.answer is not None and (sent_ns := self._asked.pop(said.answer, None)) is not None:
            for event in self._clock.add(sent_ns, said.t_ns, now_ns):
                if isinstance(event, ClockEstimated):
                    self._uncertainty_ns = event.uncertainty_ns
        if said.shown is not None and (shown_ns := self._clock.bridge_ns(said.t_ns)) is not None:
            if self._unanswered is not None and said.shown == self._unanswered.id:
                self._unanswered = None
            self._arrived.put(ScreenShown(said.shown, shown_ns))
