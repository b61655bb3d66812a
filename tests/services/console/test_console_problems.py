"""What is wrong is said, each thing by its code and from its limit on, and nothing where all is well."""

import errno
from typing import Any

import pytest

from entoptic.services.console.problems import Snapshot, problems
from entoptic.services.ipc.status import BridgeStatus, HostStatus, WorkerStatus, problem, unwritable

BRIDGE = BridgeStatus(source="eyes", rate_hz=200.0, clock_uncertainty_ms=0.3)
WORKER = WorkerStatus(scene="street", fps=24.0, reached_fps=23.9, dropped=0)
HOST = HostStatus(running=True, state="running")
FULL = unwritable("/study/one", OSError(errno.ENOSPC, "No space left on device"))
NO_TRACKER = problem("no tracker", "error", "nothing comes", "plug it in")


def snapshot(**more: Any) -> Snapshot:
    well: dict[str, Any] = {"hosted": True, "host": HOST, "bridge": BRIDGE, "worker": WORKER, "states_silent_s": 0.0}
    return Snapshot(**(well | {"frames_silent_s": 0.1, "free_bytes": 10**12} | more))


def bridge(**more: Any) -> BridgeStatus:
    return BridgeStatus(**{"source": "eyes", "rate_hz": 200.0, **more})


def test_all_is_well() -> None:
    assert problems(snapshot()) == ()
    assert problems(snapshot(hosted=False, host=None)) == ()


# Limits are written down once more here, just below and just above: a constant that changes is a change of behaviour.
@pytest.mark.parametrize(
    ("more", "code", "severity", "words"),
    [
        ({"host": None, "bridge": None, "worker": None, "silent_s": {"host": 4.0}}, "host gone", "error", "4 s"),
        ({"host": HostStatus()}, "nothing runs", "note", "No session"),
        ({"hosted": False, "host": None, "worker": None, "silent_s": {"worker": 5.0}}, "worker silent", "error", "5 s"),
        ({"hosted": False, "host": None, "bridge": None, "silent_s": {"bridge": 5.0}}, "bridge silent", "error", "5 s"),
        ({"unreachable": "no such address"}, "unreachable", "error", "No such address."),
        ({"states_silent_s": 2.1}, "no states", "error", "2 s"),
        ({"lost_s": {"left": 1.6}}, "pupil lost left", "warning", "The left pupil has been lost for 2 s"),
        ({"lost_s": {"right": 3.0, "left": 1.4}}, "pupil lost right", "warning", "other eye's"),
        ({"bridge": bridge(clock_uncertainty_ms=20.5)}, "clock uncertain", "warning", "±20 ms"),
        ({"dropped_share": 0.11}, "worker behind", "warning", "11 % of the frames: 23.9 frames a second of 24 asked"),
        ({"frames_silent_s": 4.1}, "no frames", "error", "4 s"),
        ({"latency_p95_ms": 251.0}, "late", "warning", "251 ms"),
        ({"free_bytes": 1_999_000_000}, "disk nearly full", "warning", "1999 MB"),
        ({"free_bytes": 199_000_000}, "disk nearly full", "error", "199 MB"),
    ],
)
def test_one_thing_is_wrong(more: dict[str, Any], code: str, severity: str, words: str) -> None:
    (found,) = problems(snapshot(**more))
    assert (found.code, found.severity) == (code, severity)
    assert words in found.what
    assert found.what.endswith(".")
    assert found.remedy.endswith(".")


@pytest.mark.parametrize(
    "more",
    [
        {"bridge": None, "worker": None},
        {"worker": WorkerStatus(preparing=True), "frames_silent_s": 60.0, "dropped_share": 0.9},
        {"lost_s": {"left": 1.4}},
        {"states_silent_s": None, "frames_silent_s": None},
        {"states_silent_s": 1.9, "frames_silent_s": 3.9},
        {"free_bytes": None},
        {"dropped_share": 0.1},
        {"latency_p95_ms": 249.0},
        {"free_bytes": 2_000_000_000},
        {"bridge": bridge(clock_uncertainty_ms=None)},
        {"bridge": bridge(clock_uncertainty_ms=19.9)},
    ],
)
def test_what_passes_by_itself_is_not_said(more: dict[str, Any]) -> None:
    assert problems(snapshot(**more)) == ()


@pytest.mark.parametrize("more", [{"dropped_share": 0.2}, {"latency_p95_ms": 300.0}])
def test_a_slow_scene_is_named_where_it_is_the_scene_that_is_slow(more: dict[str, Any]) -> None:
    def said(scene_ms: float) -> tuple[str, str]:
        worker = WorkerStatus(scene="street", fps=24.0, reached_fps=12.0, scene_ms=scene_ms, frame_ms=80.0)
        (found,) = problems(snapshot(worker=worker, **more))
        return found.what, found.remedy

    what, remedy = said(41.0)
    assert what.endswith("making the scene takes 41 of 80 ms of a frame.")
    assert "another scene" in remedy
    assert "budget" not in remedy
    what, remedy = said(39.0)
    assert "scene" not in what
    assert "a time budget under Plan" in remedy


def test_both_pupils_lost_is_an_error_for_each() -> None:
    found = problems(snapshot(lost_s={"left": 9.0, "right": 9.0}))
    assert [one.severity for one in found] == ["error", "error"]


def test_the_worst_comes_first() -> None:
    found = problems(snapshot(dropped_share=0.5, free_bytes=1, lost_s={"left": 9.0}))
    assert [one.code for one in found] == ["disk nearly full", "pupil lost left", "worker behind"]


def test_what_the_processes_say_is_told_once() -> None:
    worker, eyes = WorkerStatus(fps=24.0, problems=(FULL,)), bridge(problems=(FULL,))
    host = HostStatus(running=True, problems=(FULL,))
    assert problems(snapshot(host=host, worker=worker, bridge=eyes, free_bytes=0)) == (FULL,)
    assert problems(snapshot(hosted=False, host=None, worker=worker, bridge=eyes, free_bytes=0)) == (FULL,)


def test_a_tracker_that_is_gone_is_the_cause_of_the_rest() -> None:
    gone = bridge(problems=(NO_TRACKER,))
    assert problems(snapshot(bridge=gone, states_silent_s=9.0, lost_s={"left": 9.0})) == (NO_TRACKER,)


def test_eyes_and_frames_count_while_a_session_runs_alone() -> None:
    lost = {"lost_s": {"left": 9.0}, "frames_silent_s": 9.0}
    assert [one.code for one in problems(snapshot(host=HostStatus(), **lost))] == ["nothing runs"]
    gone = snapshot(host=None, silent_s={"host": 9.0}, **lost)
    assert [one.code for one in problems(gone)] == ["host gone"]
    unhosted = snapshot(hosted=False, host=None, **lost)
    assert [one.code for one in problems(unhosted)] == ["no frames", "pupil lost left"]
