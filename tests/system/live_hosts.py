"""Hosts of live sessions as processes of their own, for tests that ask, kill and end them."""

import contextlib
import csv
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import av
import msgspec
import zmq

from entoptic.services.config import ViewConfig
from entoptic.services.ipc.client import ControlError, Reply, ask
from entoptic.services.ipc.requests import GiveStatus, StartSession
from entoptic.services.live.registry import RunningHost
from entoptic.services.results.render_log import FILE as RENDER_LOG
from entoptic.services.results.render_log import FrameRecord, RenderLog, Resumed
from entoptic.services.session_config import SessionConfig
from entoptic.tracker_bridge.sources.pupil_core.recording import open_recording

SMALL = {"width_px": 90, "height_px": 100, "fps": 20.0}
SIZE = ("--width=90", "--height=100", "--fps=20")
PATIENCE_S = 150.0
"""A machine that does much else compiles slowly."""
CLI = [sys.executable, "-m", "entoptic"]


def until(condition: Callable[[], Any], what: str, within_s: float = PATIENCE_S) -> Any:
    """What the condition gives when it is true."""
    until_s = time.monotonic() + within_s
    while not (found := condition()):
        assert time.monotonic() < until_s, f"not within {within_s:g} s: {what}"
        time.sleep(0.05)
    return found


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


class LiveHost:
    """One `entoptic` process that hosts sessions, in a folder of its own."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.folder = folder
        self.environment = {**os.environ, "XDG_STATE_HOME": str(folder / "state")}
        # Compiled code is shared with all other tests.
        self.log = (folder / "host.log").open("w")
        self.process = subprocess.Popen(
            [*CLI, *arguments], cwd=folder, env=self.environment, stdout=self.log, stderr=self.log
        )
        self.control = until(self._registered, "the host runs").control

    def _registered(self) -> RunningHost | None:
        assert self.process.poll() is None, (self.folder / "host.log").read_text()
        for path in (self.folder / "state" / "entoptic" / "hosts").glob("*.json"):
            return msgspec.json.decode(path.read_bytes(), type=RunningHost)
        return None

    def ask(self, request: msgspec.Struct) -> Reply:
        return ask(self.control, request, patience_ms=20_000)

    def status(self) -> dict[str, Any]:
        data = self.ask(GiveStatus()).data
        assert data is not None
        return data

    def until(self, condition: Callable[[dict[str, Any]], Any], what: str) -> dict[str, Any]:
        """The status when it is so."""
        found: dict[str, Any] = {}

        def holds() -> bool:
            nonlocal found
            assert self.process.poll() is None, (self.folder / "host.log").read_text()
            with contextlib.suppress(ControlError):
                found = self.status()
            return bool(found and condition(found))

        until(holds, f"{what}; {found}")
        return found

    def start(self, **view: Any) -> dict[str, Any]:
        """Starts a session; its status when it runs."""
        reply = self.ask(StartSession(SessionConfig(view=ViewConfig(**{**SMALL, **view}))))
        assert reply.done, reply
        return self.until(lambda now: now["state"] == "running", "the session runs")

    def pids(self) -> dict[str, int]:
        return {name: one["pid"] for name, one in self.status()["processes"].items() if one["pid"]}

    def command(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*CLI, *arguments], cwd=self.folder, env=self.environment, capture_output=True, text=True, timeout=120
        )

    def end(self, number: int = signal.SIGTERM) -> float:
        """Sends a signal and waits; how long it took, in seconds."""
        begun_s = time.monotonic()
        self.process.send_signal(number)
        self.process.wait(60)
        taken_s = time.monotonic() - begun_s
        self.log.close()
        return taken_s


@contextlib.contextmanager
def live_host(folder: Path, *arguments: str) -> Iterator[LiveHost]:
    """Nothing of it is left afterwards."""
    folder.mkdir(parents=True, exist_ok=True)
    host = LiveHost(folder, *arguments)
    try:
        yield host
    finally:
        if host.process.poll() is None:
            host.process.kill()
            host.process.wait()
        host.log.close()


def rows(path: Path) -> list[dict[str, str]]:
    """Of a table whose rows are all whole."""
    with path.open(newline="", encoding="utf-8") as file:
        found = list(csv.DictReader(file))
    assert all(None not in row and None not in row.values() for row in found), path
    return found


_looked_at: dict[Path, tuple[int, int]] = {}


def _known(path: Path) -> bool:
    """Whether a file was looked at already, just as it is: a take of twenty restarts has many that are long done."""
    now = (path.stat().st_size, path.stat().st_mtime_ns)
    before, _looked_at[path] = _looked_at.get(path), now
    return before == now


def frames_of(folder: Path) -> int:
    """Looks at all that a take holds, finished or not; how many frames it has."""
    records = list(RenderLog(folder / RENDER_LOG))
    frames = sum(isinstance(record, FrameRecord) for record in records)
    # A frame's row comes after its record: each worker that was killed may have lost one, and this one may be at it.
    lost = 1 + sum(isinstance(record, Resumed) for record in records)
    assert len(rows(folder / "plan.csv")) >= frames - lost
    states = rows(folder / "states.csv")
    times = [float(row["t_s"]) for row in states]
    assert times == sorted(times)
    films = [folder / "perceived.mp4"] if (folder / "perceived.mp4").exists() else folder.glob("perceived-*.mp4")
    for film in films:
        if _known(film):
            continue
        with av.open(str(film)) as opened:
            # A part that has just begun has no fragment yet.
            assert sum(1 for _ in opened.decode(video=0)) > 0 or folder.name.endswith(".partial")
    for eyes in folder.glob("eyes*"):
        pupils = eyes / "pupil.pldata"
        if pupils.exists() and pupils.stat().st_size and not _known(pupils):
            open_recording(eyes)
    return frames


def ports_are_free(addresses: dict[str, str]) -> bool:
    for address in addresses.values():
        host, _, port = address.removeprefix("tcp://").rpartition(":")
        with socket.socket() as one:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                one.bind((host, int(port)))
            except OSError:
                return False
    return True


def hears_frames(address: str, within_ms: int = 20_000) -> bool:
    """Whether a worker shows frames there."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    one = context.socket(zmq.SUB)
    one.setsockopt(zmq.SUBSCRIBE, b"shown")
    one.connect(address)
    try:
        return bool(one.poll(within_ms))
    finally:
        context.destroy(linger=0)
