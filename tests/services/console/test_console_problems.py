"""What is wrong is said, each thing by its name, and nothing where all is well."""

from typing import Any

import pytest

from entoptic.services.console import problems as limits
from entoptic.services.console.problems import problems
from entoptic.services.console.status import BridgeSays, HostSays, ProcessSays, Snapshot, WorkerSays, read

BRIDGE = BridgeSays(source="eyes", rate_hz=200.0, clock_uncertainty_ms=0.3)
WORKER = WorkerSays(scene="street", fps=24.0, reached_fps=23.9, dropped=0)
PROCESSES = {"bridge": ProcessSays(1, "running"), "worker": ProcessSays(2, "running")}
HOST = HostSays(running=True, processes=PROCESSES)


def snapshot(**more: Any) -> Snapshot:
    well: dict[str, Any] = {"hosted": True, "host": HOST, "bridge": BRIDGE, "worker": WORKER, "states_silent_s": 0.0}
    return Snapshot(**(well | {"frames_silent_s": 0.1, "free_bytes": 10**12} | more))


def host(name: str, state: str, last_error: str | None = None) -> HostSays:
    return HostSays(running=True, processes=PROCESSES | {name: ProcessSays(3, state, 1, last_error)})


def test_all_is_well() -> None:
    assert problems(snapshot()) == ()
    assert problems(snapshot(hosted=False, host=None)) == ()


@pytest.mark.parametrize(
    ("more", "name", "severity", "said"),
    [
        ({"host": None, "host_silent_s": 4.0}, "host gone", "error", "4 s"),
        ({"host": HostSays()}, "nothing runs", "note", "No session"),
        ({"host": HostSays(running=True, trouble="no such scene")}, "host trouble", "warning", "no such scene."),
        ({"host": host("worker", "restarting", "killed")}, "worker restarting", "warning", "killed"),
        ({"host": host("bridge", "failed", "no port")}, "bridge failed", "error", "no port"),
        ({"bridge": None, "bridge_silent_s": 5.0}, "bridge silent", "error", "5 s"),
        ({"worker": None, "worker_silent_s": 5.0}, "worker silent", "error", "5 s"),
        ({"hosted": False, "host": None, "worker": None, "worker_silent_s": 5.0}, "worker silent", "error", "5 s"),
        ({"bridge": BridgeSays(silent="unplugged")}, "no tracker", "error", "unplugged"),
        ({"states_silent_s": 5.0}, "no states", "error", "5 s"),
        ({"lost_s": {"left": 3.0}}, "pupil lost left", "warning", "The left pupil has been lost for 3 s"),
        ({"lost_s": {"right": 3.0, "left": 1.0}}, "pupil lost right", "warning", "other eye's"),
        ({"bridge": BridgeSays(clock_uncertainty_ms=35.0)}, "clock uncertain", "warning", "±35 ms"),
        ({"dropped_share": 0.4}, "worker behind", "warning", "40 % of the frames: 23.9 frames a second of 24 asked"),
        ({"frames_silent_s": 9.0}, "no frames", "error", "9 s"),
        ({"latency_p95_ms": 400.0}, "late", "warning", "400 ms"),
        ({"free_bytes": 10**9}, "disk nearly full", "warning", "1000 MB"),
        ({"free_bytes": 10**8}, "disk nearly full", "error", "100 MB"),
        ({"worker": WorkerSays(trouble="disk full")}, "worker trouble", "error", "disk full"),
        ({"trouble": "disk full"}, "worker trouble", "error", "disk full"),
        ({"bridge": BridgeSays(trouble="disk full")}, "bridge trouble", "error", "disk full"),
    ],
)
def test_one_thing_is_wrong(more: dict[str, Any], name: str, severity: str, said: str) -> None:
    (problem,) = problems(snapshot(**more))
    assert (problem.name, problem.severity) == (name, severity)
    assert said in problem.what
    assert problem.what.endswith(".")
    assert problem.remedy.endswith(".")


def test_both_pupils_lost_is_an_error_for_each() -> None:
    found = problems(snapshot(lost_s={"left": 9.0, "right": 9.0}))
    assert [problem.severity for problem in found] == ["error", "error"]


def test_the_worst_comes_first() -> None:
    found = problems(snapshot(dropped_share=0.5, free_bytes=1, lost_s={"left": 9.0}))
    assert [problem.severity for problem in found] == ["error", "warning", "warning"]
    crashed = problems(snapshot(host=host("bridge", "restarting"), latency_p95_ms=400.0, lost_s={"left": 9.0}))
    assert [problem.name for problem in crashed] == ["bridge restarting", "pupil lost left", "late"]


@pytest.mark.parametrize(
    "more",
    [
        {"host": host("bridge", "starting"), "bridge": None, "bridge_silent_s": 9.0},
        {"host": None, "host_silent_s": 1.0},
        {"worker": WorkerSays(preparing=True), "frames_silent_s": 60.0, "dropped_share": 0.9},
        {"lost_s": {"left": 0.6}},
        {"states_silent_s": None, "frames_silent_s": None},
        {"dropped_share": limits.BEHIND_SHARE},
        {"bridge": BridgeSays(clock_uncertainty_ms=None)},
    ],
)
def test_what_passes_by_itself_is_not_said(more: dict[str, Any]) -> None:
    assert problems(snapshot(**more)) == ()


def test_one_cause_is_said_once() -> None:
    gone = problems(snapshot(bridge=BridgeSays(silent="unplugged"), states_silent_s=9.0, lost_s={"left": 9.0}))
    assert [problem.name for problem in gone] == ["no tracker"]
    trouble = HostSays(running=True, trouble="disk full; the worker crashed and is started anew; x")
    assert problems(snapshot(host=trouble, trouble="disk full"))[0].name == "worker trouble"
    crashed = HostSays(
        running=True,
        processes=PROCESSES | {"worker": ProcessSays(3, "restarting", 1, "x")},
        trouble="the worker crashed and is started anew; x",
    )
    assert [one.name for one in problems(snapshot(host=crashed))] == ["worker restarting"]


def test_settings_that_were_taken_back_have_a_remedy_of_their_own() -> None:
    said = "disk full; settings were taken back, since they cannot be rendered: no memory"
    both = problems(snapshot(worker=WorkerSays(trouble=said)))
    assert [one.name for one in both] == ["worker trouble", "settings taken back"]
    assert both[0].what == "The worker says: disk full."
    (alone,) = problems(snapshot(worker=WorkerSays(trouble=said.partition("; ")[2])))
    assert alone.what == "The last settings were taken back, since they cannot be rendered: no memory."
    assert "Record" not in alone.remedy


def test_what_a_process_says_is_read_with_care() -> None:
    assert read({"source": "eyes", "new key": 1}, BridgeSays) == BridgeSays(source="eyes")
    assert read({"rate_hz": "fast"}, BridgeSays) is None
    assert read(None, WorkerSays) is None
    assert HostSays(addresses={"states": "only"}).places is None
