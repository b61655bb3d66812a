"""kill -9 at random moments, and ends that must come quickly; minutes long, so by hand and by `make test-all`."""

import json
import os
import random
import signal
import statistics
import time
from pathlib import Path

import pytest
from live_hosts import SIZE, alive, frames_of, live_host, ports_are_free, until

from entoptic.services.ipc.requests import Record, StopRecord

KILLS = 20


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_twenty_kills_at_random_moments(tmp_path: Path) -> None:
    by_chance = random.Random(6)
    victims = [name for name in ("bridge", "worker", "web") for _ in range(7)][:KILLS]
    by_chance.shuffle(victims)
    with live_host(tmp_path, "console", "--port", "0") as host:
        running = host.start()
        assert host.ask(Record("kills")).done
        folder = Path(running["root"]) / "kills.partial"
        until(lambda: (folder / "plan.csv").exists() and frames_of(folder) > 3, "frames are kept")
        for name in victims:
            time.sleep(by_chance.uniform(0.5, 4.0))
            pid = host.pids().get(name)
            # Sometimes it is not back yet from the last time: that is a random moment too.
            if pid is not None:
                os.kill(pid, signal.SIGKILL)
                until(lambda pid=pid: not alive(pid), f"{name} is gone", 5.0)
            frames_of(folder)
            host.until(lambda now, name=name: now["processes"][name]["state"] == "running", f"{name} goes on")
        before = frames_of(folder)
        until(lambda: frames_of(folder) > before + 2, "frames are kept after all that")
        assert host.status()["running"]
        assert host.ask(StopRecord()).done
        now = host.until(lambda now: now["last_recording"] and not now["finishing"], "the take is finished")
        finished = Path(now["last_recording"])
        summary = json.loads((finished / "summary.json").read_text())
        assert {gap["process"] for gap in summary["gaps"]} == {"bridge", "worker"}
        assert frames_of(finished) == summary["worker"]["frames"]
        assert (finished / "report.html").exists()
        pids = list(host.pids().values())
        host.end()
        assert not any(alive(pid) for pid in pids)
        assert ports_are_free(running["addresses"])


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_ctrl_c_and_sigterm_end_all_within_two_seconds(tmp_path: Path) -> None:
    taken_s = []
    for k in range(20):
        by_chance = random.Random(k)
        with live_host(tmp_path / str(k), "session", "--live", *SIZE, "--out", "take") as host:
            folder = tmp_path / str(k) / "take.partial"
            if k % 4:  # else while it compiles
                until(lambda folder=folder: (folder / "plan.csv").exists() and frames_of(folder) > 3, "frames are kept")
            time.sleep(by_chance.uniform(0.0, 2.0))
            pids = list(host.pids().values())
            taken_s.append(host.end(signal.SIGINT if k % 2 else signal.SIGTERM))
            assert not any(alive(pid) for pid in pids)
            if k % 4:
                kept = [path for path in (folder, folder.with_name("take")) if path.exists()]
                assert len(kept) == 1
                assert frames_of(kept[0]) > 3
    print(f"seconds: median {statistics.median(taken_s):.2f}, most {max(taken_s):.2f}; {sorted(taken_s)}")
    assert max(taken_s) < 2.0
