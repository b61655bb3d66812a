"""The stand-in over real sockets, as a client meets it."""

import contextlib
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest
import structlog
import zmq

from entoptic.tracker_bridge.capture_twin.faults import read_fault
from entoptic.tracker_bridge.capture_twin.playback import open_playback
from entoptic.tracker_bridge.capture_twin.standin import AddressError, StandIn, StandInSettings
from entoptic.tracker_bridge.samples import Eye, PupilSample
from entoptic.tracker_bridge.sources.pupil_core.recording import open_recording
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedSettings

TIMEOUT_MS = 30_000
QUIET_MS = 400
"""Longer than anything that is still on its way takes; a busy machine makes the test weaker, not wrong."""


class Client:
    """Speaks to a stand-in as any client of Pupil Capture does."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], port: int) -> None:
        self._context, self._port = context, port

    def ask(self, *frames: bytes, timeout_ms: int = TIMEOUT_MS) -> str | None:
        """The answer, or None; a new socket each time, since one without an answer stays stuck."""
        with self._context.socket(zmq.REQ) as remote:
            remote.linger = 0
            remote.connect(f"tcp://127.0.0.1:{self._port}")
            remote.send_multipart(frames)
            return remote.recv().decode() if remote.poll(timeout_ms) else None

    def subscribe(self, *topics: str) -> zmq.Socket[bytes]:
        sub = self._context.socket(zmq.SUB)
        sub.linger = 0
        sub.rcvhwm = 100_000
        for topic in topics:
            sub.subscribe(topic)
        sub.connect(f"tcp://127.0.0.1:{self.ask(b'SUB_PORT')}")
        return sub


def receive(sub: zmq.Socket[bytes], topic: str = "") -> dict[str, Any]:
    """The next message whose topic begins so."""
    end_s = time.monotonic() + TIMEOUT_MS / 1000
    while time.monotonic() < end_s and sub.poll(TIMEOUT_MS):
        frames = sub.recv_multipart()
        if frames[0].decode().startswith(topic):
            datum: dict[str, Any] = msgpack.unpackb(frames[1])
            return datum
    raise AssertionError(f"no {topic} within {TIMEOUT_MS} ms")


def is_quiet(sub: zmq.Socket[bytes]) -> bool:
    """Whether nothing comes any more, once what was on its way has come."""
    end_s = time.monotonic() + TIMEOUT_MS / 1000
    while time.monotonic() < end_s:
        if not sub.poll(QUIET_MS):
            return True
        sub.recv_multipart()
    return False


@contextlib.contextmanager
def running(folder: Path, *faults: str, port: int = 0) -> Iterator[tuple[Client, StandIn]]:
    log = structlog.get_logger()
    settings = StandInSettings(port, folder, faults=tuple(map(read_fault, faults)), fit_s=0.5)
    playback = open_playback("simulated", simulated=SimulatedSettings(blinks_per_minute=40.0, seed=2))
    stand_in = StandIn(playback, settings, log)
    stopped = threading.Event()
    thread = threading.Thread(target=stand_in.run, args=(stopped.is_set,))
    thread.start()
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    try:
        yield Client(context, stand_in.remote_port), stand_in
    finally:
        stopped.set()
        thread.join()
        context.destroy(linger=0)


def test_a_client_gets_data_calibrates_and_records(tmp_path: Path) -> None:
    with running(tmp_path) as (client, _):
        assert client.ask(b"v") == "3.6.14"
        assert client.ask(b"x") == "Unknown command."
        eyes, notices = client.subscribe("pupil.", "gaze.", "blinks"), client.subscribe("notify.")
        before_s, datum = float(client.ask(b"t") or 0), receive(eyes, "pupil.0.3d")
        assert set(datum) >= {"diameter_3d", "circle_3d", "model_confidence"}
        assert receive(eyes, "gaze.3d.01.")["base_data"][0]["id"] == 0
        assert receive(eyes, "blinks")["type"] in ("onset", "offset")
        after_s = float(client.ask(b"t") or 0)
        assert before_s - 30.0 < datum["timestamp"] < after_s

        assert client.ask(b"C") == "OK"
        assert receive(notices, "notify.calibration.should_start") == {
            "subject": "calibration.should_start",
            "topic": "notify.calibration.should_start",
        }
        assert receive(notices, "notify.calibration.started")["subject"] == "calibration.started"
        time.sleep(1.1)  # what it takes at least to collect points
        assert client.ask(b"c") == "OK"
        assert receive(notices, "notify.calibration.stopped")["subject"] == "calibration.stopped"
        assert receive(notices, "notify.calibration.successful")["gazer_class_name"] == "Gazer3D"
        assert receive(notices, "notify.calibration.result.v2")["version"] == 2

        assert client.ask(b"R session 7") == "OK"
        started = receive(notices, "notify.recording.started")
        assert started["session_name"] == "session 7"
        while receive(eyes, "gaze.3d.01.")["timestamp"] < started["start_time_synced"] + 0.3:
            pass
        assert client.ask(b"r") == "OK"
        assert receive(notices, "notify.recording.stopped")["rec_path"] == started["rec_path"]
        samples = list(open_recording(Path(started["rec_path"])).samples())
        assert {sample.eye for sample in samples if isinstance(sample, PupilSample)} == set(Eye)
        assert len(samples) > 50


def test_gaze_waits_while_a_calibration_is_fitted(tmp_path: Path) -> None:
    with running(tmp_path) as (client, _):
        bus = client.subscribe("gaze.", "pupil.0.2d", "notify.calibration.s")
        client.ask(b"C")
        receive(bus, "notify.calibration.started")
        time.sleep(1.1)
        client.ask(b"c")
        receive(bus, "notify.calibration.stopped")
        topics = []
        while not topics or topics[-1] != "notify.calibration.successful":
            assert bus.poll(TIMEOUT_MS)
            topics.append(bus.recv_multipart()[0].decode())
        assert set(topics) == {"pupil.0.2d", "notify.calibration.successful"}
        assert receive(bus, "gaze.")


def test_what_a_client_sends_reaches_all_and_may_be_the_end(tmp_path: Path) -> None:
    with running(tmp_path) as (client, stand_in):
        notices, eyes = client.subscribe("notify.", "mine."), client.subscribe("pupil.")
        hello = msgpack.packb({"subject": "hello", "a": [1, 2]})
        receive(eyes)  # both are connected
        assert client.ask(b"notify.hello", hello) == "Message forwarded."
        assert receive(notices, "notify.hello") == {"subject": "hello", "a": [1, 2]}

        with zmq.Context.instance().socket(zmq.PUB) as publisher:
            publisher.connect(f"tcp://127.0.0.1:{client.ask(b'PUB_PORT')}")
            end_s = time.monotonic() + TIMEOUT_MS / 1000
            while not notices.poll(50):
                assert time.monotonic() < end_s
                publisher.send_multipart([b"mine.of.all", msgpack.packb({"a": 1})])
        assert receive(notices, "mine.") == {"a": 1}

        assert client.ask(b"T 5.0") == "Timesync successful."
        assert 5.0 <= float(client.ask(b"t") or 0) < 60.0

        assert client.ask(b"notify.bad", msgpack.packb({"no": "subject"})) == "Message forwarded."
        assert is_quiet(eyes)
        assert client.ask(b"t") is not None

        assert client.ask(b"", timeout_ms=QUIET_MS) is None
        assert client.ask(b"t", timeout_ms=QUIET_MS) is None
        assert stand_in.ports != (0, 0)


@pytest.mark.slow
def test_a_restart_gives_the_backbone_new_ports_and_an_old_subscriber_nothing(tmp_path: Path) -> None:
    with running(tmp_path, "restart@4s:1s") as (client, stand_in):
        old = client.subscribe("pupil.")
        old_ports = stand_in.ports
        receive(old)
        end_s = time.monotonic() + TIMEOUT_MS / 1000
        while stand_in.ports in (old_ports, (0, 0)):
            assert time.monotonic() < end_s
            time.sleep(0.05)
        assert is_quiet(old)
        new = client.subscribe("pupil.")
        assert client.ask(b"SUB_PORT") == str(stand_in.ports[0])
        assert not set(stand_in.ports) & set(old_ports)
        for _ in range(100):
            receive(new)
        assert not old.poll(0)


@pytest.mark.slow
def test_a_stuck_remote_never_answers_what_it_was_asked_then(tmp_path: Path) -> None:
    with running(tmp_path, "stuck@0s:3s") as (client, _), zmq.Context.instance().socket(zmq.REQ) as remote:
        remote.linger = 0
        remote.connect(f"tcp://127.0.0.1:{client._port}")
        remote.send(b"t")
        end_s = time.monotonic() + TIMEOUT_MS / 1000
        while client.ask(b"v", timeout_ms=200) is None:
            assert time.monotonic() < end_s
        assert not remote.poll(QUIET_MS)


@pytest.mark.slow
def test_a_clock_that_is_set_and_eyes_that_fall_silent(tmp_path: Path) -> None:
    with running(tmp_path, "timebase=+1000s@3s", "silence@4s") as (client, _):
        eyes = client.subscribe("pupil.0.2d")
        first_s = float(receive(eyes)["timestamp"])
        while (jumped_s := float(receive(eyes)["timestamp"])) < first_s + 500.0:
            pass
        assert jumped_s - first_s == pytest.approx(1000.0, abs=5.0)
        assert is_quiet(eyes)
        assert float(client.ask(b"t") or 0) > jumped_s


def test_a_port_that_is_taken_is_replaced_and_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with running(tmp_path) as (_, first), running(tmp_path, port=first.remote_port) as (client, second):
        assert second.remote_port != first.remote_port
        assert client.ask(b"v") == "3.6.14"
        assert "is taken" in capsys.readouterr().out


def test_an_address_of_another_machine_is_named(tmp_path: Path) -> None:
    playback = open_playback("simulated", simulated=SimulatedSettings())
    with pytest.raises(AddressError, match=r"192\.0\.2\.1: .*choose an address of this machine"):
        StandIn(playback, StandInSettings(0, tmp_path, host="192.0.2.1"), structlog.get_logger())


COMMAND = "import typer; from services.commands.capture import capture; typer.run(capture)"


def test_the_command_says_where_it_is_and_ends_when_asked(tmp_path: Path) -> None:
    command = [sys.executable, "-c", COMMAND, "--port", "0", "--recordings", str(tmp_path), "--fault", "duplicate@9s"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True) as child:
        assert child.stderr is not None
        lines = list(until(child.stderr.readline, "ready"))
        assert "3.6.14" in lines[-1]
        assert any("sub_port" in line for line in lines)
        child.terminate()
        # Less than 2 s on a machine that has nothing else to do.
        assert child.wait(timeout=20) == 0


def until(read: Callable[[], str], word: str) -> Iterator[str]:
    for line in iter(read, ""):
        yield line
        if word in line:
            return
