import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from entoptic.services.live.registry import Registration, RunningHost, running

OTHER = """
import os, time
from entoptic.services.live.registry import Registration, RunningHost
kept = Registration(RunningHost(os.getpid(), "tcp://127.0.0.1:1", "now"))
print("there", flush=True)
time.sleep(60)
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path / "entoptic" / "hosts"


def test_a_host_is_found_while_it_runs_and_leaves_nothing(folder: Path) -> None:
    host = RunningHost(os.getpid(), "tcp://127.0.0.1:5000", "now")
    registration = Registration(host)
    # Locks are of open files: this process asks as another one would.
    assert list(running()) == [host]
    assert registration.scratch.is_dir()
    registration.close()
    assert list(running()) == []
    assert list(folder.iterdir()) == []


def test_what_a_killed_host_left_is_removed(folder: Path) -> None:
    other = subprocess.Popen([sys.executable, "-c", OTHER], stdout=subprocess.PIPE, text=True)
    assert other.stdout is not None
    other.stdout.readline()
    assert [one.pid for one in running()] == [other.pid]
    other.send_signal(signal.SIGKILL)
    other.wait()
    other.stdout.close()
    assert any(folder.iterdir())
    assert list(running()) == []
    assert list(folder.iterdir()) == []


def test_a_number_that_another_process_has_now_is_no_host(folder: Path) -> None:
    folder.mkdir(parents=True)
    (folder / f"{os.getpid()}.json").write_text('{"pid": 1, "control": "tcp://127.0.0.1:1", "started": "then"}')
    assert list(running()) == []
    assert list(folder.iterdir()) == []
