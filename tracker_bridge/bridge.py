"""From samples to published states: the chain, which is pure, and the one loop that runs it.

The chain's latency is zero: a state is made of each group of samples with one time, as soon as it is complete.
"""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections.abc import Callable, Iterator

import zmq

from tracker_bridge import wire
from tracker_bridge.dropout import DropoutFilter, Shown
from tracker_bridge.samples import (
    Direction,
    Event,
    Eye,
    EyeState,
    GazeSample,
    OneEyeState,
    Phase,
    PupilSample,
    Source,
    StreamEnded,
    StreamStarted,
)

MIN_GAZE_CONFIDENCE = 0.6
"""As for pupils: below it a direction is the detector's guess."""


@dataclasses.dataclass
class _EyeMemory:
    filter: DropoutFilter = dataclasses.field(default_factory=DropoutFilter)
    shown: Shown | None = None
    sample: PupilSample | None = None
    gaze: Direction | None = None

    def state(self) -> OneEyeState:
        if self.sample is None or self.shown is None:
            return OneEyeState(Phase.LOST, None, None, 0.0, None, self.gaze)
        return OneEyeState(
            phase=self.shown.phase,
            diameter_mm=self.shown.diameter_mm,
            measured_mm=self.sample.diameter_mm,
            confidence=self.sample.confidence,
            openness=self.sample.openness,
            gaze=self.gaze,
        )


def states_of(samples: Iterator[PupilSample | GazeSample]) -> Iterator[tuple[EyeState, tuple[Event, ...]]]:
    """A snapshot, and the events that came with it, for each moment of time-ordered samples.

    Where a source gives each eye's gaze but not both eyes' together, the latter is the mean of the eyes that were
    seen within 50 ms.
    """
    eyes = {eye: _EyeMemory() for eye in Eye}
    both: Direction | None = None
    source_gives_both = False
    groups = itertools.groupby(samples, key=lambda sample: sample.t_ns)
    for sequence, (t_ns, group) in enumerate(groups):
        events: list[Event] = []
        for sample in group:
            if isinstance(sample, PupilSample):
                memory = eyes[sample.eye]
                memory.sample, memory.shown = sample, memory.filter.step(sample)
                events.extend(memory.shown.events)
            elif sample.confidence >= MIN_GAZE_CONFIDENCE:
                direction = Direction(sample.azimuth_deg, sample.elevation_deg, t_ns)
                if sample.eye is None:
                    both, source_gives_both = direction, True
                else:
                    eyes[sample.eye].gaze = direction
        if not source_gives_both:
            both = _mean_direction([memory.gaze for memory in eyes.values()], t_ns) or both
        state = EyeState(sequence, t_ns, right=eyes[Eye.RIGHT].state(), left=eyes[Eye.LEFT].state(), gaze=both)
        yield state, tuple(events)


def _mean_direction(directions: list[Direction | None], t_ns: int) -> Direction | None:
    fresh = [direction for direction in directions if direction is not None and t_ns - direction.t_ns <= 50_000_000]
    if not fresh:
        return None
    return Direction(
        sum(direction.azimuth_deg for direction in fresh) / len(fresh),
        sum(direction.elevation_deg for direction in fresh) / len(fresh),
        max(direction.t_ns for direction in fresh),
    )


class PortInUseError(Exception):
    """An address cannot be bound: the message names it and the remedy."""


class Publisher:
    """Two sockets, states and events, that wait for a slow reader rather than losing a message for it.

    XPUB with NODROP: a send blocks while a subscriber's queue is full. A bridge that must not wait gives up that
    state instead (`wait=False`), which its sequence number shows.
    """

    def __init__(self, states_address: str, events_address: str) -> None:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._states = self._bind(states_address)
        self._events = self._bind(events_address)
        self.dropped = 0
        """States that no queue had room for."""

    def _bind(self, address: str) -> zmq.Socket[bytes]:
        socket = self._context.socket(zmq.XPUB)
        socket.setsockopt(zmq.XPUB_NODROP, 1)
        socket.setsockopt(zmq.SNDHWM, 1000)
        socket.setsockopt(zmq.LINGER, 2000)
        try:
            socket.bind(address)
        except zmq.ZMQError as error:
            self.close()
            raise PortInUseError(
                f"cannot listen on {address}: {error.strerror}; choose another port, or tcp://127.0.0.1:* for any"
            ) from None
        return socket

    @property
    def addresses(self) -> tuple[str, str]:
        """Where the states and the events are to be had."""
        return self._states.getsockopt_string(zmq.LAST_ENDPOINT), self._events.getsockopt_string(zmq.LAST_ENDPOINT)

    def wait_for_reader(self, stopped: Callable[[], bool]) -> None:
        """Returns once somebody has subscribed to both sockets, or when `stopped` says so."""
        for socket in (self._states, self._events):
            while not stopped():
                if socket.poll(100) and socket.recv()[:1] == b"\x01":
                    break

    def publish_state(self, state: EyeState, *, wait: bool, stopped: Callable[[], bool]) -> None:
        """Sends a state, waiting for room or giving it up."""
        if not self._send(self._states, wire.encode(state), wait, stopped):
            self.dropped += 1

    def publish_event(self, event: Event, *, stopped: Callable[[], bool]) -> None:
        """Sends an event, waiting for room."""
        self._send(self._events, wire.encode(event), True, stopped)

    def _send(self, socket: zmq.Socket[bytes], message: bytes, wait: bool, stopped: Callable[[], bool]) -> bool:
        while True:
            try:
                socket.send(message, zmq.DONTWAIT)
                return True
            except zmq.Again:
                if not wait or stopped():
                    return False
                socket.poll(50, zmq.POLLOUT)

    def close(self) -> None:
        """Sends what is queued, for 2 s at most, and closes."""
        self._context.destroy()


def run(
    source: Source,
    publisher: Publisher,
    *,
    real_time: bool,
    seconds: float | None,
    stopped: Callable[[], bool],
    on_state: Callable[[EyeState, tuple[Event, ...]], None],
) -> int:
    """Publishes a source until it ends, `seconds` of it are over or `stopped` says so; returns the count of states.

    In real time each state goes out when its recorded time has come and nobody is waited for; otherwise as fast as
    the slowest reader takes them. `on_state` sees every state and its events, published or not.
    """
    start_ns, begun_ns = source.info.t_start_ns, time.monotonic_ns()
    ends_ns = [source.info.t_end_ns, None if seconds is None else start_ns + round(seconds * 1e9)]
    end_ns = min((end for end in ends_ns if end is not None), default=None)
    publisher.publish_event(StreamStarted(start_ns, end_ns, source.info.name), stopped=stopped)
    count, t_ns = 0, start_ns
    for state, events in states_of(source.samples()):
        if stopped() or (end_ns is not None and state.t_ns > end_ns):
            break
        if real_time:
            _sleep_until(begun_ns + state.t_ns - start_ns, stopped)
        count, t_ns = count + 1, state.t_ns
        on_state(state, events)
        for event in events:
            publisher.publish_event(event, stopped=stopped)
        publisher.publish_state(state, wait=not real_time, stopped=stopped)
    publisher.publish_event(StreamEnded(t_ns, count), stopped=stopped)
    return count


def _sleep_until(when_ns: int, stopped: Callable[[], bool]) -> None:
    while not stopped() and (left_ns := when_ns - time.monotonic_ns()) > 0:
        time.sleep(min(left_ns * 1e-9, 0.05))
