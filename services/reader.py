"""The worker's ear: a bridge's states, read losslessly by recorded time or always at the newest, and its events."""

from __future__ import annotations

import time
from collections.abc import Callable

import zmq
from zmq.utils.monitor import recv_monitor_message

from services.event_feed import EventFeed
from tracker_bridge import wire
from tracker_bridge.access import ClientKeys
from tracker_bridge.publisher import KEEPALIVE
from tracker_bridge.wire import EyeState, StreamEnded, StreamStarted

SILENCE_S = 10.0
"""A bridge that is silent for as long is taken for gone: ten heartbeats."""
TAIL_S = 2.0
"""After the end of a stream was announced its last states are there or lost: they left before."""
REFUSALS = 3
"""Connections cut off while keys are exchanged, after which the keys are taken to be wrong: one may be a bridge that is
just ending."""
_REFUSED = zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
_CUT_OFF = zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL


class ReaderError(Exception):
    """A bridge cannot be read: the message names its address and the remedy."""


class BridgeSilentError(ReaderError):
    """Nothing comes from the bridge."""


class BridgeRestartedError(ReaderError):
    """Another bridge took the place of the one that was read losslessly."""


class ShutOutError(ReaderError):
    """The bridge does not let this reader in."""


class StateReader:
    """All that a bridge says. `newest_only` keeps one state at most (CONFLATE), for a reader paced by the clock.

    What it missed it counts: `skipped` states, and of the `events` their `gaps` and how many were `lost`.
    """

    def __init__(
        self, states_address: str, events_address: str, *, newest_only: bool, keys: ClientKeys | None = None
    ) -> None:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._addresses = f"{states_address} and {events_address}"
        self._states = self._context.socket(zmq.SUB)
        self._states.setsockopt(zmq.LINGER, 0)
        self._states.setsockopt(zmq.CONFLATE, int(newest_only))
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
        self._read_state = wire.Reader(wire.decode_state)
        self.started: StreamStarted | None = None
        self.ended: StreamEnded | None = None
        self.received = 0
        """States read so far."""
        self.skipped = 0
        """States that were published between the first and the last one read and were not read: by intent with
        `newest_only`, lost otherwise."""
        self._position = 0
        """How far the stream is read: the number of the next state."""
        self._streams = 0
        self._pending: EyeState | None = None
        self._heard_s = time.monotonic()

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
        return time.monotonic() - max(self._heard_s, self.events.heard_s or 0.0)

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

    def until(self, t_ns: int, stopped: Callable[[], bool]) -> EyeState | None:
        """The newest state no younger than `t_ns`, of a stream read losslessly; None if there is none.

        Waits until a younger one has come, or the stream has ended and all of it is read.
        """
        newest: EyeState | None = None
        idle_since = time.monotonic()
        while not stopped():
            if self._pending is not None:
                if self._pending.t_ns > t_ns:
                    break
                newest, self._pending = self._pending, None
            if self._states.poll(50):
                self._pending = self._take()
                idle_since = time.monotonic()
                continue
            self._read_events()
            if self._streams > 1:
                raise BridgeRestartedError(
                    f"the bridge at {self._addresses} was started anew in mid-stream: start this reader anew too"
                )
            if self.ended is not None and (
                self._position >= self.ended.state_count or time.monotonic() - idle_since > TAIL_S
            ):
                self.skipped += max(self.ended.state_count - self._position, 0)
                self._position = max(self._position, self.ended.state_count)
                break
            if self.silent_s > SILENCE_S and time.monotonic() - idle_since > SILENCE_S:
                raise BridgeSilentError(f"nothing from {self._addresses} for {SILENCE_S:g} s, in mid-stream")
        return newest

    def newest(self) -> EyeState | None:
        """The newest state that has come since the last call, if any. Does not wait."""
        self._read_events()
        state = None
        while self._states.poll(0):
            state = self._take() or state
        return state

    def _take(self) -> EyeState | None:
        state = self._read_state.read(self._states.recv())
        self._heard_s = time.monotonic()
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
        for event in self.events.read(wait_ms):
            if isinstance(event, StreamStarted):
                self.started, self.ended = event, None
                self._streams += 1
            elif isinstance(event, StreamEnded):
                self.ended = event

    def close(self) -> None:
        """Closes all sockets."""
        self._context.destroy(linger=0)
