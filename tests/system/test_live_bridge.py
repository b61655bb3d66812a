"""A live bridge as a process: what it keeps of a take whatever becomes of it, and how it ends."""

import contextlib
import csv
import json
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import zmq

from entoptic.services.config import EyesConfig
from entoptic.services.ipc.client import ask, tell
from entoptic.services.ipc.messages import SHOWN, EyeShown, Shown, encode
from entoptic.services.ipc.requests import CalibratePupils, GiveStatus, StartRecording, StopRecording
from entoptic.services.process_config import BridgeConfig
from entoptic.services.reader import StateReader
from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.sources import open_source
from entoptic.tracker_bridge.sources.pupil_core.recorder import PupilRecorder
from entoptic.tracker_bridge.sources.pupil_core.remote import DEFAULT_REMOTE

pytestmark = pytest.mark.slow
PATIENCE_S = 90.0
LASTS_S = 60
NS_PER_S = 1_000_000_000


class Running:
    """A bridge process that is ready."""

    def __init__(self, config: BridgeConfig, *, files_of_bytes: int | None = None) -> None:
        command = [sys.executable, "-m", "entoptic.services.child", "bridge"]

        def limit() -> None:
            if files_of_bytes is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (files_of_bytes, files_of_bytes))

        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=limit)
        assert self.process.stdin is not None
        self.process.stdin.write(msgspec.json.encode(config) + b"\n")
        self.process.stdin.flush()
        self.ready = self.log_until("ready")
        self.control = str(self.ready["control"])

    def log_until(self, event: str) -> dict[str, Any]:
        assert self.process.stderr is not None
        said = []
        for line in self.process.stderr:
            said.append(json.loads(line))
            if said[-1]["event"] == event:
                return dict(said[-1])
        raise AssertionError(said)

    def status(self) -> dict[str, Any]:
        data = tell(self.control, GiveStatus()).data
        assert data is not None
        return data

    def status_until(self, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        deadline = time.monotonic() + PATIENCE_S
        while not condition(status := self.status()):
            assert time.monotonic() < deadline, status
            time.sleep(0.05)
        return status

    def end(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode


@pytest.fixture
def start() -> Iterator[Callable[..., Running]]:
    running: list[Running] = []

    def one(source: object, *, remote: str = DEFAULT_REMOTE, files_of_bytes: int | None = None, **more: Any) -> Running:
        config = BridgeConfig(eyes=EyesConfig(source=str(source), remote=remote), live=True, **more)
        running.append(Running(config, files_of_bytes=files_of_bytes))
        return running[-1]

    yield one
    for each in running:
        each.process.kill()
        each.process.wait()
        for pipe in (each.process.stdin, each.process.stderr):
            if pipe is not None:
                pipe.close()


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A minute at 100 Hz whose gaze says what time it is."""
    folder = tmp_path_factory.mktemp("recorded") / "recording"
    with PupilRecorder(folder, start_synced_s=1.0) as recorder:
        for at in range(LASTS_S * 100):
            t_ns = NS_PER_S + at * NS_PER_S // 100
            for eye in Eye:
                recorder.add(PupilSample(t_ns, eye, 4.0, 1.0, 1.0))
            recorder.add(GazeSample(t_ns, None, at * 0.01 - 30.0, 0.0, 1.0))
    return folder


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def second_of(row: dict[str, str]) -> float:
    """Of the recording, as its gaze says."""
    return float(row["gaze_azimuth_deg"]) + 30.0


def test_after_a_crash_a_take_goes_on_where_the_clock_is(
    start: Callable[..., Running], recording: Path, tmp_path: Path
) -> None:
    first = start(recording)
    begun_ns = first.ready["begun_ns"]
    take = StartRecording(str(tmp_path), time.monotonic_ns())
    assert not ask(first.control, StartRecording(str(tmp_path / "none"), 0)).done
    assert tell(first.control, take).done
    assert tell(first.control, take).done
    assert "end it first" in ask(first.control, StartRecording(str(tmp_path), 1)).reply
    began = first.status()["states"]
    seen = first.status_until(lambda status: status["states"] > began + 100)
    assert (seen["recording"], seen["problems"], seen["clock_uncertainty_ms"]) == (str(tmp_path), [], 0)
    first.process.kill()
    first.process.wait()
    kept = rows(tmp_path / "states.csv")
    assert len(kept) >= seen["states"] - began
    assert all(len(row) == 16 and None not in row.values() for row in kept)
    # What a write that a power failure cut off might leave.
    with (tmp_path / "states.csv").open("ab") as file:
        file.write(b"77,0.5")
    (tmp_path / "bridge.json").write_text("what another one said in the end")

    again = start(recording, begun_ns=begun_ns)
    assert tell(again.control, take).done
    assert not (tmp_path / "bridge.json").exists()
    began = again.status()["states"]
    again.status_until(lambda status: status["states"] > began + 100 and status["rate_hz"] > 30)
    assert tell(again.control, StopRecording()).done
    assert not ask(again.control, StopRecording()).done
    whole = rows(tmp_path / "states.csv")
    assert whole[: len(kept)] == kept
    times_s = [float(row["t_s"]) for row in whole]
    assert times_s == sorted(times_s)
    # One clock for both: the recording's second follows the take's.
    shifts_s = {round(second_of(row) - t_s, 1) for row, t_s in zip(whole, times_s, strict=True)}
    assert max(shifts_s) - min(shifts_s) < 0.15
    said = json.loads((tmp_path / "bridge.json").read_text())
    assert (said["states"], said["recordings"]) == (len(whole), ["eyes", "eyes-2"])
    assert len(said["gaps"]) == 1
    assert said["gaps"][0]["from_s"] == pytest.approx(float(kept[-1]["t_s"]), abs=0.002)
    assert {row["event"] for row in rows(tmp_path / "events.csv")} <= {"StreamStarted", "ClockEstimated"}
    for folder in ("eyes", "eyes-2"):
        assert sum(isinstance(one, PupilSample) for one in open_source(str(tmp_path / folder)).samples()) > 150
    assert again.end() == 0


def test_a_full_disk_ends_the_take_alone(start: Callable[..., Running], recording: Path, tmp_path: Path) -> None:
    running = start(recording, files_of_bytes=40_000)
    tell(running.control, StartRecording(str(tmp_path), time.monotonic_ns()))
    status = running.status_until(lambda status: status["recording"] is None)
    (problem,) = status["problems"]
    assert "File too large" in problem["what"]
    assert str(tmp_path) in problem["what"]
    assert running.log_until("recording failed")["error"] == f"{problem['what']} {problem['remedy']}"
    running.status_until(lambda later: later["states"] > status["states"] + 50)
    assert "File too large" in ask(running.control, StopRecording()).reply
    kept = rows(tmp_path / "states.csv")
    assert len(kept) > 50
    assert None not in kept[-1].values()
    assert len(list(open_source(str(tmp_path / "eyes")).samples())) > 100
    assert "File too large" in json.loads((tmp_path / "bridge.json").read_text())["problem"]["what"]


def test_a_folder_that_goes_away_ends_the_take_alone(
    start: Callable[..., Running], recording: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "take"
    folder.mkdir()
    running = start(recording)
    tell(running.control, StartRecording(str(folder), time.monotonic_ns()))
    began = running.status()["states"]
    running.status_until(lambda status: status["states"] > began + 20)
    folder.rename(tmp_path / "elsewhere")
    status = running.status_until(lambda status: status["recording"] is None)
    assert "moved away" in status["problems"][0]["what"]
    assert len(rows(tmp_path / "elsewhere" / "states.csv")) > 20
    folder.mkdir()
    assert tell(running.control, StartRecording(str(folder), time.monotonic_ns())).done
    assert running.status()["problems"] == []
    assert running.end() == 0
    assert json.loads((folder / "bridge.json").read_text())["problem"] is None


def test_live_states_are_those_of_now_and_say_when_they_were_sent(
    start: Callable[..., Running], recording: Path
) -> None:
    running = start(recording)
    reader = StateReader(running.ready["states"], running.ready["events"])
    with contextlib.closing(reader):
        reader.subscribe()
        delays_ns = []
        deadline = time.monotonic() + PATIENCE_S
        while len(delays_ns) < 50:
            assert time.monotonic() < deadline
            if (state := reader.newest()) is not None and reader.newest_sent_ns is not None:
                delays_ns.append(reader.newest_sent_ns - state.t_ns)
        running.status_until(lambda status: status["readers"] == 1)
    # A state does not wait for the samples of the next time, 10 ms later.
    assert 0 <= sorted(delays_ns)[len(delays_ns) // 4] < 8_000_000
    running.status_until(lambda status: status["readers"] == 0)


def shown(mean_cd_m2: float) -> Shown:
    eye = EyeShown("left", "tracking", (0.0, 0.0), (1.0, 1.0), 4.0, 1.0, 1.0, mean_cd_m2, mean_cd_m2)
    return Shown(0, 0.0, 0, 2, 2, (eye,), (), 0.0, {}, None, 24.0, 24.0, 0, None, None)


def test_simulated_eyes_see_the_worker_s_scene_and_can_be_calibrated(
    start: Callable[..., Running], tmp_path: Path
) -> None:
    with zmq.Context() as context, context.socket(zmq.XPUB) as worker:
        worker.bind("tcp://127.0.0.1:*")
        free = "tcp://127.0.0.1:*"
        running = start("simulated", sees=worker.LAST_ENDPOINT.decode(), screens=free, answers=free)
        reader = StateReader(running.ready["states"], running.ready["events"])
        reader.subscribe()

        def diameter_under(luminance: float, is_so: Callable[[float], bool]) -> float:
            deadline = time.monotonic() + PATIENCE_S
            while time.monotonic() < deadline:
                worker.send_multipart([SHOWN, encode(shown(luminance))])
                state = reader.newest()
                if (
                    state is not None
                    and state.left.pupil_diameter_mm is not None
                    and is_so(state.left.pupil_diameter_mm)
                ):
                    return state.left.pupil_diameter_mm
                time.sleep(0.03)
            raise AssertionError(state)

        with contextlib.closing(reader):
            dark_mm = diameter_under(0.01, lambda mm: mm > 5.0)
            assert diameter_under(5000.0, lambda mm: mm < 3.5) < dark_mm
        worker.send_multipart([SHOWN, b"no msgpack"])
        assert "begun" in tell(running.control, CalibratePupils(str(tmp_path / "map.toml"))).reply
        assert running.status()["calibrating"]["stage"]
        assert running.end() == 0


@pytest.mark.parametrize("way", ["term", "stdin"])
def test_it_ends_at_once_with_its_files_whole_while_its_tracker_is_silent(
    start: Callable[..., Running], tmp_path: Path, way: str
) -> None:
    running = start("capture", remote="tcp://127.0.0.1:9")
    running.status_until(lambda status: [one["code"] for one in status["problems"]] == ["no tracker"])
    tell(running.control, StartRecording(str(tmp_path), time.monotonic_ns()))
    asked_s = time.monotonic()
    if way == "term":
        running.process.send_signal(signal.SIGTERM)
    else:
        assert running.process.stdin is not None
        running.process.stdin.close()
    running.log_until("take ended")
    assert time.monotonic() - asked_s < 1.0
    assert running.process.wait(PATIENCE_S) == 0
    assert json.loads((tmp_path / "bridge.json").read_text())["states"] == 0
    assert (tmp_path / "eyes" / "info.player.json").exists()
