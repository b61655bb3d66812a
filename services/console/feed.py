"""States, events and frames' figures from bridge and worker, as messages to pages.

Theory of operation: one thread reads three sockets. What came within a batch's time leaves as one message of each kind,
encoded once for all pages, however many there are. The last seconds of traces and marks are kept for pages that come
later. Nothing waits for a page.
"""

from __future__ import annotations

import collections
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Literal

import msgspec
import zmq

from entoptic.services.console import protocol
from entoptic.services.console.figures import Figures
from entoptic.services.console.listening import Listening
from entoptic.services.console.protocol import EyeTrace, Mark, Marks, ShownNow, Traces
from entoptic.services.event_feed import EventFeed
from entoptic.services.ipc import messages
from entoptic.services.ipc.addresses import Addresses
from entoptic.services.ipc.messages import SHOWN, MessageError, Shown
from entoptic.tracker_bridge import wire
from entoptic.tracker_bridge.access import ClientKeys
from entoptic.tracker_bridge.wire import NS_PER_S, Event, Eye, EyeState

BATCH_S = 0.04
MAX_STATES = 20
"""In a batch: of trackers above 500 Hz every second or third is shown."""
KEPT_S = 10.0
"""Of traces and marks, for pages that come later."""
AWAY_S, AHEAD_S = 5.0, 0.5
"""Times so long ago, or so far ahead, are of another machine's clock, or what was taken for now had waited: from then
on the newest one is taken for now."""

OnMessages = Callable[[list[bytes]], None]


class Timeline:
    """From a sender's nanoseconds to seconds since the server's zero."""

    def __init__(self, zero_s: float) -> None:
        self._zero_s, self._off_s = zero_s, 0.0

    def t_s(self, t_ns: int, now_s: float) -> float:
        """`now_s` is the server's monotonic clock."""
        t_s = t_ns / NS_PER_S + self._off_s
        if not now_s - AWAY_S <= t_s <= now_s + AHEAD_S:
            self._off_s += now_s - t_s
            t_s = now_s
        return round(t_s - self._zero_s, 4)

    def as_before(self, t_ns: int) -> float:
        """For what may be long ago."""
        return round(t_ns / NS_PER_S + self._off_s - self._zero_s, 4)


class Feed(Listening):
    """Reads from its making until closed; `on_messages` is called by its thread with encoded messages."""

    def __init__(
        self,
        addresses: Addresses,
        zero_s: float,
        on_messages: OnMessages,
        bridge_keys: ClientKeys | None = None,
        worker_keys: ClientKeys | None = None,
    ) -> None:
        """`zero_s`: the pages' zero on the monotonic clock. Raises zmq.ZMQError for an address that is none."""
        super().__init__()
        self.addresses = addresses
        self.figures = Figures()
        self._zero_s, self._on_messages = zero_s, on_messages
        self._kept: collections.deque[tuple[float, bytes]] = collections.deque()
        self._lock = threading.Lock()
        with self._opening():
            self._states = self._connected(addresses.states, bridge_keys)
            self._shown = self._connected(addresses.frames, worker_keys)
            self._events = EventFeed(self._context, addresses.events, bridge_keys)
        for socket, topic in ((self._states, b""), (self._shown, SHOWN), (self._events.socket, b"")):
            socket.setsockopt(zmq.SUBSCRIBE, topic)
        self._read_state = wire.Reader(wire.decode_state)
        self._eyes, self._frames = Timeline(zero_s), Timeline(zero_s)
        self._thread.start()

    def kept(self) -> list[bytes]:
        """Messages of the last seconds."""
        with self._lock:
            return [message for _, message in self._kept]

    def _run(self) -> None:
        due_s = time.monotonic()
        while not self._stop.wait(max(due_s - time.monotonic(), 0.0)):
            due_s = max(due_s + BATCH_S, time.monotonic())
            now_s = time.monotonic()
            states = [state for message in _waiting(self._states) if (state := self._read_state.read(message[-1]))]
            for state in states:
                self.figures.add_state(state, now_s)
            shown = self._newest_shown(now_s)
            kept = [protocol.encode(self._traces(states, now_s))]
            if events := self._events.read():
                marks = [mark for event in events if (mark := mark_of(event, self._eyes))]
                # A feed that begins is told all that ever happened: what is long ago is no news, and would crowd the
                # rest out of a page's queue.
                since_s = now_s - self._zero_s - KEPT_S
                if marks := [mark for mark in marks if mark.t_s >= since_s]:
                    kept.append(protocol.encode(Marks(marks)))
            with self._lock:
                if states or events:
                    self._kept.extend((now_s, message) for message in kept)
                while self._kept and self._kept[0][0] < now_s - KEPT_S:
                    self._kept.popleft()
            self._on_messages([*kept, *shown])

    def _newest_shown(self, now_s: float) -> list[bytes]:
        encoded = []
        for parts in _waiting(self._shown):
            try:
                shown = messages.decode(parts[-1], Shown)
            except MessageError:
                continue
            self.figures.add_shown(shown, now_s)
            encoded.append(protocol.encode(shown_of(shown, self._frames.t_s(shown.t_ns, now_s))))
        return encoded

    def _traces(self, states: list[EyeState], now_s: float) -> Traces:
        stride = -(-len(states) // MAX_STATES) or 1
        seen = states[::-stride][::-1]  # the newest is always there
        return Traces(
            round(now_s - self._zero_s, 4),
            [self._eyes.t_s(state.t_ns, now_s) for state in seen],
            _trace([state.left for state in seen]),
            _trace([state.right for state in seen]),
            [_angles(state.gaze) for state in seen],
        )


def _waiting(socket: zmq.Socket[bytes]) -> Iterable[list[bytes]]:
    """All that has come, of any number of parts."""
    while socket.poll(0):
        yield socket.recv_multipart()


def _trace(states: list[wire.OneEyeState]) -> EyeTrace:
    return EyeTrace(
        [_short(state.measured_mm) for state in states],
        [_short(state.pupil_diameter_mm) for state in states],
        [state.phase.value for state in states],
        [_short(state.openness) for state in states],
        [state.borrowed for state in states],
    )


def _angles(gaze: wire.Direction | None) -> tuple[float, float] | None:
    return None if gaze is None else (round(gaze.azimuth_deg, 3), round(gaze.elevation_deg, 3))


def _short(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


def shown_of(shown: Shown, t_s: float) -> ShownNow:
    """What a page is told of a frame."""
    return ShownNow(**{**msgspec.structs.asdict(shown), "t_s": t_s, "recording": name_of(shown.recording)})


def name_of(folder: str | None) -> str | None:
    """A recording's name; the folder has another ending while it is written."""
    return None if folder is None else Path(folder).name.removesuffix(".partial")


def mark_of(event: Event, timeline: Timeline) -> Mark | None:
    """What a page is told of an event; None for what is no news to a person."""
    t_s = timeline.as_before(event.t_ns)
    match event:
        case wire.BlinkOnset(eye=eye):
            return Mark("blink onset", t_s, eye=_name(eye))
        case wire.BlinkOffset(eye=eye, duration_ns=lasted_ns):
            return Mark("blink", round(t_s - lasted_ns / NS_PER_S, 4), t_s, _name(eye))
        case wire.PupilLost(eye=eye):
            return Mark("pupil lost", t_s, eye=_name(eye))
        case wire.PupilBack(eye=eye):
            return Mark("pupil back", t_s, eye=_name(eye))
        case wire.SaccadeOffset():
            begun_s, ended_s = timeline.as_before(event.onset_ns), timeline.as_before(event.offset_ns)
            is_micro = event.kind is wire.SaccadeKind.MICROSACCADE
            what: Literal["saccade", "microsaccade"] = "microsaccade" if is_micro else "saccade"
            return Mark(what, begun_s, ended_s, amplitude_deg=_short(event.amplitude_deg))
        case wire.SourceSilent(reason=reason):
            return Mark("source silent", t_s, text=reason)
        case wire.SourceBack():
            return Mark("source back", t_s)
        case wire.ClockJumped(jump_ns=jump_ns):
            return Mark("clock jumped", t_s, text=f"the tracker's clock was set by {jump_ns / 1e6:+.0f} ms")
        case wire.TrackerTask(kind=kind, outcome=outcome, detail=detail):
            return Mark("tracker task", t_s, text=detail, task=kind.value, outcome=outcome.value)
        case wire.TrackerStatus(detail=detail):
            return Mark("tracker status", t_s, text=detail)
        case wire.StreamStarted(source=source):
            return Mark("stream started", t_s, text=source)
        case wire.StreamEnded():
            return Mark("stream ended", t_s)
    return None


def _name(eye: Eye) -> Literal["left", "right"]:
    return "left" if eye is Eye.LEFT else "right"
