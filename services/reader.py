"""The worker's ear: a bridge's newest state, and its events."""

from __future__ import annotations

import collections
import time
from collections.abc import Callable, Iterable

import zmq
from zmq.utils.monitor import recv_monitor_message

from entoptic.errors import EntopticError
from entoptic.services.event_feed import EventFeed
from entoptic.tracker_bridge import wire
from entoptic.tracker_bridge.access import ClientKeys
from entoptic.tracker_bridge.publisher import KEEPALIVE
from entoptic.tracker_bridge.wire import Event, EyeState, SaccadeOffset, StreamEnded, StreamStarted

REFUSALS = 3
"""Connections cut off while keys are exchanged, after which the keys are taken to be wrong: one may be a bridge that is
just ending."""
MAX_SACCADES = 10_000
"""Kept until they are asked for: of an hour, at three a second."""
_REFUSED = zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
_CUT_OFF = zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL


class ReaderError(EntopticError):
    """A bridge cannot be read: the message names its address and the remedy."""


class BridgeSilentError(ReaderError):
    """Nothing comes from the bridge."""


class ShutOutError(ReaderError):
    """The bridge does not let this reader in."""


class StateReader:
    """All that a bridge says; of its states the newest one, for a reader paced by the clock.

    What it missed it counts: `skipped` states, and of the `events` their `gaps` and how many were `lost`.
    """

    def __init__(self, states_address: str, events_address: str, *, keys: ClientKeys | None = None) -> None:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._addresses = f"{states_address} and {events_address}"
        self._states = self._context.socket(zmq.SUB)
        self._states.setsockopt(zmq.LINGER, 0)
        self._states.setsockopt(zmq.CONFLATE, 1)
        for option, value in KEEPALIVE:
            self._states.setsockopt(option, value)
        if keys is not None:
            keys.use(self._states)
        # Before the connection: what fails on the way in is only said once.
        self._handshakes = self._states.get_monitor_socket(_REFUSED | _CUT_OFF)
        self._cut_off = 0
        address = states_address
        try:
            self._states.connect(address)
            address = events_address
            self.events = EventFeed(self._context, events_address, keys)
        except zmq.ZMQError as error:
            self._context.destroy(linger=0)
            raise BridgeSilentError(
                f"cannot connect to {address}: {error.strerror}; give an address like tcp://127.0.0.1:5555"
            ) from None
        self._read_state = wire.Reader(wire.decode_sent_state)
        self.started: StreamStarted | None = None
        self.ended: StreamEnded | None = None
        self.newest_sent_ns: int | None = None
        """When the bridge sent the state that was read last, on its clock; None where it does not say so."""
        self.received = 0
        """States read so far."""
        self.skipped = 0
        """States that were published between the first and the last one read and were not read."""
        self._position = 0
        """How far the stream is read: the number of the next state."""
        self._saccades: collections.deque[SaccadeOffset] = collections.deque(maxlen=MAX_SACCADES)
        self._received_s = time.monotonic()

    def subscribe(self) -> None:
        """Says that this reader is ready: a bridge that waits for one starts now."""
        for socket in (self._states, self.events.socket):
            socket.setsockopt(zmq.SUBSCRIBE, b"")

    @property
    def refused(self) -> dict[str, int]:
        """How many messages were refused, by the error's name."""
        return dict(self._read_state.refused + self.events.refused)

    @property
    def silent_s(self) -> float:
        """For how long the bridge has said nothing, neither a state nor a heartbeat."""
        return time.monotonic() - max(self._received_s, self.events.received_s or 0.0)

    def wait_for_start(self, stopped: Callable[[], bool], patience_s: float = 60.0) -> StreamStarted | None:
        """Subscribes and returns the stream's first message, however late this is; None if asked to stop.

        Raises BridgeSilentError if none comes in time, ShutOutError if the bridge has keys and does not know ours.
        """
        self.subscribe()
        deadline = time.monotonic() + patience_s
        while self.started is None and not stopped():
            self._raise_if_shut_out()
            if time.monotonic() > deadline:
                raise BridgeSilentError(
                    f"no stream at {self._addresses} for {patience_s:g} s: is the bridge running, and are these the "
                    "addresses it said?"
                )
            self._read_events(wait_ms=100)
        return self.started

    def _raise_if_shut_out(self) -> None:
        while self._handshakes.poll(0):
            event = recv_monitor_message(self._handshakes)["event"]
            self._cut_off += event == _CUT_OFF
            if event != _CUT_OFF or self._cut_off == REFUSALS:
                raise ShutOutError(
                    f"the bridge at {self._addresses} does not let this reader in: it wants a key that it knows (make "
                    "one with `entoptic keys --out keys --client NAME` beside the bridge's, and give --keys "
                    "keys/NAME), or has none itself"
                )

    def saccades_received(self) -> tuple[SaccadeOffset, ...]:
        """The saccades that have come since the last call, late ones too. Does not wait."""
        saccades = tuple(self._saccades)
        self._saccades.clear()
        return saccades

    def newest(self) -> EyeState | None:
        """The newest state that has come since the last call, if any. Does not wait."""
        self._read_events()
        state = None
        while self._states.poll(0):
            state = self._next_state() or state
        return state

    def _next_state(self) -> EyeState | None:
        message = self._read_state.read(self._states.recv())
        state, sent_ns = message or (None, None)
        if state is not None:
            self.newest_sent_ns = sent_ns
        self._received_s = time.monotonic()
        first = self.received == 0
        self.received += 1
        if state is None or state.sequence < self._position:
            # A refused message was one of those the bridge counts. A number that goes back is another bridge's.
            self._position = self._position + 1 if state is None else state.sequence + 1
            return state
        if not first:
            self.skipped += state.sequence - self._position
        self._position = state.sequence + 1
        return state

    def _read_events(self, wait_ms: int = 0) -> None:
        self._note(self.events.read(wait_ms))

    def _note(self, events: Iterable[Event]) -> None:
        for event in events:
            if isinstance(event, StreamStarted):
                self.started, self.ended = event, None
            elif isinstance(event, StreamEnded):
                self.ended = event
            elif isinstance(event, SaccadeOffset):
                self._saccades.append(event)

    def close(self) -> None:
        """Closes all sockets; once more does no harm."""
        if not self._states.closed:
            # Left to the context, a monitor that is told something meanwhile can hold up its end for ever.
            self._states.disable_monitor()
        self._context.destroy(linger=0)
