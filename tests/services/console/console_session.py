"""A bridge, a worker and a host on real sockets that say what a test wants said, and pages that come to a console."""

import contextlib
import json
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zmq
from msgspec.structs import replace
from websockets.exceptions import ConnectionClosed
from websockets.frames import Close
from websockets.sync.client import ClientConnection, connect

from entoptic.services.console.actions import Folders
from entoptic.services.console.live import Places
from entoptic.services.console.security import Rules
from entoptic.services.console.server import Console, Server
from entoptic.services.ipc import messages
from entoptic.services.ipc.addresses import Addresses
from entoptic.services.ipc.client import Reply
from entoptic.services.ipc.handler import RequestHandler
from entoptic.services.ipc.messages import DISPLAYED, PERCEIVED, SHOWN, EyeShown, LatencyMs, Picture, Shown, StepShown
from entoptic.services.ipc.requests import BridgeRequest, ChangeSettings, GiveStatus, HostRequest, WorkerRequest
from entoptic.services.ipc.status import BridgeStatus, HostStatus, WorkerStatus, merged
from entoptic.services.settings import Settings
from entoptic.tracker_bridge.publisher import Publisher
from entoptic.tracker_bridge.wire import (
    BlinkOffset,
    BlinkOnset,
    Direction,
    Eye,
    EyeState,
    OneEyeState,
    Phase,
    SaccadeKind,
    SaccadeOffset,
)

ANY = "tcp://127.0.0.1:*"
PATIENCE_S = 60.0
MS = 1_000_000
TOKEN = "a-token-of-sufficient-length"


def never() -> bool:
    return False


def wait_for(condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> Any:
    deadline = time.monotonic() + patience_s
    while not (found := condition()):
        assert time.monotonic() < deadline, f"waited in vain for {what}"
        time.sleep(0.01)
    return found


def state(sequence: int, phase: Phase = Phase.TRACKING) -> EyeState:
    now_ns = time.monotonic_ns()
    one = OneEyeState(phase, 4.0, 4.1, 1.0, 0.9, None)
    return EyeState(sequence, now_ns, one, one, Direction(3.0, -1.0, now_ns))


def shown(frame: int) -> Shown:
    eye = EyeShown("left", "tracking", (3.0, -1.0), (20.0, 12.0), 4.0, 0.9, 5.0, 5.0, 900.0)
    step = StepShown("glare", "quarter", True, "a lamp", 3.0, 12.0)
    return Shown(
        frame, frame / 24, time.monotonic_ns(), 32, 24, (eye,), (step,), 0.5, {"glare": 12.0}, None, 24.0, 23.9, 0,
        LatencyMs(3.0, 8.0, 25.0), None,
    )  # fmt: skip


def picture(frame: int, width_px: int = 64, height_px: int = 48) -> Picture:
    row = bytes((frame % 256, 128, 0)) * width_px
    return Picture(frame, time.monotonic_ns(), width_px, height_px, "srgb", "uint8", row * height_px)


class MadeUpSession:
    """Publishes at 100 states and 25 frames a second from a thread, and answers as bridge, worker and host."""

    def __init__(self) -> None:
        self.context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self.publisher = Publisher(ANY, ANY)
        self.frames = self.context.socket(zmq.XPUB)
        self.frames.setsockopt(zmq.LINGER, 0)
        self.frames.bind(ANY)
        self.asked: list[Any] = []
        self.bridge = BridgeStatus(source="made up", rate_hz=100.0, clock_uncertainty_ms=0.2)
        self.worker = WorkerStatus(scene="nothing", fps=24.0, reached_fps=23.9, dropped=0, revision=1)
        self.is_over = False
        self.refusal: str | None = None
        self.phase = Phase.TRACKING
        self.frame_px = (64, 48)
        self.wanted: set[bytes] = set()
        kinds = ((BridgeRequest, "bridge"), (WorkerRequest, "worker"), (HostRequest, "host_status"))
        self.controls = [
            RequestHandler(ANY, kind, lambda asked, name=name: self._answer(asked, name), None, self.context)
            for kind, name in kinds
        ]
        states, events = self.publisher.addresses
        bridge, worker, self.host = (control.address for control in self.controls)
        at = self.frames.getsockopt_string(zmq.LAST_ENDPOINT)
        silent = "tcp://127.0.0.1:9"
        self.addresses = Addresses(states, events, "", bridge, silent, silent, at, worker)
        self._stop = threading.Event()
        self.frame = 0
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def host_status(self) -> HostStatus:
        if self.is_over:
            return HostStatus()
        return HostStatus(
            running=True, state="running", started="now", addresses=self.addresses, bridge=self.bridge,
            worker=self.worker, problems=merged(self.bridge.problems, self.worker.problems),
        )  # fmt: skip

    def _answer(self, asked: Any, name: str) -> Reply:
        if isinstance(asked, GiveStatus):
            return Reply(True, "", getattr(self, name))
        self.asked.append(asked)
        if self.refusal is not None:
            return Reply(False, self.refusal)
        if isinstance(asked, ChangeSettings):
            self.set(asked.settings)
            return Reply(True, "from the next frame on", self.worker.revision)
        return Reply(True, "as you wish")

    def set(self, settings: Settings) -> None:
        self.worker = replace(self.worker, settings=settings, revision=self.worker.revision + 1)

    def _run(self) -> None:
        sequence = 0
        while not self._stop.wait(0.01):
            self.publisher.publish_state(state(sequence, self.phase))
            sequence += 1
            if sequence % 50 == 0:
                self._events()
            if sequence % 4 == 0:
                self._publish_frame()
            for control in self.controls:
                control.serve()

    def _events(self) -> None:
        now = time.monotonic_ns()
        for event in (
            BlinkOnset(now, Eye.LEFT),
            BlinkOffset(now, Eye.LEFT, 150 * MS),
            SaccadeOffset(now, now - 40 * MS, now - 20 * MS, SaccadeKind.MICROSACCADE, 0.5, 40.0, 0.5, 0.0),
        ):
            self.publisher.publish_event(event)

    def _publish_frame(self) -> None:
        while self.frames.poll(0):
            said = self.frames.recv()
            (self.wanted.add if said[:1] == b"\x01" else self.wanted.discard)(said[1:])
        self.frame += 1
        self.frames.send_multipart([SHOWN, messages.encode(shown(self.frame))])
        for topic in (PERCEIVED, DISPLAYED):
            if topic in self.wanted:
                self.frames.send_multipart([topic, messages.encode(picture(self.frame, *self.frame_px))])

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        for control in self.controls:
            control.close()
        self.publisher.close()
        self.context.destroy(linger=0)


class Served:
    """A console on a real port."""

    def __init__(self, folder: Path, places: Places, token: str | None = None, hosts: tuple[str, ...] = ()) -> None:
        self.root, self.observers, self.inputs = (folder / name for name in ("sessions", "observers", "inputs"))
        self.root.mkdir(exist_ok=True)
        self.console = Console(places, Folders(self.root, self.observers, self.inputs))
        self.server = Server(self.console, lambda port: Rules(token, hosts, port), "127.0.0.1", 0)
        self.at = f"127.0.0.1:{self.server.port}"
        wait_for(lambda: self.server._server.started, "the server")

    @contextlib.contextmanager
    def page(self, **more: Any) -> Iterator["Visitor"]:
        with connect(f"ws://{self.at}/live", origin=f"http://{self.at}", max_size=None, **more) as socket:
            yield Visitor(socket)

    def close(self) -> None:
        self.server.close()


class Visitor:
    """A page, as far as the socket shows."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.messages: list[dict[str, Any]] = []
        self.pictures: list[bytes] = []
        self._id = 0

    def read(self) -> None:
        said = self.socket.recv(PATIENCE_S)
        if isinstance(said, bytes):
            self.pictures.append(said)
        else:
            self.messages += json.loads(said)

    def read_to_the_end(self) -> Close:
        """How the server closed the connection."""
        with pytest.raises(ConnectionClosed) as closed:
            self._read_for_ever()
        assert closed.value.rcvd is not None
        return closed.value.rcvd

    def _read_for_ever(self) -> None:
        while True:
            self.read()

    def until(self, kind: str, condition: Callable[[dict[str, Any]], Any] = lambda message: True) -> dict[str, Any]:
        """The next message of a kind for which something is so; those before it are gone."""
        deadline = time.monotonic() + PATIENCE_S
        while True:
            while self.messages:
                message = self.messages.pop(0)
                if message["type"] == kind and condition(message):
                    return message
            assert time.monotonic() < deadline, f"no such {kind}"
            self.read()

    def ask(self, do: str, **more: Any) -> dict[str, Any]:
        self._id += 1
        number = self._id
        self.socket.send(json.dumps({"id": number, "request": {"do": do, **more}}))
        return self.until("reply", lambda message: message["re"] == number)
