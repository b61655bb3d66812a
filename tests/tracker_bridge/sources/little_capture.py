"""A small Pupil Capture of the tests' own, on real sockets at random ports, and readers of it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Generator, Iterator
from typing import Any, cast

import msgpack
import zmq

from entoptic.tracker_bridge.events import (
    SourceSilent,
)
from entoptic.tracker_bridge.samples import PupilSample
from entoptic.tracker_bridge.source import Item
from entoptic.tracker_bridge.sources.pupil_core.bus import SUBSCRIPTIONS
from entoptic.tracker_bridge.sources.pupil_core.capture import PupilCapture

S = 1_000_000_000
PATIENCE_S = 30.0
"""Much longer than anything here takes: reached only by a failure."""

Items = Generator[Item, None, None]


class LittleCapture:
    """Pupil Remote and the data port: datums of both eyes, 2-D and 3-D, at 200 Hz, until it is killed."""

    def __init__(self, port: int = 0, ahead_s: float = 1000.0) -> None:
        self.ahead_s = ahead_s
        """Of the machine's monotonic clock."""
        self.answers = True
        self.publishes = True
        self.refuses = False
        self.reply: str | None = None
        """Said to everything, where it is no Pupil Remote."""
        self.extra: list[list[bytes]] = []
        """Messages to send besides."""
        self.requests: list[bytes] = []
        self.subscriptions: list[bytes] = []
        self.images = 0
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._remote = self._context.socket(zmq.ROUTER)
        self._data = self._context.socket(zmq.XPUB)
        self._data.setsockopt(zmq.XPUB_VERBOSE, 1)
        if port:
            self._remote.bind(f"tcp://127.0.0.1:{port}")
        self.port = port or self._remote.bind_to_random_port("tcp://127.0.0.1")
        self.data_port = self._data.bind_to_random_port("tcp://127.0.0.1")
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="little-capture")
        self._thread.start()

    @property
    def address(self) -> str:
        return f"tcp://127.0.0.1:{self.port}"

    def now_s(self) -> float:
        return time.monotonic_ns() / 1e9 + self.ahead_s

    def kill(self) -> None:
        self._stop.set()
        self._thread.join()
        self._context.destroy(linger=0)

    def _serve(self) -> None:
        due = time.monotonic()
        while not self._stop.is_set():
            if self._remote.poll(1):
                sender, empty, request, *rest = self._remote.recv_multipart()
                self.requests.append(request if not rest else b"multipart")
                if self.answers:
                    self._remote.send_multipart([sender, empty, self._answer(request.decode()).encode()])
            while self._data.poll(0):
                self.subscriptions.append(self._data.recv())
            while self.extra:
                self._data.send_multipart(self.extra.pop(0))
            if self.publishes and time.monotonic() >= due:
                due += 0.005
                self._publish()

    def _answer(self, request: str) -> str:
        if self.reply is not None:
            return self.reply
        known = {"SUB_PORT": str(self.data_port), "v": "3.6.14", "t": repr(self.now_s())}
        if request in known:
            return known[request]
        if self.refuses:
            return "Recording command mal-formatted."
        self.extra += {
            "R": [notification("recording.started", rec_path=f"/rec/{request[2:]}/000/")],
            "r": [notification("recording.stopped", rec_path="/rec/000/")],
            "C": [notification("calibration.started")],
            "c": [
                notification("calibration.stopped"),
                notification("calibration.failed", reason="NotEnoughDataError"),
            ],
        }[request[0]]
        return "OK"

    def _publish(self) -> None:
        self.images += 1
        for eye in (0, 1):
            t = self.now_s()
            for kind in ("2d", "3d"):
                self._data.send_multipart(pupil(t, eye, kind))


def pupil(t_s: float, eye: int = 0, kind: str = "3d") -> list[bytes]:
    datum: dict[str, Any] = {"id": eye, "timestamp": t_s, "confidence": 1.0, "diameter": 20.0}
    datum |= {"diameter_3d": 4.0, "model_confidence": 1.0} if kind == "3d" else {}
    return [f"pupil.{eye}.{kind}".encode(), msgpack.packb(datum)]


def notification(subject: str, **fields: object) -> list[bytes]:
    return [f"notify.{subject}".encode(), msgpack.packb({"subject": subject, **fields})]


class Bench:
    """Starts and ends captures and readers, and looks for what must never be sent and never be left behind."""

    def __init__(self) -> None:
        self._captures: list[LittleCapture] = []
        self._readers: list[Items] = []

    def capture(self, port: int = 0, ahead_s: float = 1000.0) -> LittleCapture:
        self._captures.append(LittleCapture(port, ahead_s))
        return self._captures[-1]

    def read(self, source: PupilCapture) -> Items:
        self._readers.append(cast(Items, source.samples()))
        return self._readers[-1]

    def close(self) -> None:
        for reader in self._readers:
            reader.close()
        for capture in self._captures:
            capture.kill()
        assert [thread.name for thread in threading.enumerate() if thread.name.startswith("pupil-")] == []
        for request in (request for capture in self._captures for request in capture.requests):
            assert request in (b"SUB_PORT", b"v", b"t", b"R", b"r", b"C", b"c") or request.startswith(b"R ")


def until(reader: Iterator[Item], wanted: Callable[[Item], bool]) -> list[Item]:
    """Items up to the first that is wanted."""
    deadline = time.monotonic() + PATIENCE_S
    got: list[Item] = []
    for item in reader:
        got.append(item)
        if wanted(item):
            return got
        if time.monotonic() > deadline:
            break
    raise AssertionError(f"never came; of {len(got)} items the last are {got[-5:]}")


def kind(*kinds: type) -> Callable[[Item], bool]:
    return lambda item: isinstance(item, kinds)


def silent(word: str) -> Callable[[Item], bool]:
    return lambda item: isinstance(item, SourceSilent) and word in item.reason


def until_heard(reader: Iterator[Item], capture: LittleCapture) -> None:
    """Until all that is published reaches the reader."""
    until(reader, lambda _: len(capture.subscriptions) >= len(SUBSCRIPTIONS))


def take(reader: Iterator[Item], count: int) -> list[PupilSample]:
    """So many samples, with whatever comes between them left out."""
    got: list[PupilSample] = []
    while len(got) < count:
        sample = until(reader, kind(PupilSample))[-1]
        assert isinstance(sample, PupilSample)
        got.append(sample)
    return got
