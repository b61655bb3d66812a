"""A bridge process on the stand-in for Pupil Capture, each started as a person would."""

import contextlib
import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest

from entoptic.services.config import EyesConfig
from entoptic.services.ipc.client import tell
from entoptic.services.ipc.requests import StartTrackerRecording
from entoptic.services.process_config import BridgeConfig
from entoptic.services.reader import StateReader
from entoptic.tracker_bridge.events import SourceBack, SourceSilent, TaskOutcome, TrackerTask
from entoptic.tracker_bridge.samples import PupilSample
from entoptic.tracker_bridge.sources import open_source
from entoptic.tracker_bridge.wire import Event, EyeState, Phase

pytestmark = pytest.mark.slow
PATIENCE_S = 90.0


def free_port() -> int:
    with contextlib.closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def entoptic(*arguments: str, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    with log.open("wb") as stderr:
        process = subprocess.Popen([sys.executable, "-m", "entoptic", *arguments], stdin=subprocess.PIPE, stderr=stderr)
        try:
            yield process
        finally:
            process.kill()
            process.wait()


@contextlib.contextmanager
def child(config: BridgeConfig, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A bridge whose log is JSON."""
    command = [sys.executable, "-m", "entoptic.services.child", "bridge"]
    with log.open("wb") as stderr:
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=stderr)
        assert process.stdin is not None
        process.stdin.write(msgspec.json.encode(config) + b"\n")
        process.stdin.flush()
        try:
            yield process
        finally:
            process.kill()
            process.wait()


class Ear:
    """Reads a bridge until something is so."""

    def __init__(self, states: str, events: str) -> None:
        self.reader = StateReader(states, events)
        self.reader.subscribe()
        self.states: list[EyeState] = []
        self.events: list[Event] = []

    def until(self, condition: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline, f"{len(self.states)} states, {self.events}"
            self.events += self.reader.events.read(20)
            if (state := self.reader.newest()) is not None:
                self.states.append(state)

    def count(self, kind: type) -> int:
        return sum(isinstance(event, kind) for event in self.events)

    def tracked_s(self) -> float:
        """How long eyes were tracked, in the states' own time."""
        tracked = [state.t_ns for state in self.states if state.left.phase is Phase.TRACKING]
        return (tracked[-1] - tracked[0]) / 1e9 if tracked else 0.0


@pytest.fixture
def addresses() -> list[str]:
    return [f"tcp://127.0.0.1:{free_port()}" for _ in range(3)]


def test_a_bridge_outlives_a_tracker_that_comes_late_restarts_and_records(tmp_path: Path, addresses: list[str]) -> None:
    states, events, control = addresses
    port = free_port()
    recording = tmp_path / "recording"
    bridge = BridgeConfig(
        eyes=EyesConfig(source="capture", remote=f"tcp://127.0.0.1:{port}"),
        record=str(recording), states=states, events=events, control=control,
    )  # fmt: skip
    capture = ["capture", "simulated", "--port", str(port), "--fault", "restart@5s"]
    capture += ["--recordings", str(tmp_path / "recordings")]
    ear = Ear(states, events)
    with child(bridge, log=tmp_path / "bridge.log") as running:
        ear.until(lambda: ear.count(SourceSilent) >= 1)  # nobody there yet
        with entoptic(*capture, log=tmp_path / "capture.log"):
            ear.until(lambda: ear.count(SourceBack) >= 2)  # there, and there again
            begun = len(ear.states)
            ear.until(lambda: len(ear.states) > begun and ear.states[-1].t_ns - ear.states[begun].t_ns > 3e9)
            assert "asked" in tell(control, StartTrackerRecording("mine")).reply
            ear.until(lambda: ear.count(TrackerTask) >= 1)
        silent = ear.count(SourceSilent)
        ear.until(lambda: ear.count(SourceSilent) > silent)  # gone for good
        running.send_signal(signal.SIGTERM)
        assert running.wait(PATIENCE_S) == 0
    task = next(event for event in ear.events if isinstance(event, TrackerTask))
    assert task.outcome is TaskOutcome.STARTED
    times = [state.t_ns for state in ear.states]
    assert times == sorted(times)
    assert ear.tracked_s() > 5.0
    assert {state.clock_uncertainty_ns for state in ear.states[-100:]} != {None}
    ended = [json.loads(line) for line in (tmp_path / "bridge.log").read_text().splitlines()][-1]
    assert ended["event"] == "ended"
    kept = [sample for sample in open_source(str(recording)).samples() if isinstance(sample, PupilSample)]
    assert (kept[-1].t_ns - kept[0].t_ns) / 1e9 > 5.0
    ear.reader.close()


def test_a_killed_bridge_leaves_a_recording_up_to_its_last_second(tmp_path: Path, addresses: list[str]) -> None:
    states, events, control = addresses
    recording = tmp_path / "recording"
    bridge = ["bridge", "--source", "usb-simulated:simulated", "--seconds", "60", "--record", str(recording)]
    ear = Ear(states, events)
    log = tmp_path / "bridge.log"
    with entoptic(*bridge, "--states", states, "--events", events, "--control", control, log=log) as running:
        ear.until(lambda: ear.tracked_s() > 3.0)
        running.kill()
    seen_ns = ear.states[-1].t_ns
    kept = [sample for sample in open_source(str(recording)).samples() if isinstance(sample, PupilSample)]
    # Times of a recording are seconds in doubles.
    assert kept[-1].t_ns > seen_ns - 1e9
    ear.reader.close()
