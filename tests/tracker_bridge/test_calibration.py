"""The routine's steps: which screens it asks for, when, and what pauses, silence and an abort make of it."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge.calibration import (
    LATE_SAMPLES_NS,
    PAUSED_SAMPLES,
    SHOWN_WITHIN_NS,
    Calibration,
    CalibrationError,
    Protocol,
    Screen,
    ShownScreen,
    ShowScreen,
    Stage,
    luidolt,
    robust,
)
from entoptic.tracker_bridge.samples import NS_PER_S, Eye, PupilSample

FRAME_NS = 16_000_000


def finished(protocol: Protocol) -> tuple[Calibration, list[ShowScreen]]:
    """A run before a display that shows every screen a frame late."""
    calibration, t_ns = Calibration(protocol), 0
    commands = list(calibration.start(t_ns))
    while not calibration.stage.is_final:
        if calibration.stage is Stage.WAITING:
            calibration.shown(commands[-1].id, t_ns + FRAME_NS, t_ns + 2 * FRAME_NS)
        t_ns += 50_000_000
        commands += calibration.advance(t_ns)
    return calibration, commands


def test_robust_shows_white_black_white_and_grey() -> None:
    calibration, commands = finished(robust())
    assert calibration.stage is Stage.FINISHED
    assert [command.screen for command in commands] == [Screen.WHITE, Screen.BLACK, Screen.WHITE, Screen.GREY]
    assert [command.seconds for command in commands] == [8.0, 18.0, 8.0, None]
    assert [command.id for command in commands] == [1, 2, 3, 4]
    assert calibration.protocol.seconds == 34.0


def test_luidolt_shows_black_and_white_for_five_seconds_each_and_measures_all_of_them() -> None:
    calibration, commands = finished(luidolt())
    assert [(command.screen, command.seconds) for command in commands[:-1]] == [
        (Screen.BLACK, 5.0),
        (Screen.WHITE, 5.0),
    ]
    for screen in calibration.shown_screens:
        assert screen.window_ns == (screen.t_ns, screen.t_ns + 5 * NS_PER_S)


def test_a_screen_lasts_from_when_it_was_really_shown() -> None:
    calibration = Calibration(robust())
    (white,) = calibration.start(0)
    calibration.shown(white.id, 700_000_000, 710_000_000)
    assert calibration.advance(8_699_999_999) == ()
    (black,) = calibration.advance(8_700_000_000)
    assert black.screen is Screen.BLACK
    assert calibration.shown_screens == [ShownScreen(Screen.WHITE, 700_000_000, 8.0, 4.0)]
    assert calibration.shown_screens[0].window_ns == (4_700_000_000, 8_700_000_000)


def test_an_impossible_time_of_a_display_becomes_the_nearest_possible_one() -> None:
    for said_ns, taken_ns in ((-5 * NS_PER_S, NS_PER_S), (99 * NS_PER_S, NS_PER_S + FRAME_NS)):
        calibration = Calibration(luidolt())
        (command,) = calibration.start(NS_PER_S)
        calibration.shown(command.id, said_ns, NS_PER_S + FRAME_NS)
        calibration.advance(7 * NS_PER_S)
        assert calibration.shown_screens[0].t_ns == taken_ns


def test_a_screen_that_nobody_shows_ends_the_run() -> None:
    calibration = Calibration(robust())
    calibration.start(0)
    assert calibration.advance(SHOWN_WITHIN_NS) == ()
    (grey,) = calibration.advance(SHOWN_WITHIN_NS + 1)
    assert calibration.stage is Stage.NOT_SHOWN
    assert grey.screen is Screen.GREY


def test_an_answer_to_an_older_screen_means_nothing() -> None:
    calibration = Calibration(robust())
    (white,) = calibration.start(0)
    calibration.shown(white.id + 1, 0, 0)
    assert calibration.stage is Stage.WAITING


def test_a_pause_restarts_its_step_alone() -> None:
    calibration = Calibration(robust())
    (white,) = calibration.start(0)
    calibration.shown(white.id, 0, 0)
    (black,) = calibration.advance(8 * NS_PER_S)
    calibration.shown(black.id, 8 * NS_PER_S, 8 * NS_PER_S)
    (grey,) = calibration.pause()
    assert (grey.screen, grey.stage, calibration.stage) == (Screen.GREY, Stage.PAUSED, Stage.PAUSED)
    assert calibration.advance(500 * NS_PER_S) == ()
    (again,) = calibration.resume(500 * NS_PER_S)
    assert again.screen is Screen.BLACK
    assert again.id > grey.id
    calibration.shown(black.id, 501 * NS_PER_S, 501 * NS_PER_S)
    assert calibration.stage is Stage.WAITING
    calibration.shown(again.id, 501 * NS_PER_S, 501 * NS_PER_S)
    calibration.advance(519 * NS_PER_S)
    assert [screen.t_ns for screen in calibration.shown_screens] == [0, 501 * NS_PER_S]


def test_of_a_long_pause_the_newest_samples_alone_are_kept() -> None:
    calibration = Calibration(robust())
    (white,) = calibration.start(0)
    calibration.shown(white.id, 0, 0)
    calibration.sample(PupilSample(0, Eye.LEFT, 4.0, 1.0))
    calibration.pause()
    for k in range(1, 3 * PAUSED_SAMPLES):
        calibration.sample(PupilSample(k, Eye.LEFT, 4.0, 1.0))
    calibration.resume(3 * PAUSED_SAMPLES)
    kept = [sample.t_ns for sample in calibration.samples]
    assert kept == [0, *range(2 * PAUSED_SAMPLES, 3 * PAUSED_SAMPLES)]


def test_an_abort_is_final() -> None:
    calibration = Calibration(robust())
    calibration.start(0)
    (grey,) = calibration.abort()
    assert (calibration.stage, grey.screen) == (Stage.ABORTED, Screen.GREY)
    assert calibration.start(1) == calibration.resume(1) == calibration.pause() == calibration.abort() == ()


def test_it_waits_for_samples_that_are_still_on_their_way() -> None:
    calibration = Calibration(luidolt())
    for start_ns in (0, 5 * NS_PER_S):
        (command,) = calibration.start(0) if start_ns == 0 else calibration.advance(start_ns)
        calibration.shown(command.id, start_ns, start_ns)
    calibration.advance(10 * NS_PER_S)
    calibration.sample(PupilSample(10 * NS_PER_S - 1, Eye.LEFT, 4.0, 1.0))
    assert len(calibration.samples) == 1
    assert calibration.advance(10 * NS_PER_S + LATE_SAMPLES_NS - 1) == ()
    assert calibration.stage is Stage.ENDING
    calibration.advance(10 * NS_PER_S + LATE_SAMPLES_NS)
    assert calibration.stage is Stage.FINISHED


@pytest.mark.parametrize("seconds", [0.0, 4.9, 121.0, float("nan")])
def test_screens_too_short_or_too_long_are_refused(seconds: float) -> None:
    with pytest.raises(CalibrationError, match="choose from 5 to 120 s"):
        robust(white_s=seconds)


@given(
    st.lists(
        st.tuples(
            st.sampled_from(("start", "advance", "pause", "resume", "abort", "shown", "wrong", "sample")),
            st.integers(0, 20 * NS_PER_S),
        ),
        max_size=80,
    )
)
def test_whatever_comes_the_screens_shown_are_the_protocols_in_order(calls: list[tuple[str, int]]) -> None:
    calibration, t_ns, last_id = Calibration(robust()), 0, 0
    for call, later_ns in calls:
        t_ns += later_ns
        commands: tuple[ShowScreen, ...] = ()
        if call in ("start", "advance", "resume"):
            commands = getattr(calibration, call)(t_ns)
        elif call in ("pause", "abort"):
            commands = getattr(calibration, call)()
        elif call == "sample":
            calibration.sample(PupilSample(t_ns, Eye.RIGHT, 4.0, 1.0))
        else:
            calibration.shown(last_id if call == "shown" else last_id - 1, t_ns, t_ns)
        for command in commands:
            assert command.id > last_id
            last_id = command.id
    screens = calibration.shown_screens
    assert [one.screen for one in screens] == [step.screen for step in robust().steps][: len(screens)]
    assert all(before.window_ns[1] <= after.t_ns for before, after in itertools.pairwise(screens))
    if calibration.stage is Stage.FINISHED:
        assert len(screens) == 3
