from __future__ import annotations

import pytest

from entoptic.tracker_bridge.events import TaskKind, TaskOutcome, TrackerTask
from entoptic.tracker_bridge.sources.pupil_core import remote as pupil_remote
from entoptic.tracker_bridge.sources.pupil_core.tasks import EXPECTED, FIT, Command, OpenTasks, Order

S = 1_000_000_000
REQUESTS = {
    Command.START_RECORDING: pupil_remote.start_recording(),
    Command.STOP_RECORDING: pupil_remote.STOP_RECORDING,
    Command.START_CALIBRATION: pupil_remote.START_CALIBRATION,
    Command.STOP_CALIBRATION: pupil_remote.STOP_CALIBRATION,
}


def order(command: Command, given_ns: int = 0) -> Order:
    return Order(command, REQUESTS[command], given_ns)


def calibration(outcome: TaskOutcome, t_ns: int) -> TrackerTask:
    return TrackerTask(t_ns, TaskKind.GAZE_CALIBRATION, outcome, "")


@pytest.mark.parametrize("command", list(Command))
def test_an_order_without_an_answer_fails_when_its_time_is_up(command: Command) -> None:
    tasks = OpenTasks()
    tasks.expect(order(command))
    limit_ns = round(EXPECTED[command].within_s * S)
    assert tasks.overdue(limit_ns - 1) == ()
    (failure,) = tasks.overdue(limit_ns)
    assert (failure.t_ns, failure.kind, failure.outcome) == (limit_ns, EXPECTED[command].kind, TaskOutcome.FAILED)
    assert f"was told to {command}" in failure.detail
    assert tasks.overdue(10 * limit_ns) == ()


def test_the_log_says_why() -> None:
    tasks = OpenTasks()
    tasks.remark("recorder: long ago", -1)
    tasks.expect(order(Command.START_RECORDING))
    assert "long ago" not in tasks.overdue(6 * S)[0].detail
    tasks.expect(order(Command.START_RECORDING, 10 * S))
    tasks.remark("recorder: Session dir not writable.", 11 * S)
    assert "not writable" in tasks.overdue(16 * S)[0].detail


@pytest.mark.parametrize("outcome", [TaskOutcome.SUCCEEDED, TaskOutcome.FAILED])
def test_a_stopped_calibration_waits_for_its_fit(outcome: TaskOutcome) -> None:
    tasks = OpenTasks()
    tasks.expect(order(Command.STOP_CALIBRATION))
    tasks.note(calibration(TaskOutcome.STOPPED, S))
    fit_ns = S + round(FIT.within_s * S)
    assert tasks.overdue(fit_ns - 1) == ()
    tasks.note(calibration(outcome, fit_ns - 1))
    assert tasks.overdue(fit_ns) == ()


def test_a_fit_that_does_not_end_is_a_failure() -> None:
    tasks = OpenTasks()
    tasks.expect(order(Command.STOP_CALIBRATION))
    tasks.note(calibration(TaskOutcome.STOPPED, S))
    (failure,) = tasks.overdue(61 * S)
    assert "ended" in failure.detail


def test_old_versions_say_how_it_ended_before_they_say_that_it_stopped() -> None:
    tasks = OpenTasks()
    tasks.expect(order(Command.STOP_CALIBRATION))
    tasks.note(calibration(TaskOutcome.SUCCEEDED, S))
    tasks.note(calibration(TaskOutcome.STOPPED, S))
    assert tasks.overdue(100 * S) == ()


def test_another_task_is_no_answer() -> None:
    tasks = OpenTasks()
    tasks.expect(order(Command.START_RECORDING))
    tasks.note(calibration(TaskOutcome.STARTED, S))
    tasks.note(TrackerTask(S, TaskKind.RECORDING, TaskOutcome.STOPPED, ""))
    assert len(tasks.overdue(5 * S)) == 1


def test_an_order_that_is_refused_fails_once() -> None:
    tasks = OpenTasks()
    given = order(Command.START_CALIBRATION)
    tasks.expect(given)
    (failure,) = tasks.refused(given, "nobody answers", S)
    assert "start its gaze calibration: nobody answers" in failure.detail
    assert tasks.refused(given, "nobody answers", S) == ()
    assert tasks.overdue(10 * S) == ()


def test_each_report_answers_one_order() -> None:
    tasks = OpenTasks()
    for given_ns in (0, S):
        tasks.expect(order(Command.START_RECORDING, given_ns))
    tasks.note(TrackerTask(2 * S, TaskKind.RECORDING, TaskOutcome.STARTED, ""))
    assert len(tasks.overdue(10 * S)) == 1
