"""A live worker as a process: a take, kill -9 in its middle, the rest of the take, and the same frames again."""

import csv
import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from services.control import ControlError, Reply, ask
from services.live.addresses import free_addresses
from services.live.requests import BeginTake, EndTake, GiveStatus
from services.options import Save
from services.results import finish as takes
from services.worker.again import run as render_again

PATIENCE_S = 180.0


def started(*arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "services.cli", *arguments, "--child"]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL)


def wait_for_frame(control: str, after: int) -> int:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        try:
            data = ask(control, GiveStatus(), patience_ms=500).data
        except ControlError:
            continue
        if data is not None and data["frame"] > after:
            return int(data["frame"])
        time.sleep(0.05)
    pytest.fail("no frame came")


@pytest.mark.slow
def test_a_killed_worker_goes_on_and_its_take_is_rendered_again(tmp_path: Path) -> None:
    import structlog

    at = free_addresses()
    folder, again = tmp_path / "take", tmp_path / "again"
    folder.mkdir()
    again.mkdir()
    eyes = started("bridge", "--live", "--source", "simulated", "--states", at.states, "--events", at.events)
    arguments = ["worker", "--live", "--states", at.states, "--events", at.events, "--control", at.worker]
    arguments += ["--frames", at.frames, "--resume", str(tmp_path / "checkpoint"), "--fps", "10"]
    arguments += ["--width", "60", "--height", "50", "--without", "acuity"]
    worker = started(*arguments)
    try:
        wait_for_frame(at.worker, 2)
        begin = BeginTake(str(folder), time.monotonic_ns())
        assert ask(at.worker, begin).done
        killed_at = wait_for_frame(at.worker, wait_for_frame(at.worker, 0) + 15)
        worker.kill()
        worker.wait()
        worker = started(*arguments)
        wait_for_frame(at.worker, killed_at)
        assert ask(at.worker, begin).done
        wait_for_frame(at.worker, wait_for_frame(at.worker, 0) + 5)
        ended: Reply = ask(at.worker, EndTake(), patience_ms=60_000)
        assert ended.done, ended.reply
    finally:
        for process in (worker, eyes):
            process.terminate()
        for process in (worker, eyes):
            process.wait(60)
    done = takes.finish(folder)
    with (folder / "plan.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    numbers = [int(row["frame"]) for row in rows]
    assert numbers == sorted(set(numbers))
    assert done["film"] == "perceived.mp4"
    assert len(done["restarted_s"]) == 1
    assert done["worker"]["frames"] == len(rows)
    assert any(float(row["sample_to_state_ms"] or -1) >= 0 for row in rows)
    same = render_again(folder, again, frozenset({Save.VIDEO}), lambda: False, structlog.get_logger())  # type: ignore[arg-type]
    assert same.first_different is None
    assert same.summary.perceived_sha256 == done["worker"]["perceived_sha256"]
    assert json.loads((folder / "worker.json").read_text())["frames"] == len(rows)
