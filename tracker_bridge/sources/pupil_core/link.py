"""The two threads between Pupil Capture and its reader, and the box that they fill.

"pupil-bus" owns the SUB socket and does nothing but empty it, so that Capture never has to drop messages for us;
"pupil-remote" owns the REQ socket: it asks for the data port, for Capture's time once a second, and passes orders on.
Neither waits for the other or for the reader. Where the reader falls behind, the box keeps the newest messages and
counts the ones it lost.

The data port differs each time Capture is started, and a SUB socket at the old one stays silent without an error. So
after a second without data the port is asked for again, and after five the socket is replaced even if the port is the
same: a connection whose far end was switched off looks like a quiet one.
"""

from __future__ import annotations

import collections
import contextlib
import dataclasses
import queue
import threading
import time

import zmq

from entoptic.tracker_bridge.samples import NS_PER_S
from entoptic.tracker_bridge.sources.pupil_core import remote as pupil_remote
from entoptic.tracker_bridge.sources.pupil_core.bus import SUBSCRIPTIONS
from entoptic.tracker_bridge.sources.pupil_core.remote import Remote, RemoteAddress, RemoteError
from entoptic.tracker_bridge.sources.pupil_core.tasks import Order

ROOM = 2048
"""Messages that are kept. Engineering choice: at least 1.5 s of both eyes at 200 Hz with 2-D, 3-D and gaze, 10 MB at
most with their usual size."""
BURST = 16
"""Questions for the time when a connection is new: the least of their round trips is near the true least."""
URGENT_BURST = 4
"""And when a sample's time looks as if somebody had set the clock."""
ASK_EVERY_S = 1.0
SILENT_NS = NS_PER_S
"""No data for as long: ask for the data port again."""
REPLACE_NS = 5 * NS_PER_S
"""No data for as long: replace the SUB socket. Engineering choice."""
RETRY_S = 0.2
"""Pause after an attempt that failed. Engineering choice."""
_STOP_CHECK_MS = 50
"""How often a waiting thread looks whether it was told to stop; a message is taken at once."""
_QUEUED = 10_000
"""ZeroMQ's own queue of the SUB socket, messages: what may pile up while the interpreter is busy elsewhere."""


@dataclasses.dataclass(frozen=True, slots=True)
class Message:
    """One message off the data port."""

    received_ns: int
    frames: list[bytes]


@dataclasses.dataclass(frozen=True, slots=True)
class RoundTrip:
    """Capture was asked for its time."""

    sent_ns: int
    pupil_ns: int
    received_ns: int


@dataclasses.dataclass(frozen=True, slots=True)
class Connected:
    """Pupil Remote answers, and has named its data port."""

    t_ns: int
    version: str
    port: int


@dataclasses.dataclass(frozen=True, slots=True)
class Unreachable:
    """Pupil Remote does not answer, or is none."""

    reason: str


@dataclasses.dataclass(frozen=True, slots=True)
class OrderGiven:
    """An order is about to be sent."""

    order: Order


@dataclasses.dataclass(frozen=True, slots=True)
class OrderRefused:
    """An order could not be sent, or was not understood."""

    order: Order
    reason: str


News = RoundTrip | Connected | Unreachable | OrderGiven | OrderRefused


class Inbox:
    """Two queues of bounded length that keep the newest, for one reader."""

    def __init__(self, room: int = ROOM) -> None:
        self._messages: collections.deque[Message] = collections.deque(maxlen=room)
        self._notices: collections.deque[Message] = collections.deque(maxlen=room)
        self._news: collections.deque[News] = collections.deque(maxlen=room)
        self._filled = threading.Condition()
        self.dropped = 0
        """Messages that made room for newer ones."""

    def put_message(self, message: Message) -> None:
        """Samples push out older samples, but never a notification."""
        topic = message.frames[0]
        queue_ = self._notices if topic.startswith((b"notify.", b"logging.")) else self._messages
        with self._filled:
            self.dropped += len(queue_) == queue_.maxlen
            queue_.append(message)
            self._filled.notify()

    def put_news(self, news: News) -> None:
        """From the conversation with Pupil Remote."""
        with self._filled:
            self._news.append(news)
            self._filled.notify()

    def take(self, patience_s: float) -> tuple[list[News], list[Message]]:
        """All there is, each kind in order of arrival, notifications before samples; waits only if there is none."""
        with self._filled:
            if not (self._news or self._notices or self._messages):
                self._filled.wait(patience_s)
            news, messages = [*self._news], [*self._notices, *self._messages]
            self._news.clear()
            self._notices.clear()
            self._messages.clear()
        return news, messages


class Link:
    """Both threads, from `start` to `close`."""

    def __init__(self, address: RemoteAddress, *, room: int = ROOM) -> None:
        self.inbox = Inbox(room)
        self._address = address
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._stop = threading.Event()
        self._wanted: tuple[str, int] | None = None
        """Where the SUB socket should be, and the how manieth one."""
        self._moved = threading.Event()
        self._data_ns = 0
        """When data last came, or the SUB socket was last replaced."""
        self._todo: queue.SimpleQueue[Order | None] = queue.SimpleQueue()
        """Orders; None: ask for the time now, or stop."""
        self._time_wanted = False
        self._threads = (
            threading.Thread(target=self._drain, name="pupil-bus", daemon=True),
            threading.Thread(target=self._converse, name="pupil-remote", daemon=True),
        )

    def start(self) -> None:
        """Starts both threads."""
        for thread in self._threads:
            thread.start()

    def ask_time(self) -> None:
        """Has Capture asked for its time at once."""
        if not self._time_wanted:
            self._time_wanted = True
            self._todo.put(None)

    def give(self, order: Order) -> None:
        """Sends an order to Capture; what becomes of it comes out of the inbox."""
        # Noted before it is sent, so that no notification can come before it is waited for.
        self.inbox.put_news(OrderGiven(order))
        self._todo.put(order)

    def close(self) -> None:
        """Ends both threads and frees their sockets, within about 0.1 s."""
        self._stop.set()
        self._moved.set()
        self._todo.put(None)
        for thread in self._threads:
            thread.join()
        self._context.destroy(linger=0)

    # The data port: the thread "pupil-bus".

    def _drain(self) -> None:
        while not self._stop.is_set():
            wanted = self._wanted
            if wanted is None:
                self._moved.wait()
                continue
            try:
                with self._context.socket(zmq.SUB) as socket:
                    socket.setsockopt(zmq.LINGER, 0)
                    socket.setsockopt(zmq.RCVHWM, _QUEUED)
                    for topic in SUBSCRIPTIONS:
                        socket.setsockopt(zmq.SUBSCRIBE, topic)
                    socket.connect(wanted[0])
                    while self._wanted == wanted and not self._stop.is_set():
                        if socket.poll(_STOP_CHECK_MS):
                            self._receive_all(socket)
            except zmq.ZMQError:
                # The conversation tells a person what is wrong; here there is only another attempt.
                self._stop.wait(RETRY_S)

    def _receive_all(self, socket: zmq.Socket[bytes]) -> None:
        with contextlib.suppress(zmq.Again):
            while not self._stop.is_set():
                frames = socket.recv_multipart(zmq.DONTWAIT)
                message = Message(time.monotonic_ns(), frames)
                if frames[0].startswith((b"pupil", b"gaze")):
                    self._data_ns = message.received_ns
                self.inbox.put_message(message)

    def _move(self, endpoint: str) -> None:
        number = 0 if self._wanted is None else self._wanted[1] + 1
        self._wanted = (endpoint, number)
        self._data_ns = time.monotonic_ns()
        self._moved.set()

    # The conversation: the thread "pupil-remote".

    def _converse(self) -> None:
        remote = Remote(self._context, self._address, stopped=self._stop.is_set, timeout_s=pupil_remote.TIMEOUT_S)
        try:
            while not self._stop.is_set():
                try:
                    self._meet(remote)
                    while not self._stop.is_set():
                        self._keep_up(remote)
                except RemoteError as error:
                    self.inbox.put_news(Unreachable(str(error)))
                    self._refuse_waiting(str(error))
                    self._stop.wait(RETRY_S)
        finally:
            remote.close()

    def _meet(self, remote: Remote) -> None:
        """Data port, version and time, in this order: the first answers of a connection are slow."""
        port = pupil_remote.port_of(remote.ask(pupil_remote.SUB_PORT).text)
        version = pupil_remote.version_of(remote.ask(pupil_remote.VERSION).text)
        for _ in range(BURST):
            self._ask_time(remote)
        self.inbox.put_news(Connected(time.monotonic_ns(), version, port))
        self._listen_at(port)

    def _listen_at(self, port: int) -> None:
        endpoint = self._address.data(port)
        silent_ns = time.monotonic_ns() - self._data_ns
        if self._wanted is None or self._wanted[0] != endpoint or silent_ns > REPLACE_NS:
            self._move(endpoint)

    def _ask_time(self, remote: Remote) -> None:
        answer = remote.ask(pupil_remote.TIME)
        self.inbox.put_news(RoundTrip(answer.sent_ns, pupil_remote.pupil_ns_of(answer.text), answer.received_ns))

    def _keep_up(self, remote: Remote) -> None:
        """One second: orders as they are given, then the time, and the data port if there is no data."""
        due = time.monotonic() + ASK_EVERY_S
        while (left_s := due - time.monotonic()) > 0:
            try:
                order = self._todo.get(timeout=left_s)
            except queue.Empty:
                break
            if self._stop.is_set():
                return
            if order is not None:
                self._pass_on(remote, order)
            elif self._time_wanted:
                self._time_wanted = False
                for _ in range(URGENT_BURST):
                    self._ask_time(remote)
        self._ask_time(remote)
        if time.monotonic_ns() - self._data_ns > SILENT_NS:
            port = pupil_remote.port_of(remote.ask(pupil_remote.SUB_PORT).text)
            if self._wanted is not None and self._wanted[0] != self._address.data(port):
                # Another port is another Capture, with another clock.
                self._meet(remote)
            else:
                self._listen_at(port)

    def _pass_on(self, remote: Remote, order: Order) -> None:
        try:
            pupil_remote.check_accepted(remote.ask(order.request).text)
        except pupil_remote.RemoteReplyError as error:
            self.inbox.put_news(OrderRefused(order, str(error)))
        except RemoteError as error:
            self.inbox.put_news(OrderRefused(order, str(error)))
            raise

    def _refuse_waiting(self, reason: str) -> None:
        """Nobody answers: an order that waited until somebody does might be carried out an hour late."""
        self._time_wanted = False
        with contextlib.suppress(queue.Empty):
            while True:
                order = self._todo.get_nowait()
                if order is not None:
                    self.inbox.put_news(OrderRefused(order, reason))
