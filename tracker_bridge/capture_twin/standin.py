"""The program: Pupil Remote, the backbone, and one loop that sends everything at its time.

All sockets live in the thread that calls `run`, so that requests, messages and faults have one order.
"""

from __future__ import annotations

import dataclasses
import heapq
import itertools
import math
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np
import structlog
import zmq

from entoptic.tracker_bridge.capture_twin import CaptureError
from entoptic.tracker_bridge.capture_twin.backbone import Backbone, frames_of, notification, waiting
from entoptic.tracker_bridge.capture_twin.blinks import BlinkFilter
from entoptic.tracker_bridge.capture_twin.clock import CaptureClock
from entoptic.tracker_bridge.capture_twin.faults import Fault, Faults, PlannedFault
from entoptic.tracker_bridge.capture_twin.playback import Ahead, Playback
from entoptic.tracker_bridge.capture_twin.published import retimed
from entoptic.tracker_bridge.capture_twin.remote import VERSION, RemoteKilledError, answer
from entoptic.tracker_bridge.capture_twin.tasks import FIT_S, Calibration, Recording, command
from entoptic.tracker_bridge.sources.pupil_core.form import Map
from entoptic.tracker_bridge.sources.pupil_core.recorder import RecordingError

_DETECTION_S: Final = 0.01
"""From an image to its pupil datum: exposure, transfer and detection at 200 Hz. Engineering choice."""

_WORLD_FRAME_S: Final = 1 / 30
"""Gaze and blinks are made once a frame of the world camera, 30 a second unless its user changes it."""

_LONGEST_WAIT_S: Final = 0.05
"""How soon a request to stop is seen. Engineering choice."""

_LAST_GASP_S: Final = 0.1
"""A program that is about to die leaves what it was asked in its last moments unanswered. Engineering choice."""

_LARGEST_OFFSET_S: Final = 1e5
"""How far Pupil time may be ahead of this machine's clock: about a day. Engineering choice."""


@dataclasses.dataclass(frozen=True)
class StandInSettings:
    """How the stand-in runs."""

    port: int
    """Of Pupil Remote; 0 for any."""
    recordings: Path
    host: str = "127.0.0.1"
    seed: int = 0
    """Draws the offset of Pupil time."""
    faults: tuple[PlannedFault, ...] = ()
    seconds: float | None = None
    fit_s: float = FIT_S
    """How long a calibration is fitted."""


class AddressError(CaptureError):
    """The stand-in cannot be reached where it was told to be."""


class StandIn:
    """A program that looks like Pupil Capture from outside, from construction to `run`'s end.

    Raises AddressError, and SourceError where the eyes' data cannot be played.
    """

    def __init__(
        self, playback: Playback, settings: StandInSettings, log: structlog.typing.FilteringBoundLogger
    ) -> None:
        self._settings, self._log = settings, log
        self._moments = Ahead(playback.moments)
        self._next = self._moments.wait()
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._faults = Faults(settings.faults)
        self._start_s = time.monotonic()
        offset_s = float(np.random.default_rng(settings.seed).uniform(0.0, _LARGEST_OFFSET_S))
        self._clock = CaptureClock(self._start_s, offset_s)
        self._remote: zmq.Socket[bytes] | None = None
        self._backbone: Backbone | None = None
        self._begin()
        self._outbox: list[tuple[float, int, list[bytes]]] = []
        self._numbers = itertools.count()
        self._next_frame_s = self._start_s
        self._back_s: float | None = None
        self.remote_port = settings.port
        try:
            self._open_sockets()
        except zmq.ZMQError as error:
            self._moments.close()
            self._context.destroy(linger=0)
            raise AddressError(f"{settings.host}: {error}; choose an address of this machine") from None
        log.info("ready", remote=f"tcp://{settings.host}:{self.remote_port}", version=VERSION, source=playback.name)
        for note in playback.notes:
            log.info("source", note=note)

    @property
    def ports(self) -> tuple[int, int]:
        """The backbone's ports: that for subscribers, that for publishers; zeros while the program is down."""
        return (0, 0) if self._backbone is None else (self._backbone.sub_port, self._backbone.pub_port)

    def pupil_s(self) -> float:
        """Pupil time now."""
        return self._clock.pupil_s(time.monotonic())

    def set_pupil_s(self, pupil_s: float) -> None:
        """Sets Pupil time, which breaks a running calibration of the real program."""
        self._clock.set(time.monotonic(), pupil_s)
        self._log.warning("a client set the clock", pupil_s=pupil_s)

    def notify(self, subject: str, **fields: Any) -> None:
        """Sends a notification of the program's own to all, and to itself."""
        self._announce([command(subject, **fields)])

    def forward(self, frames: list[bytes]) -> None:
        """Sends a client's message to all, and to the program itself."""
        if self._backbone is not None:
            self._backbone.publish(frames)
        if frames[0].startswith(b"notify."):
            self._take_notice(frames)

    def run(self, stop: Callable[[], bool]) -> None:
        """Runs until it is told to stop, its time is over, or its eyes' data end."""
        try:
            while not stop() and not self._is_over():
                now_s = time.monotonic()
                self._fail(now_s)
                due_s = self._send_due(now_s)
                self._work(now_s)
                self._listen(min(max(due_s - time.monotonic(), 0.0), _LONGEST_WAIT_S))
        finally:
            self.close()

    def close(self) -> None:
        """Frees all ports and ends a recording that is running."""
        self._moments.close()
        self._end_recording()
        self._close_sockets()
        # And what a start that failed halfway has left: `term` would wait for it for ever.
        self._context.destroy(linger=0)

    def _begin(self) -> None:
        """The state of a program that has just started."""
        self._eyes_alive = True
        self._blinks = BlinkFilter()
        self._calibration = Calibration(self._settings.fit_s)
        self._recording = Recording(self._settings.recordings)
        self._flat: list[Map] = []
        self._gazes: list[Map] = []

    def _is_over(self) -> bool:
        seconds = self._settings.seconds
        if seconds is not None and time.monotonic() - self._start_s >= seconds:
            return True
        return self._moments.ended and not self._outbox and not self._gazes

    def _bound(self, port: int) -> tuple[zmq.Socket[bytes], int]:
        """A socket for Pupil Remote, and the port that it got.

        A router, not a REP socket: it must be able to leave a request unanswered.
        """
        socket: zmq.Socket[bytes] = self._context.socket(zmq.ROUTER)
        socket.linger = 0
        host = f"tcp://{self._settings.host}"
        if port == 0:
            return socket, socket.bind_to_random_port(host)
        try:
            socket.bind(f"{host}:{port}")
        except zmq.ZMQError as error:
            taken_for = socket.bind_to_random_port(host)
            self._log.warning("Pupil Remote's port is taken", port=port, took=taken_for, why=str(error))
            return socket, taken_for
        return socket, port

    def _open_sockets(self) -> None:
        self._remote, self.remote_port = self._bound(self.remote_port)
        self._backbone = Backbone(self._context, self._settings.host)
        sub_port, pub_port = self.ports
        self._log.info("backbone", sub_port=sub_port, pub_port=pub_port)

    def _fail(self, now_s: float) -> None:
        """Begins the faults that are due."""
        if self._back_s is not None and now_s >= self._back_s:
            self._come_back()
        for plan in self._faults.begun(now_s - self._start_s):
            self._log.info("fault", fault=plan.fault.value, value=plan.value)
            if plan.fault is Fault.DRIFT:
                self._clock.drift(now_s, plan.value)
            elif plan.fault is Fault.TIMEBASE:
                self._clock.jump(plan.value)
            elif plan.fault is Fault.RESTART:
                self._back_s = self._start_s + plan.end_s
                self._end_recording()
                self._close_sockets()

    def _come_back(self) -> None:
        self._back_s = None
        self._clock.restart()
        self._begin()
        self._outbox.clear()
        self._open_sockets()

    def _close_sockets(self) -> None:
        if self._remote is not None:
            self._remote.close()
        if self._backbone is not None:
            self._backbone.close()
        self._remote = self._backbone = None

    def _send_due(self, now_s: float) -> float:
        """Sends what is due. Returns when the next is, as far as is known."""
        while self._next is not None and self._due_s(self._next.at_s) <= now_s:
            self._detect(self._next.pupils, now_s)
            self._gazes += [self._timed(gaze) for gaze in self._next.gazes]
            self._next = self._moments.take()
        if self._next is None:
            self._next = self._moments.take()
        if now_s >= self._next_frame_s:
            self._next_frame_s += _WORLD_FRAME_S * math.ceil((now_s - self._next_frame_s) / _WORLD_FRAME_S + 1e-9)
            if not self._calibration.is_fitting:
                self._world_frame(now_s)
        while self._outbox and self._outbox[0][0] <= now_s:
            _, _, frames = heapq.heappop(self._outbox)
            if self._backbone is not None:
                self._backbone.publish(frames)
        due_s = [self._next_frame_s, *(each[0] for each in self._outbox[:1])]
        if self._next is not None:
            due_s.append(self._due_s(self._next.at_s))
        return min(due_s)

    def _due_s(self, at_s: float) -> float:
        return self._start_s + at_s + _DETECTION_S

    def _timed(self, datum: Map) -> Map:
        return retimed(datum, lambda at_s: self._clock.pupil_s(self._start_s + at_s))

    def _detect(self, pupils: Iterable[Map], now_s: float) -> None:
        """What the eye processes publish of their images."""
        for pupil in pupils:
            datum = self._timed(pupil)
            self._emit(datum, now_s)
            if datum["topic"].endswith(".2d"):
                self._flat.append(datum)

    def _world_frame(self, now_s: float) -> None:
        """What the world process makes of the pupils since its last frame."""
        gazes, self._gazes = self._gazes, []
        flat, self._flat = self._flat, []
        for gaze in gazes:
            self._emit(gaze, now_s)
        if (blink := self._blinks.frame(flat)) is not None:
            self._emit(blink, now_s)

    def _emit(self, datum: Map, now_s: float) -> None:
        if not self._eyes_alive or self._backbone is None:
            return
        try:
            self._recording.write(datum)
        except RecordingError as error:
            self._log.error("recording", error=str(error))
        for late_s, frames in self._faults.apply(now_s - self._start_s, frames_of(datum["topic"], datum)):
            heapq.heappush(self._outbox, (now_s + late_s, next(self._numbers), frames))

    def _work(self, now_s: float) -> None:
        if self._backbone is not None:
            self._announce(self._calibration.tick(now_s, self._clock.pupil_s(now_s)))

    def _announce(self, notifications: Iterable[Map]) -> None:
        for contents in notifications:
            self.forward(frames_of(contents["topic"], contents))

    def _take_notice(self, frames: list[bytes]) -> None:
        """What a notification makes the program do."""
        contents = notification(frames)
        if contents is None:
            self._eyes_alive = False
            self._log.error("a notification without a subject has killed the eye processes")
            return
        now_s = time.monotonic()
        answers = self._calibration.notified(contents["subject"], now_s)
        try:
            answers += self._recording.notified(contents, self._clock.pupil_s(now_s))
        except RecordingError as error:
            self._log.error("recording", error=str(error))
        self._announce(answers)

    def _listen(self, wait_s: float) -> None:
        """Waits for clients and serves them."""
        if self._backbone is None:
            time.sleep(wait_s)
            return
        poller = zmq.Poller()
        for socket in self._sockets():
            poller.register(socket, zmq.POLLIN)
        poller.poll(math.ceil(wait_s * 1000))
        for frames in self._backbone.pass_on():
            self._take_notice(frames)
        if self._remote is not None:
            for _ in waiting(self._remote):
                if not self._serve(self._remote):
                    self._remote.close()
                    self._remote = None
                    break

    def _end_recording(self) -> None:
        try:
            self._recording.close()
        except RecordingError as error:
            self._log.error("recording", error=str(error))

    def _sockets(self) -> list[zmq.Socket[bytes]]:
        remote = [] if self._remote is None else [self._remote]
        return remote if self._backbone is None else [*remote, self._backbone.to_all, self._backbone.from_clients]

    def _serve(self, remote: zmq.Socket[bytes]) -> bool:
        """Answers one request, or leaves it unanswered for ever. Returns whether Pupil Remote survives it."""
        frames = remote.recv_multipart()
        t_s = time.monotonic() - self._start_s
        if self._faults.on(Fault.STUCK, t_s) or self._faults.on(Fault.RESTART, t_s + _LAST_GASP_S):
            return True
        if b"" not in frames[:-1]:
            return True  # no request: a REP socket drops it too
        envelope = frames.index(b"") + 1
        try:
            text = answer(frames[envelope:], self)
        except RemoteKilledError as error:
            self._log.error("Pupil Remote is dead", why=str(error))
            return False
        remote.send_multipart([*frames[:envelope], text.encode()])
        return True
