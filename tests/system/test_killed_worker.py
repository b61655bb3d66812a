"""A live worker as a process: a take, kill -9 in its middle, the rest of the take, and the same frames again."""

import csv
import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from entoptic.pipeline import Planning
from entoptic.services.config import Save, ViewConfig
from entoptic.services.ipc.addresses import free_addresses
from entoptic.services.ipc.client import ControlError, Reply, ask
from entoptic.services.ipc.requests import ChangeSettings, GiveStatus, StartRecording, StopRecording
from entoptic.services.process import Stop
from entoptic.services.process_config import BridgeConfig, WorkerLinks
from entoptic.services.results import finish as takes
from entoptic.services.results.render_log import FrameRecord, RenderLog, Resumed
from entoptic.services.results.render_log import Perceive as PerceiveRecord
from entoptic.services.session.again import render
from entoptic.services.session.watch import Work
from entoptic.services.session_config import WorkerConfig
from entoptic.services.settings import Settings

PATIENCE_S = 180.0


def started(name: str, config: msgspec.Struct) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "entoptic.services.child", name]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL)
    assert process.stdin is not None
    process.stdin.write(msgspec.json.encode(config) + b"\n")
    process.stdin.flush()
    return process


def wait_for(control: str, so: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        try:
            data = ask(control, GiveStatus(), patience_ms=500).data
        except ControlError:
            continue
        if data is not None and so(data):
            return data
        time.sleep(0.05)
    pytest.fail("it never was so")


def wait_for_frame(control: str, after: int) -> int:
    return int(wait_for(control, lambda now: now["frame"] > after)["frame"])


@pytest.mark.slow
def test_a_killed_worker_goes_on_and_its_take_is_rendered_again(tmp_path: Path) -> None:
    at = free_addresses()
    folder, again = tmp_path / "take", tmp_path / "again"
    folder.mkdir()
    again.mkdir()
    eyes = started("bridge", BridgeConfig(live=True, states=at.states, events=at.events))
    links = WorkerLinks(
        states=at.states, events=at.events, control=at.worker, frames=at.frames, resume=str(tmp_path / "checkpoint")
    )
    view = ViewConfig(fps=10.0, width_px=60, height_px=50)
    config = WorkerConfig(links=links, view=view, settings=Settings(plan=Planning(leave_out=frozenset({"acuity"}))))
    worker = started("worker", config)
    try:
        wait_for_frame(at.worker, 2)
        begin = StartRecording(str(folder), time.monotonic_ns())
        assert ask(at.worker, begin).done
        wanted = wait_for(at.worker, lambda now: True)["settings"]
        wanted["observer"]["age_years"] = 66.0
        assert ask(at.worker, ChangeSettings(msgspec.convert(wanted, Settings))).done
        revision = wait_for(
            at.worker, lambda now: now["recording"] and now["settings"]["observer"]["age_years"] == 66.0
        )["revision"]
        # With the second frame from here on the first one's checkpoint is written.
        killed_at = wait_for_frame(at.worker, wait_for_frame(at.worker, wait_for_frame(at.worker, 0) + 15))
        worker.kill()
        worker.wait()
        worker = started("worker", config)
        wait_for_frame(at.worker, killed_at)
        resumed = wait_for(at.worker, lambda now: True)
        assert resumed["revision"] > revision
        assert resumed["settings"]["observer"]["age_years"] == 66.0
        assert resumed["dropped"] > 0
        assert ask(at.worker, begin).done
        wait_for(at.worker, lambda now: now["recording"])
        wait_for_frame(at.worker, wait_for_frame(at.worker, 0) + 5)
        ended: Reply = ask(at.worker, StopRecording(), patience_ms=60_000)
        assert ended.done, ended.reply
    finally:
        for process in (worker, eyes):
            process.terminate()
        for process in (worker, eyes):
            process.wait(60)
    # Restarted with its state: what the eyes remembered, its clock, and what it was told since it was started.
    render_log = RenderLog(folder / "render_log.msgpack")
    records = list(render_log)
    (at_restart,) = (record for record in records if isinstance(record, Resumed))
    told = next(record for record in records if isinstance(record, PerceiveRecord))
    before = [record for record in records[: records.index(at_restart)] if isinstance(record, FrameRecord)]
    assert at_restart.state is not None
    assert at_restart.state.adapted_cd_m2[0] > 0
    assert at_restart.zero_s == render_log.begun.zero_s
    assert at_restart.perception == told.perception != render_log.begun.perception
    first = next(record for record in records[records.index(at_restart) :] if isinstance(record, FrameRecord))
    assert first.frame > before[-1].frame
    assert first.t_s == first.frame / 10
    done = takes.finish(folder)
    with (folder / "plan.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    numbers = [int(row["frame"]) for row in rows]
    assert numbers == sorted(set(numbers))
    assert done["film"] == "perceived.mp4"
    assert len(done["restarted_s"]) == 1
    assert len(rows) <= done["worker"]["frames"] <= len(rows) + 1  # the killed worker's last row may be missing
    assert done["worker"]["reception"] is None
    assert any(float(row["sample_to_state_ms"] or -1) >= 0 for row in rows)
    assert render(folder, again, frozenset({Save.VIDEO}), None, Stop(), Work()) is None
    summary = json.loads((again / "worker.json").read_text())
    assert summary["perceived_sha256"] == done["worker"]["perceived_sha256"]
    assert json.loads((folder / "worker.json").read_text())["frames"] == len(rows)
