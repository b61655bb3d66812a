import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from entoptic.services.config import EyesConfig
from entoptic.services.live.children import Child
from entoptic.services.live.journal import Journal
from entoptic.services.live.supervised import Supervised
from entoptic.services.process_config import BridgeConfig

BRIDGE = BridgeConfig(live=True)
"""One without an end."""
NOWHERE = BridgeConfig(eyes=EyesConfig(source="nowhere/"))


def wait_for(condition: object, within_s: float = 60.0) -> None:
    assert callable(condition)
    until_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < until_s, "it did not come to that"
        time.sleep(0.02)


def lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    stat = Path(f"/proc/{pid}/stat")
    return not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] != "Z"


def test_a_child_is_listened_to_and_stops_when_asked() -> None:
    child = Child("bridge", BRIDGE)
    said = []
    wait_for(lambda: said.extend(child.drain()) or any(one["event"] == "ready" for one in said))
    assert all((one["process"], one["pid"]) == ("bridge", child.pid) for one in said)
    assert child.code() is None
    assert child.end(10.0)
    assert child.code() == 0


def test_a_child_that_fails_says_why() -> None:
    child = Child("bridge", NOWHERE)
    wait_for(lambda: child.code() is not None)
    said = [one["error"] for one in child.drain() if "error" in one]
    assert child.ending(said[-1]).startswith("(exit status 1): nowhere/ does not exist")
    child.end(0.0)


PARENT = """
import sys, time
from entoptic.services.process_config import BridgeConfig
from entoptic.services.live.children import Child
child = Child("bridge", BridgeConfig(live=True))
while not any(one["event"] == "ready" for one in child.drain()):
    time.sleep(0.02)
print(child.pid, flush=True)
time.sleep(600)
"""


def test_a_child_ends_with_a_killed_parent() -> None:
    parent = subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    pid = int(parent.stdout.readline())
    assert lives(pid)
    parent.kill()
    parent.wait()
    parent.stdout.close()
    wait_for(lambda: not lives(pid))


def step_until(one: Supervised, condition: Callable[[], bool]) -> None:
    def stepped() -> bool:
        one.step()
        return condition()

    wait_for(stepped, 60.0)


@pytest.fixture
def journal(tmp_path: Path) -> Journal:
    return Journal(tmp_path)


@pytest.mark.slow
def test_a_killed_process_is_started_again_and_the_gap_is_noted(journal: Journal) -> None:
    one = Supervised("bridge", lambda: BRIDGE, "ready", journal)
    one.start()
    step_until(one, lambda: one.is_ready)
    first = one.pid
    assert first is not None
    os.kill(first, signal.SIGKILL)
    step_until(one, lambda: one.state == "restarting")
    assert one.gaps[0].to_ns is None
    step_until(one, lambda: one.is_ready)
    assert one.pid != first
    assert (one.restarts_count, len(one.gaps)) == (1, 1)
    gap = one.gaps[0]
    assert gap.to_ns is not None
    assert gap.to_ns - gap.from_ns > 0.2e9
    assert "signal 9" in gap.why
    one.stop(5.0)
    step_until(one, lambda: not one.lives)
    assert one.state == "stopped"


@pytest.mark.slow
def test_one_that_crashes_again_and_again_is_given_up(journal: Journal) -> None:
    one = Supervised("bridge", lambda: NOWHERE, "ready", journal)
    one.start()
    step_until(one, lambda: one.state == "failed")
    assert one.restarts_count == 4
    assert one.last_error is not None
    assert "nowhere/ does not exist" in one.last_error


@pytest.mark.slow
def test_one_that_does_not_stop_in_time_is_killed(journal: Journal) -> None:
    one = Supervised("bridge", lambda: BRIDGE, "ready", journal)
    one.start()
    step_until(one, lambda: one.is_ready)
    assert one.pid is not None
    os.kill(one.pid, signal.SIGSTOP)
    begun_s = time.monotonic()
    one.stop(0.5)
    step_until(one, lambda: not one.lives)
    assert time.monotonic() - begun_s < 2.0
    assert one.state == "stopped"


def test_one_that_ends_by_itself_with_all_done_is_not_started_again(journal: Journal) -> None:
    one = Supervised("bridge", lambda: BridgeConfig(seconds=0.1), "ready", journal)
    one.start()
    step_until(one, lambda: not one.lives)
    assert one.state == "stopped"
    assert one.ended is not None
    assert one.gaps == []
