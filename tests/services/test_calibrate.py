"""The routine run on simulated eyes, before displays that behave and displays that do not."""

import itertools
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
from screen_program import ScreenProgram

from entoptic.errors import OutputError
from entoptic.services.calibration import result as results
from entoptic.services.calibration.display import Answer, NoDisplay, Request, SocketDisplay
from entoptic.services.calibration.result import Attempt, judge
from entoptic.services.calibration.run import GREY_SHARE, CalibrationRun, Recorded, Room
from entoptic.tracker_bridge import pupil_map
from entoptic.tracker_bridge.calibration import Protocol, Screen, ShowScreen, Stage, Statistic, Step, luidolt, robust
from entoptic.tracker_bridge.calibration_quality import Failure
from entoptic.tracker_bridge.chain import Chain
from entoptic.tracker_bridge.publisher import PortInUseError
from entoptic.tracker_bridge.pupil_map import PupilMapError, Use
from entoptic.tracker_bridge.samples import NS_PER_S, Eye, EyeState, PupilSample
from entoptic.tracker_bridge.source import Item, SourceInfo
from entoptic.tracker_bridge.sources.played import Played
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings
from entoptic.tracker_bridge.sources.simulated.live import LiveEyes
from entoptic.tracker_bridge.sources.simulated.pupil import watson_yellott_mm

WHITE_CD_M2, BLACK_CD_M2 = 200.0, 0.05
TRUE_MM = {
    screen: watson_yellott_mm(luminance, 900.0, 30.0)
    for screen, luminance in ((Screen.WHITE, WHITE_CD_M2), (Screen.BLACK, BLACK_CD_M2))
}
QUICK = Protocol("quick", (Step(Screen.WHITE, 0.4, 0.2), Step(Screen.BLACK, 0.4, 0.2)), Statistic.MEDIAN, False)


def eyes_of(seed: int = 1, *, paced: bool = False, **changes: float) -> LiveEyes:
    light = ((0.0, GREY_SHARE * WHITE_CD_M2),)
    settings = SimulatedSettings(seconds=50.0, seed=seed, luminance=light, rate_hz=60.0)
    return LiveEyes(msgspec.structs.replace(settings, **changes), time.monotonic_ns() if paced else None)


def follow(run: CalibrationRun, items: Iterator[Item], *, live: bool = False) -> Recorded:
    for item in items:
        run.step(item, time.monotonic_ns() if live else item.t_ns)
        if run.is_over:
            break
    return run.recorded()


def attempt(
    eyes: LiveEyes,
    protocol: Protocol | None = None,
    display: NoDisplay | None = None,
    lights: tuple[float, float] = (WHITE_CD_M2, BLACK_CD_M2),
) -> Attempt:
    run = CalibrationRun(protocol or robust(), Room(display or NoDisplay(), eyes, *lights))
    return judge(follow(run, eyes.samples()))


def failures(one: Attempt) -> set[Failure]:
    return {problem.failure for problem in one.problems}


@pytest.fixture(scope="module")
def valid() -> Attempt:
    return attempt(eyes_of())


def bias_mm(seeds: range, hippus: float) -> dict[Screen, float]:
    runs = [attempt(eyes_of(seed, hippus=hippus, seconds=35.0)) for seed in seeds]
    assert [run.problems for run in runs] == [()] * len(runs)
    return {
        screen: float(np.median([run.analysis.eyes[eye].of(screen) - true for run in runs for eye in Eye]))
        for screen, true in TRUE_MM.items()
    }


@pytest.mark.parametrize(
    ("hippus", "people"),
    [(0.1, 4), pytest.param(0.1, 20, marks=pytest.mark.slow), pytest.param(0.0, 10, marks=pytest.mark.slow)],
)
def test_robust_is_within_five_hundredths_of_a_millimetre(hippus: float, people: int) -> None:
    """Of the steady diameters, with blinks and noise: median over some people."""
    off_mm = bias_mm(range(1, people + 1), hippus)
    assert abs(off_mm[Screen.WHITE]) <= 0.05
    assert abs(off_mm[Screen.BLACK]) <= 0.05


def test_luidolts_means_are_off_by_what_the_pupil_is_still_on_its_way() -> None:
    result = attempt(eyes_of(), luidolt()).analysis
    assert result.problems == ()
    assert 0.3 < result.eyes[Eye.LEFT].of(Screen.WHITE) - TRUE_MM[Screen.WHITE] < 0.8
    assert -1.6 < result.eyes[Eye.LEFT].of(Screen.BLACK) - TRUE_MM[Screen.BLACK] < -1.0


def test_a_display_that_never_turns_dark_leaves_no_span() -> None:
    assert failures(attempt(eyes_of(), lights=(WHITE_CD_M2, 0.8 * WHITE_CD_M2))) == {Failure.NO_SPAN}


def test_a_display_with_its_colours_swapped_is_inverted() -> None:
    assert failures(attempt(eyes_of(), lights=(BLACK_CD_M2, WHITE_CD_M2))) == {Failure.INVERTED}


def test_a_very_restless_pupil_is_drifting() -> None:
    assert failures(attempt(eyes_of(hippus=0.3))) == {Failure.DRIFTING}


def test_eyes_that_blink_all_the_time_give_too_few_samples() -> None:
    class Lids(LiveEyes):
        """Every second half of a second shut."""

        def samples(self) -> Iterator[Item]:
            for item in super().samples():
                shut = isinstance(item, PupilSample) and item.t_ns % NS_PER_S < NS_PER_S // 2
                yield msgspec.structs.replace(item, confidence=0.0, pupil_diameter_mm=-0.07) if shut else item

    eyes = Lids(eyes_of().settings)
    assert failures(attempt(eyes)) == {Failure.TOO_FEW_SAMPLES}


def test_one_eye_that_does_not_see_the_screens_disagrees() -> None:
    class HalfBlind(LiveEyes):
        """The tracker takes the left pupil for half as wide as it grows."""

        def samples(self) -> Iterator[Item]:
            for item in super().samples():
                if isinstance(item, PupilSample) and item.eye is Eye.LEFT and item.pupil_diameter_mm is not None:
                    yield msgspec.structs.replace(item, pupil_diameter_mm=3.0 + (item.pupil_diameter_mm - 3.0) / 2)
                else:
                    yield item

    assert failures(attempt(HalfBlind(eyes_of().settings))) == {Failure.EYES_DISAGREE}


class Scripted(NoDisplay):
    """Does something at times, in seconds; may say nothing of some screens."""

    def __init__(self, does: dict[float, Request], silent_on: Screen | None = None) -> None:
        super().__init__()
        self.shown: list[ShowScreen] = []
        self._does, self._silent_on = dict(does), silent_on

    def show(self, command: ShowScreen) -> None:
        self.shown.append(command)
        if command.screen is not self._silent_on:
            super().show(command)

    def answers(self, now_ns: int) -> list[Answer]:
        due = [t_s for t_s in self._does if now_ns >= t_s * NS_PER_S]
        return [*super().answers(now_ns), *(self._does.pop(t_s) for t_s in due)]


def test_a_display_that_falls_silent_showed_no_stimulus() -> None:
    one = attempt(eyes_of(), display=Scripted({}, silent_on=Screen.BLACK))
    assert failures(one) == {Failure.NOT_SHOWN}
    assert "screen 2 of 3" in one.problems[0].detail


def test_a_pause_shows_grey_and_restarts_its_screen() -> None:
    display = Scripted({12.0: Request.PAUSE, 20.0: Request.START})
    one = attempt(eyes_of(), display=display)
    assert one.problems == ()
    assert [command.screen.value for command in display.shown] == ["white", "black", "grey", "black", "white", "grey"]
    assert one.screens[1].t_ns >= 20 * NS_PER_S


def test_an_abort_ends_the_run() -> None:
    one = attempt(eyes_of(), display=Scripted({12.0: Request.ABORT}))
    assert (failures(one), one.recorded.stage, len(one.screens)) == ({Failure.ABORTED}, Stage.ABORTED, 1)


def test_each_repetition_is_a_result_of_its_own() -> None:
    eyes = eyes_of(seconds=90.0)
    display = NoDisplay()
    room, items, ids = Room(display, eyes, WHITE_CD_M2, BLACK_CD_M2), eyes.samples(), itertools.count(7)
    first = judge(follow(CalibrationRun(robust(), room, ids=ids), items))
    display.tell("again", again=True)
    second = judge(follow(CalibrationRun(robust(), room, ids=ids), items))
    assert next(ids) == 7 + 2 * 4  # no screen has the number of another
    assert first.problems == second.problems == ()
    assert second.screens[0].t_ns > first.screens[-1].window_ns[1]


def test_a_recording_is_played_at_its_pace_on_this_machines_clock() -> None:
    class Recorded:
        info = SourceInfo("A recording", 5_000_000_000_000, 5_002_000_000_000)

        def samples(self) -> Iterator[Item]:
            for sample in SimulatedEyes(SimulatedSettings(seconds=2.0, rate_hz=60.0)).samples():
                yield msgspec.structs.replace(sample, t_ns=sample.t_ns + self.info.t_start_ns)

    began_ns = time.monotonic_ns()
    recorded = Recorded()
    one = judge(follow(CalibrationRun(QUICK, Room(NoDisplay())), Played(recorded, began_ns).samples(), live=True))
    assert time.monotonic_ns() - began_ns >= 0.8 * NS_PER_S
    assert failures(one) == {Failure.NO_SPAN}
    assert began_ns < one.screens[0].t_ns < time.monotonic_ns()


def result_of(one: Attempt, **changes: bool) -> pupil_map.PupilMap:
    options = {"map_mm": False} | changes
    return results.pupil_map_of(one, "Simulated eyes 1", "none", None, **options)


def test_the_result_is_a_file_and_a_plot(tmp_path: Path, valid: Attempt) -> None:
    one, found = valid, result_of(valid)
    out = tmp_path / "my_pupil.toml"
    plot = results.write(out, found, one)
    assert {path.name for path in tmp_path.iterdir()} == {"my_pupil.toml", "my_pupil.png"}
    assert plot.read_bytes()[:4] == b"\x89PNG"
    assert plot.stat().st_size < 100_000
    back = pupil_map.read(out)
    assert (back.source, back.protocol, back.unit, back.use) == ("Simulated eyes 1", "robust", "mm", Use.CHECK)
    assert back.left is not None
    assert back.left.stretch == pytest.approx(6.0 / (back.left.black - back.left.white), abs=1e-3)
    assert [window.screen for window in back.left.windows] == ["white", "black", "white"]
    assert result_of(one, map_mm=True).use is Use.MAP


class InPixels(LiveEyes):
    """A tracker without millimetres."""

    def samples(self) -> Iterator[Item]:
        for item in super().samples():
            yield msgspec.structs.replace(item, pupil_diameter_mm=None) if isinstance(item, PupilSample) else item


def test_pixels_become_two_to_eight_millimetres_in_the_bridge() -> None:
    one = attempt(InPixels(eyes_of().settings))
    assert one.problems == ()
    found = result_of(one)
    assert (found.unit, found.use) == ("px", Use.MAP)
    for luminance, mapped_mm in ((WHITE_CD_M2, 2.0), (BLACK_CD_M2, 8.0)):
        steady = eyes_of(seed=2, seconds=4.0, hippus=0.0).settings
        steady = msgspec.structs.replace(steady, luminance=((0.0, luminance),))
        chain = Chain(pupil_map=found)
        shown = [
            state.left.pupil_diameter_mm
            for item in InPixels(steady).samples()
            for state in chain.step(item)
            if isinstance(state, EyeState)
        ]
        assert shown[-1] == pytest.approx(mapped_mm, abs=0.25)


def test_a_result_that_cannot_be_written_leaves_the_old_one(tmp_path: Path, valid: Attempt) -> None:
    out = tmp_path / "my_pupil.toml"
    out.write_text("old")
    (tmp_path / "my_pupil.png").mkdir()
    with pytest.raises(OutputError, match=r"my_pupil\.png cannot be written"):
        results.write(out, result_of(valid), valid)
    assert out.read_text() == "old"
    assert {path.name for path in tmp_path.iterdir()} == {"my_pupil.toml", "my_pupil.png"}


@pytest.mark.parametrize("name", ["my_pupil.txt", "nowhere/my_pupil.toml", "folder.toml"])
def test_a_place_where_nothing_can_be_written_is_refused_before_anything_is_shown(tmp_path: Path, name: str) -> None:
    (tmp_path / "folder.toml").mkdir()
    with pytest.raises(PupilMapError, match="--out"):
        results.refuse_unwritable(tmp_path / name)


def test_a_program_on_the_sockets_says_on_its_own_clock_when_it_showed_what() -> None:
    display = SocketDisplay("tcp://127.0.0.1:*", "tcp://127.0.0.1:*")
    try:
        with ScreenProgram(display.commands_address, display.answers_address) as program:
            program.say({"shown": "the wrong type"})
            program.say(b"\xc1 no msgpack")
            program.say({"request": "start"})
            eyes = eyes_of(paced=True)
            one = judge(follow(CalibrationRun(QUICK, Room(display, eyes)), eyes.samples(), live=True))
            assert one.recorded.stage is Stage.FINISHED
            assert display.uncertainty_ns is not None
            for number, screen in enumerate(one.screens, 1):
                assert abs(screen.t_ns - program.shown_ns[number]) <= display.uncertainty_ns + 1_000_000
            display.tell("done", again=False)
            give_up = time.monotonic() + 60
            while {"message": "done", "again": False} not in program.said:
                assert time.monotonic() < give_up
                time.sleep(0.01)
            assert display.unreadable is not None
    finally:
        display.close()


def test_sockets_that_are_taken_are_named() -> None:
    display = SocketDisplay("tcp://127.0.0.1:*", "tcp://127.0.0.1:*")
    try:
        with pytest.raises(PortInUseError, match="choose another port"):
            SocketDisplay(display.commands_address, "tcp://127.0.0.1:*")
    finally:
        display.close()
