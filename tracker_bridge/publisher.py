"""The sockets by which states and events leave the bridge, for any number of readers of any speed.

Theory of operation: three sockets, of which two publish. The bridge waits for no reader: one whose queue is full goes
without, and nobody else notices; the numbers show it what it missed. XPUB with NODROP says that a queue has become
full, so that it can be counted. Every event is also kept in a ring (replay.py), and a thread of its own answers readers
that ask for those they missed, whatever the bridge's thread does; it sleeps in the kernel otherwise.

Memory: the ring's 17 MB; for a reader that has stalled SEND_QUEUE messages of a socket, which are 0.5 MB of states; for
one that asks without reading ANSWER_QUEUE answers, 0.1 MB; beside what the kernel buffers for a connection.
"""

from __future__ import annotations

import secrets
import threading

import zmq

from entoptic.errors import EntopticError
from entoptic.tracker_bridge import access, replay, wire
from entoptic.tracker_bridge.access import Authenticator, ServerKeys
from entoptic.tracker_bridge.events import Event, Heartbeat
from entoptic.tracker_bridge.samples import EyeState

SEND_QUEUE = 1000
"""Messages kept for each reader: 2.5 s of states of two eyes at 200 Hz. Engineering choice: longer than any pause of a
reader that keeps up, short enough that what a stalled one costs does not matter."""
ANSWER_QUEUE = 4
"""Answers kept for each asker: they are long, and who asks again without reading needs no more."""
MAX_REQUEST_BYTES = 1024
"""Nobody has more to say to the bridge; a connection that sends a longer message is closed."""
HEARTBEAT_S = 1.0
LINGER_MS, LIVE_LINGER_MS = 2000, 300
"""What is queued at the end has so long to leave; what is live is old by then."""
KEEPALIVE = (
    (zmq.TCP_KEEPALIVE, 1),
    (zmq.TCP_KEEPALIVE_IDLE, 10),
    (zmq.TCP_KEEPALIVE_INTVL, 5),
    (zmq.TCP_KEEPALIVE_CNT, 4),
)
"""A machine that vanished without a word is given up after 30 s. Asked by the kernels, so that a reader which has only
stalled is not taken for gone."""


class PortInUseError(EntopticError):
    """An address cannot be bound: the message names it and the remedy."""


def bind(socket: zmq.Socket[bytes], address: str) -> None:
    """Has a socket listen. Raises PortInUseError."""
    try:
        socket.bind(address)
    except zmq.ZMQError as error:
        raise PortInUseError(
            f"cannot listen on {address}: {error.strerror}; choose another port, or tcp://127.0.0.1:* for any"
        ) from None


class Publisher:
    """Publishes states and numbered events, and answers for lost ones. All methods are for one thread.

    Raises PortInUseError, and OpenAddressError for an address that is not local unless there are keys.
    """

    def __init__(
        self,
        states_address: str,
        events_address: str,
        *,
        replay_address: str | None = None,
        keys: ServerKeys | None = None,
    ) -> None:
        """Without `replay_address` lost events are to be had at a free port of the events' host."""
        replay_address = replay_address or _another_port(events_address)
        if not replay_address.startswith("tcp://"):
            raise PortInUseError(
                f"cannot listen on {replay_address}: lost events go by TCP alone; give an address like tcp://127.0.0.1:5557"
            )
        if keys is None:
            access.refuse_open((states_address, events_address, replay_address))
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._authenticator = None if keys is None else Authenticator(self._context, keys)
        self._sockets: list[zmq.Socket[bytes]] = []
        try:
            self._states = self._bind(zmq.XPUB, states_address, keys)
            self._events = self._bind(zmq.XPUB, events_address, keys)
            replies = self._bind(zmq.REP, replay_address, keys)
        except PortInUseError:
            # Those of this thread alone: the authenticator's thread closes its own when the context ends.
            for socket in self._sockets:
                socket.close(linger=0)
            self._context.term()
            raise
        self._replay_at = replies.getsockopt_string(zmq.LAST_ENDPOINT)
        self._replay_port = int(self._replay_at.rpartition(":")[2])
        self._subscribed: dict[zmq.Socket[bytes], int] = {self._states: 0, self._events: 0}
        self._ring = replay.EventRing()
        self._stream = secrets.randbits(53)  # fits a double, for languages that know no other number
        self.stalls = 0
        """How often a reader fell behind by a whole queue, so that messages are left out for it."""
        self._replay_thread = threading.Thread(target=self._serve, args=(replies,), name="replay", daemon=True)
        self._replay_thread.start()

    def _bind(self, kind: int, address: str, keys: ServerKeys | None) -> zmq.Socket[bytes]:
        socket = self._context.socket(kind)
        self._sockets.append(socket)
        for option, value in KEEPALIVE:
            socket.setsockopt(option, value)
        socket.setsockopt(zmq.MAXMSGSIZE, MAX_REQUEST_BYTES)
        socket.setsockopt(zmq.LINGER, LINGER_MS)
        if kind == zmq.XPUB:
            socket.setsockopt(zmq.XPUB_NODROP, 1)
            socket.setsockopt(zmq.XPUB_VERBOSER, 1)  # each reader is told of, not only the first and the last
            socket.setsockopt(zmq.SNDHWM, SEND_QUEUE)
        else:
            socket.setsockopt(zmq.SNDHWM, ANSWER_QUEUE)
            socket.setsockopt(zmq.RCVHWM, ANSWER_QUEUE)
        if keys is not None:
            keys.use(socket)
        bind(socket, address)
        return socket

    @property
    def context(self) -> zmq.Context[zmq.Socket[bytes]]:
        """For further sockets of the bridge, which the same keys guard; to be closed before this one is."""
        return self._context

    @property
    def addresses(self) -> tuple[str, str]:
        """Where the states and the events are to be had."""
        return self._states.getsockopt_string(zmq.LAST_ENDPOINT), self._events.getsockopt_string(zmq.LAST_ENDPOINT)

    @property
    def replay_address(self) -> str:
        """Where lost events are to be had again. Every event says the port."""
        return self._replay_at

    @property
    def readers(self) -> int:
        """How many have subscribed to the states, as of the last heartbeat."""
        return self._subscribed[self._states]

    def publish_state(self, state: EyeState, *, sent_ns: int | None = None) -> None:
        """Sends a state to all that have room. `sent_ns`: now, for readers of a live stream."""
        self._send(self._states, wire.encode_state(state, sent_ns))

    def publish_event(self, event: Event) -> None:
        """Numbers, keeps and sends an event, as `publish_state` does. A heartbeat takes no number and is not kept."""
        self._note_readers()
        if isinstance(event, Heartbeat):
            self._send(self._events, self._encode(event, self._ring.last))
            return
        message = self._encode(event, self._ring.last + 1)
        self._ring.add(message)
        self._send(self._events, message)

    def _encode(self, event: Event, sequence: int) -> bytes:
        return wire.encode_event(event, stream=self._stream, sequence=sequence, replay_port=self._replay_port)

    def _send(self, socket: zmq.Socket[bytes], message: bytes) -> None:
        try:
            socket.send(message, zmq.DONTWAIT)
        except zmq.Again:
            # From here on libzmq passes over the full queues by itself, until they are read again.
            self.stalls += 1
            socket.setsockopt(zmq.XPUB_NODROP, 0)
            socket.send(message, zmq.DONTWAIT)
            socket.setsockopt(zmq.XPUB_NODROP, 1)

    def _note_readers(self) -> None:
        """Takes in who came and went: libzmq would keep it in memory for ever."""
        for socket in self._subscribed:
            while socket.poll(0, zmq.POLLIN):
                # 1 or 0, and the topic, of which there is but one.
                self._subscribed[socket] += {b"\x01": 1, b"\x00": -1}.get(socket.recv()[:1], 0)

    def _serve(self, replies: zmq.Socket[bytes]) -> None:
        """The other thread: answers until the context ends. Nothing else touches this socket."""
        try:
            while True:
                replies.send(replay.answer(self._ring, b"".join(replies.recv_multipart())))
        except zmq.ContextTerminated:
            pass
        finally:
            # Whatever happens: the context waits for its sockets to be closed.
            replies.close(linger=0)

    def close(self, linger_ms: int = LINGER_MS) -> None:
        """Sends what is queued, for so long at most, and closes."""
        self._states.close(linger_ms)
        self._events.close(linger_ms)
        self._context.term()
        self._replay_thread.join()
        if self._authenticator is not None:
            self._authenticator.join()


def _another_port(address: str) -> str:
    """A free port of the same host."""
    if not address.startswith("tcp://"):
        return "tcp://127.0.0.1:*"
    return address.rpartition(":")[0] + ":*"
