"""Where the screens of a pupil calibration are shown: any program that follows two ZeroMQ sockets, or nobody's display.

Theory of operation: commands are published (PUB), answers are collected (PULL), so that a display may come late, crash
and come back; a screen is asked for again every half second until it is answered. A display tells times of its own
clock. It is asked for that clock's time now and then, and the round trips say how it stands to the bridge's; the
sockets have a thread of their own, so that no tracker's silence lengthens a round trip. That thread sleeps until
something comes, something is due, or the bell rings. Commands go by XPUB, which tells who comes and goes: whoever comes
is told what was said last, and when the last display has gone nobody sees the screens any more, which is a pause.
Messages: docs/calibration.md.
"""

from __future__ import annotations

import collections
import contextlib
import enum
import itertools
import queue
import threading
import time

import msgspec
import zmq

from entoptic.tracker_bridge.access import Authenticator, ServerKeys, refuse_open
from entoptic.tracker_bridge.calibration import ShowScreen
from entoptic.tracker_bridge.clock import RoundTripClock
from entoptic.tracker_bridge.events import ClockEstimated
from entoptic.tracker_bridge.publisher import PortInUseError, bind
from entoptic.tracker_bridge.samples import NS_PER_S

ASK_AT_FIRST_NS, ASK_LATER_NS = 20_000_000, NS_PER_S
FIRST_ASKS = 16
"""A burst, then once a second."""
ASK_AGAIN_NS = NS_PER_S // 2
MAX_ANSWER_BYTES = 1024
"""No display has more to say; a connection that sends a longer message is closed."""
_MOST_ANSWERS = 1000
"""Kept while nobody asks for them."""
READY_WORDS = "Ready when you are."


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


class NoDisplay:
    """Says that it shows every screen, one frame after it was asked, and starts at once: for simulated eyes alone."""

    name = "none: simulated"
    connected = ready = True
    uncertainty_ns = unreadable = None
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

    def close(self) -> None:
        """Nothing is open."""


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
    """A display behind two sockets. Close it. Raises PortInUseError, or OpenAddressError where keys are missing."""

    def __init__(
        self,
        commands_address: str,
        answers_address: str,
        name: str = "a program on the sockets",
        *,
        keys: ServerKeys | None = None,
        context: zmq.Context[zmq.Socket[bytes]] | None = None,
    ) -> None:
        """`context`: one that has an authenticator already, to be ended after this is closed."""
        self.name = name
        self.unreadable: str | None = None
        """Why the display's last message was refused, if one was."""
        if keys is None:
            refuse_open((commands_address, answers_address))
        self._own_context: zmq.Context[zmq.Socket[bytes]] | None = None
        self._sockets: list[zmq.Socket[bytes]] = []
        if context is None:
            context = self._own_context = zmq.Context()
            if keys is not None:
                Authenticator(context, keys)
        self._context = context
        bell_address = f"inproc://calibration-bell-{id(self)}"
        try:
            self._rung = self._bind(zmq.PULL, bell_address, None)
            self._commands = self._bind(zmq.XPUB, commands_address, keys)
            self._collected = self._bind(zmq.PULL, answers_address, keys)
        except PortInUseError:
            self._close_sockets()
            raise
        self._bell = self._context.socket(zmq.PUSH)
        self._sockets.append(self._bell)
        self._bell.connect(bell_address)
        self.commands_address = self._commands.getsockopt_string(zmq.LAST_ENDPOINT)
        self.answers_address = self._collected.getsockopt_string(zmq.LAST_ENDPOINT)
        self._to_send: queue.SimpleQueue[ShowScreen | dict[str, object]] = queue.SimpleQueue()
        self._arrived: collections.deque[Answer] = collections.deque(maxlen=_MOST_ANSWERS)
        self._decoder = msgspec.msgpack.Decoder(DisplayMessage)
        self._latest: list[ShowScreen | dict[str, object]] = []
        """The last screen and the last sentence, the newer one last: for whoever comes."""
        self._displays = 0
        self._unanswered: ShowScreen | None = None
        self._again_ns = 0
        self._questions = itertools.count(1)
        self._closed = threading.Event()
        self._forget_clock()
        self.tell(READY_WORDS, again=True)
        self._thread = threading.Thread(target=self._run, name="calibration-display", daemon=True)
        self._thread.start()

    @property
    def connected(self) -> bool:
        """Whether a display follows the screens."""
        return self._displays > 0

    @property
    def ready(self) -> bool:
        """Whether one does whose clock is known."""
        return self.connected and self._uncertainty_ns is not None

    @property
    def uncertainty_ns(self) -> int | None:
        """How far the times of screens may be off."""
        return self._uncertainty_ns

    def show(self, command: ShowScreen) -> None:
        """Asks for a screen."""
        self._say(command)

    def tell(self, message: str, *, again: bool) -> None:
        """Shows a sentence on the grey screen, and whether a run can be started."""
        self._say({"message": message, "again": again})

    def answers(self, now_ns: int) -> list[Answer]:
        """What has come since the last call."""
        answers = []
        while self._arrived:
            answers.append(self._arrived.popleft())
        return answers

    def close(self) -> None:
        """Sends what is left, half a second at most."""
        self._closed.set()
        self._ring()
        self._thread.join()
        self._close_sockets()

    def _bind(self, kind: int, address: str, keys: ServerKeys | None) -> zmq.Socket[bytes]:
        socket = self._context.socket(kind)
        self._sockets.append(socket)
        socket.setsockopt(zmq.MAXMSGSIZE, MAX_ANSWER_BYTES)
        if kind == zmq.XPUB:
            socket.setsockopt(zmq.XPUB_VERBOSER, 1)
        if keys is not None:
            keys.use(socket)
        bind(socket, address)
        return socket

    def _close_sockets(self) -> None:
        for socket in self._sockets:
            socket.close(linger=500)
        if self._own_context is not None:
            self._own_context.term()

    def _say(self, item: ShowScreen | dict[str, object]) -> None:
        self._to_send.put(item)
        self._ring()

    def _ring(self) -> None:
        with contextlib.suppress(zmq.Again):  # it rings already
            self._bell.send(b"", zmq.DONTWAIT)

    def _forget_clock(self) -> None:
        self._clock = RoundTripClock()
        self._asked: dict[int, int] = {}
        """When each question was asked that is not answered yet."""
        self._asks = 0
        self._ask_ns = 0
        self._uncertainty_ns: int | None = None

    def _run(self) -> None:
        poller = zmq.Poller()
        for socket in (self._collected, self._commands, self._rung):
            poller.register(socket, zmq.POLLIN)
        while not self._closed.is_set():
            ready = dict(poller.poll(self._send_due()))
            if self._collected in ready:
                self._receive(self._collected.recv(), time.monotonic_ns())
            if self._commands in ready:
                self._note_display(self._commands.recv())
            if self._rung in ready:
                self._rung.recv()
        self._send_due()

    def _note_display(self, subscription: bytes) -> None:
        """One came or went."""
        came = subscription[:1] == b"\x01"
        self._displays += 1 if came else -1
        if came:
            for item in self._latest:
                self._send(item)
        elif not self._displays:
            self._forget_clock()
            self._arrived.append(Request.PAUSE)

    def _send_due(self) -> int:
        """Sends what is due; how many ms until something is again."""
        while not self._to_send.empty():
            item = self._to_send.get()
            self._latest = [*(other for other in self._latest if type(other) is not type(item)), item]
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
        due_ns = self._ask_ns if self._unanswered is None else min(self._ask_ns, self._again_ns)
        return max((due_ns - time.monotonic_ns()) // 1_000_000 + 1, 0)

    def _send(self, message: ShowScreen | dict[str, object]) -> None:
        self._commands.send(msgspec.msgpack.encode(message))

    def _receive(self, data: bytes, now_ns: int) -> None:
        try:
            message = self._decoder.decode(data)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            self.unreadable = str(error)
            return
        if message.request is not None:
            if message.request is Request.START:
                # Whoever starts may be another program, or the same with a clock that starts again.
                self._forget_clock()
            self._arrived.append(message.request)
        if message.t_ns is None:
            return
        if message.answer is not None and (sent_ns := self._asked.pop(message.answer, None)) is not None:
            for event in self._clock.add(sent_ns, message.t_ns, now_ns):
                if isinstance(event, ClockEstimated):
                    self._uncertainty_ns = event.uncertainty_ns
        if message.shown is not None and (shown_ns := self._clock.bridge_ns(message.t_ns)) is not None:
            if self._unanswered is not None and message.shown == self._unanswered.id:
                self._unanswered = None
            self._arrived.append(ScreenShown(message.shown, shown_ns))


Display = NoDisplay | SocketDisplay
