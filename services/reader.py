"""The worker's ear: the bridge's two sockets, read losslessly by recorded time or always at the newest state."""

from __future__ import annotations

import time
from collections.abc import Callable

import zmq

from tracker_bridge import wire
from tracker_bridge.wire import EyeState, StreamEnded, StreamStarted

SILENCE_S = 10.0
"""A bridge that is silent for as long is taken for gone."""


class BridgeSilentError(Exception):
    """Nothing comes from the bridge: the message names the address and the remedy."""


class StateReader:
    """Both sockets of a bridge. `newest_only` keeps one state at most (CONFLATE), for a reader paced by the clock."""

    def __init__(self, states_address: str, events_address: str, *, newest_only: bool) -> None:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._addresses = f"{states_address} and {events_address}"
        self._states = self._connect(states_address, newest_only=newest_only)
        self._events = self._connect(events_address, newest_only=False)
        self._read_state = wire.Reader(wire.decode_state)
        self._read_event = wire.Reader(wire.decode_event)
        self.started: StreamStarted | None = None
        self.ended: StreamEnded | None = None
        self.received = 0
        """States read so far."""
        self._pending: EyeState | None = None

    def _connect(self, address: str, *, newest_only: bool) -> zmq.Socket[bytes]:
        socket = self._context.socket(zmq.SUB)
        socket.setsockopt(zmq.LINGER, 0)
        socket.setsockopt(zmq.CONFLATE, int(newest_only))
        try:
            socket.connect(address)
        except zmq.ZMQError as error:
            self._context.destroy(linger=0)
            raise BridgeSilentError(
                f"cannot connect to {address}: {error.strerror}; give an address like tcp://127.0.0.1:5555"
            ) from None
        return socket

    def subscribe(self) -> None:
        """Says that this reader is ready: a bridge that waits for one starts now."""
        for socket in (self._states, self._events):
            socket.setsockopt(zmq.SUBSCRIBE, b"")

    @property
    def refused(self) -> dict[str, int]:
        """How many messages were refused, by the error's name."""
        return dict(self._read_state.refused + self._read_event.refused)

    def wait_for_start(self, stopped: Callable[[], bool], patience_s: float = 60.0) -> StreamStarted | None:
        """Subscribes and returns the stream's first message; None if asked to stop.

        Raises BridgeSilentError if none comes in time.
        """
        self.subscribe()
        deadline = time.monotonic() + patience_s
        while self.started is None and not stopped():
            if time.monotonic() > deadline:
                raise BridgeSilentError(
                    f"no stream at {self._addresses} for {patience_s:g} s: is the bridge running, and does it wait "
                    "for a reader (--wait) so that its start is not missed?"
                )
            self._drain_events(wait_ms=100)
        return self.started

    def until(self, t_ns: int, stopped: Callable[[], bool]) -> EyeState | None:
        """The newest state no younger than `t_ns`, of a stream read losslessly; None if there is none.

        Waits until a younger one has come, or the stream has ended and all of it is read.
        """
        newest: EyeState | None = None
        silent_since = time.monotonic()
        while not stopped():
            if self._pending is not None:
                if self._pending.t_ns > t_ns:
                    break
                newest, self._pending = self._pending, None
            if self._states.poll(50):
                self._pending = self._take()
                silent_since = time.monotonic()
                continue
            self._drain_events()
            if self.ended is not None and self.received >= self.ended.state_count:
                break
            if time.monotonic() - silent_since > SILENCE_S:
                raise BridgeSilentError(f"no state from {self._addresses} for {SILENCE_S:g} s, in mid-stream")
        return newest

    def newest(self) -> EyeState | None:
        """The newest state that has come since the last call, if any."""
        self._drain_events()
        state = None
        while self._states.poll(0):
            state = self._take() or state
        return state

    def _take(self) -> EyeState | None:
        state = self._read_state.read(self._states.recv())
        # A refused message was one of those the bridge counts.
        self.received += 1
        return state

    def _drain_events(self, wait_ms: int = 0) -> None:
        while self._events.poll(wait_ms):
            event = self._read_event.read(self._events.recv())
            if isinstance(event, StreamStarted):
                self.started = event
            elif isinstance(event, StreamEnded):
                self.ended = event
            wait_ms = 0

    def close(self) -> None:
        """Closes both sockets."""
        self._context.destroy(linger=0)
