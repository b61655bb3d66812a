"""Real processes over real sockets."""

import csv
import hashlib
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import av
import pytest
from msgspec.structs import replace

from entoptic.pipeline.scenes import Head
from entoptic.services.results import kept
from entoptic.services.results.render_log import FrameRecord, RenderLog

SMALL = ("--width", "90", "--height", "100", "--fps", "20", "--eyes", "both")


def session(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "entoptic", "session", *SMALL, *arguments],
        cwd=cwd,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=200,
        check=False,
    )


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


LIVING = """
[observer]
gratings = 0
particles = 300
cornea_cells = 0

[observer.ocular_dynamics]
microfluctuations = true
lens = true
vitreous = true
lids = true
lashes = true
"""


def children_of(process: subprocess.Popen[str]) -> list[str]:
    """Command lines of the processes that one has started."""
    listed = subprocess.run(["ps", "-wwo", "args", "--ppid", str(process.pid)], capture_output=True, text=True).stdout
    return [line for line in listed.splitlines()[1:] if line]


def test_a_session_end_to_end_and_the_same_again(tmp_path: Path) -> None:
    summaries = []
    for name in ("one", "two"):
        done = session(
            "--seconds", "1.5", "--seed", "4", "--out", name, "--save", "video", "--save", "png", cwd=tmp_path
        )
        assert done.returncode == 0, done.stderr
        summaries.append(json.loads((tmp_path / name / "summary.json").read_text()))
    one = tmp_path / "one"
    assert {path.name for path in one.iterdir()} == {
        ".entoptic", "bridge.json", "events.csv", "frames", "key_frames", "render_log.msgpack", "perceived.mp4",
        "plan.csv", "report.html", "scene_luminance.csv", "session.json", "settings.toml", "states.csv",
        "summary.json", "worker.json",
    }  # fmt: skip
    worker = summaries[0]["worker"]
    assert worker["frames"] == 30
    assert worker["reception"]["messages_refused"] == {}
    assert len(rows(one / "states.csv")) == summaries[0]["bridge"]["states"] == worker["reception"]["states_received"]
    plan = rows(one / "plan.csv")
    assert [int(row["frame"]) for row in plan] == list(range(30))
    assert all(row["glare_reason"] and float(row["total_ms"]) > 0 for row in plan)
    with av.open(str(one / "perceived.mp4")) as film:
        assert sum(1 for _ in film.decode(video=0)) == 30
    assert len(list((one / "frames").glob("*.png"))) == 30
    report = (one / "report.html").read_text()
    for part in ("<svg", "As displayed, and as perceived", "What each frame called for", "Pupils"):
        assert part in report
    # Deterministic: the same frames to the bit, in memory and on disk.
    assert summaries[1]["worker"]["perceived_sha256"] == worker["perceived_sha256"]
    for form in ("perceived.mp4", "frames/000011.png", "states.csv"):
        first, second = (hashlib.sha256((tmp_path / name / form).read_bytes()).digest() for name in ("one", "two"))
        assert first == second
    # Rendered again from what was kept.
    told = {
        "gaps": [{"process": "worker", "from_s": 0.1, "to_s": 0.2, "why": "killed"}],
        "problems": [{"code": "once", "severity": "note", "what": "Once.", "remedy": "None."}],
        "interrupted": True,
    }
    (one / "summary.json").write_text(json.dumps({**summaries[0], **told}))
    (one / "inputs" / "scene").mkdir(parents=True)
    (one / "inputs" / "scene" / "street.exr").write_bytes(b"any")
    again = session("--again", "one", "--out", "again", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert "all frames are the same" in again.stderr + again.stdout
    summary = json.loads((tmp_path / "again" / "summary.json").read_text())
    assert summary["worker"]["perceived_sha256"] == worker["perceived_sha256"]
    assert {name: summary[name] for name in told} == told
    assert (tmp_path / "again" / "inputs" / "scene" / "street.exr").read_bytes() == b"any"
    assert "worker away from 0.1 s to 0.2 s: killed" in (tmp_path / "again" / "report.html").read_text()
    # A record that says otherwise than what was rendered.
    render_log = RenderLog(one / "render_log.msgpack")
    records = [
        replace(record, head=Head(40.0, 0.0, 0.0)) if isinstance(record, FrameRecord) and record.frame == 27 else record
        for record in (render_log.begun, *render_log)
    ]
    (one / "render_log.msgpack").write_bytes(b"".join(map(kept.encode, records)))
    otherwise = session("--again", "one", "--out", "otherwise", cwd=tmp_path)
    assert otherwise.returncode == 1
    assert "frames differ from frame 27 on; the largest difference in the 3 whose pictures" in otherwise.stderr
    assert "0 at most is promised" in otherwise.stderr


@pytest.mark.slow
def test_eyes_in_motion_are_the_same_twice(tmp_path: Path) -> None:
    """Saccades come on another socket than states, and still always meet the same frame."""
    (tmp_path / "living.toml").write_text(LIVING)
    hashes = []
    for name in ("one", "two"):
        done = session(
            "--seconds", "0.5", "--seed", "4", "--fps", "10", "--out", name, "--settings", "living.toml", cwd=tmp_path
        )
        assert done.returncode == 0, done.stderr
        summary = json.loads((tmp_path / name / "summary.json").read_text())
        hashes.append(summary["worker"]["perceived_sha256"])
    assert hashes[0] == hashes[1]


@pytest.mark.slow
def test_a_live_session_keeps_the_clock_and_says_what_it_dropped(tmp_path: Path) -> None:
    done = session("--seconds", "3", "--live", "--eyes", "left", "--out", "live", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    worker = json.loads((tmp_path / "live" / "summary.json").read_text())["worker"]
    # Whether this machine keeps up is not the test: each frame from the first to the last was rendered or dropped.
    numbers = [int(row["frame"]) for row in rows(tmp_path / "live" / "plan.csv")]
    assert worker["frames"] == len(numbers)
    assert numbers == sorted(set(numbers))
    assert numbers[-1] <= 3 * 20
    assert numbers[-1] - numbers[0] + 1 <= worker["frames"] + worker["dropped_frames"] <= 3 * 20 + 1 - numbers[0]


def started(tmp_path: Path, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "entoptic", "session", *SMALL, "--out", str(tmp_path / "out"), *arguments],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_for(condition: object, process: subprocess.Popen[str]) -> None:
    assert callable(condition)
    for _ in range(600):
        if condition():
            return
        assert process.poll() is None
        time.sleep(0.1)
    pytest.fail("it did not come to that in a minute")


@pytest.mark.slow
def test_ctrl_c_keeps_whole_files(tmp_path: Path) -> None:
    process = started(tmp_path, "--seconds", "40")
    plan = tmp_path / "out.new" / "plan.csv"
    wait_for(lambda: plan.exists() and len(rows(plan)) >= 2, process)
    assert children_of(process) == []
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["interrupted"] is True
    assert not (tmp_path / "out.new").exists()
    kept = rows(tmp_path / "out" / "plan.csv")
    assert 2 <= len(kept) < 800
    with av.open(str(tmp_path / "out" / "perceived.mp4")) as film:
        assert sum(1 for _ in film.decode(video=0)) == len(kept)


@pytest.mark.slow
def test_ctrl_c_while_all_is_compiled_ends_it_at_once(tmp_path: Path) -> None:
    process = started(tmp_path, "--seconds", "40")
    # The file comes just before all is compiled.
    wait_for((tmp_path / "out.new" / "scene_luminance.csv").exists, process)
    begun_s = time.monotonic()
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert time.monotonic() - begun_s < 2.5  # two, where no other tests keep the cores busy
    assert process.returncode == 130
    assert "stopped before the first frame: nothing was written" in said
    assert list(tmp_path.iterdir()) == []
