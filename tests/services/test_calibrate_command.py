"""`entoptic calibrate` as a process: what it prints, leaves and returns."""

import io
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import typer
from rich.console import Console
from typer.testing import CliRunner

from entoptic.services.calibration import display as displays
from entoptic.services.calibration.display import NoDisplay
from entoptic.services.calibration.outcome import Outcome
from entoptic.services.calibration.pupil_calibration import BEGIN_WORDS, PupilCalibration
from entoptic.services.calibration.run import Room
from entoptic.services.commands import calibrate as commands
from entoptic.services.ipc.requests import CalibratePupils
from entoptic.services.process import Stop
from entoptic.tracker_bridge import pupil_map
from entoptic.tracker_bridge.calibration import CalibrationError
from entoptic.tracker_bridge.pupil_map import Use
from entoptic.tracker_bridge.source import SourceError, Tick


def run(folder: Path, *arguments: str) -> int:
    app = typer.Typer()
    app.command()(commands.calibrate)
    return CliRunner().invoke(app, ["--out", str(folder / "my_pupil.toml"), *arguments]).exit_code


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> Callable[[], str]:
    """What the command printed."""
    heard = Console(file=io.StringIO(), width=200)
    monkeypatch.setattr(commands, "console", heard)
    return heard.file.getvalue  # type: ignore[attr-defined]


@pytest.fixture(autouse=True)
def _signals_stay_the_tests_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signal, "signal", lambda number, handler: None)


def test_fast_leaves_a_map_and_a_plot_and_prints_each_eye(tmp_path: Path, said: Callable[[], str]) -> None:
    assert run(tmp_path, "--fast", "--protocol", "luidolt", "--map-mm", "--seed", "3") == 0
    text = said()
    assert {path.name for path in tmp_path.iterdir()} == {"my_pupil.toml", "my_pupil.png"}
    found = pupil_map.read(tmp_path / "my_pupil.toml")
    assert (found.protocol, found.use, found.source) == ("luidolt", Use.MAP, "Simulated eyes 3, live")
    for one, name in ((found.right, "right"), (found.left, "left")):
        assert one is not None
        assert name in text
        assert f"{one.white:.2f}" in text
        assert f"{one.black:.2f}" in text


def test_a_failure_is_named_with_its_remedy_and_leaves_nothing(tmp_path: Path, said: Callable[[], str]) -> None:
    assert run(tmp_path, "--fast", "--black-cd-m2", "150", "--keep-failed") == 1
    text = said()
    assert "no span, right eye" in text
    assert "turn its brightness up" in text
    assert {path.name for path in tmp_path.iterdir()} == {"my_pupil.failed.png"}


def test_keys_are_for_a_program_on_the_sockets(tmp_path: Path) -> None:
    app = typer.Typer()
    app.command()(commands.calibrate)
    refused = CliRunner().invoke(app, ["--out", str(tmp_path / "p.toml"), "--keys", str(tmp_path)]).exception
    assert isinstance(refused, CalibrationError)
    assert "--display socket" in str(refused)


def test_each_repetition_is_printed_and_one_is_kept(tmp_path: Path, said: Callable[[], str]) -> None:
    assert run(tmp_path, "--fast", "--protocol", "luidolt", "--repeats", "2", "--eyes", "left") == 0
    text = said()
    assert "run 1 of 2" in text
    assert "run 2 of 2" in text
    assert pupil_map.read(tmp_path / "my_pupil.toml").right is None


def test_a_source_that_ends_before_the_screens_do_is_named(tmp_path: Path) -> None:
    calibration = PupilCalibration(Room(NoDisplay()), "a recording")
    assert calibration.begin(CalibratePupils(str(tmp_path / "my_pupil.toml"))).done
    with pytest.raises(SourceError, match=r"a recording ended before .* 34 s"):
        commands._follow(calibration, iter([Tick(0)]), "a recording", 34.0, Stop())


def test_what_came_of_a_run_stays_in_sight_until_the_next_one_starts(
    tmp_path: Path, said: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[tuple[str, bool]] = []

    class Noted(NoDisplay):
        def tell(self, message: str, *, again: bool) -> None:
            told.append((message, again))
            super().tell(message, again=again)

    monkeypatch.setattr(displays, "NoDisplay", Noted)
    assert run(tmp_path, "--fast", "--protocol", "luidolt", "--repeats", "2") == 0
    assert told[1] == (BEGIN_WORDS, True)
    done = told[2][0]
    assert "Done, thank you" in done
    assert told[2:] == [(done, False), (done, True), (done, False)]


def test_a_folder_that_goes_between_two_runs_is_named(
    tmp_path: Path, said: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "results"
    folder.mkdir()

    def printed(outcome: Outcome, title: str | None) -> None:
        shutil.rmtree(folder)

    monkeypatch.setattr(commands, "_print_outcome", printed)
    app = typer.Typer()
    app.command()(commands.calibrate)
    arguments = ["--out", str(folder / "p.toml"), "--fast", "--protocol", "luidolt", "--repeats", "2"]
    refused = CliRunner().invoke(app, arguments).exception
    assert isinstance(refused, CalibrationError)
    assert "is no folder" in str(refused)


def test_ctrl_c_changes_nothing(tmp_path: Path) -> None:
    (tmp_path / "my_pupil.toml").write_text("old")
    command = "import typer; from entoptic.services.commands.calibrate import calibrate; typer.run(calibrate)"
    arguments = ["--display", "socket", "--out", str(tmp_path / "my_pupil.toml")]
    process = subprocess.Popen(
        [sys.executable, "-c", command, *arguments], stderr=subprocess.PIPE, text=True, encoding="utf-8"
    )
    assert process.stderr is not None
    # The last line before it waits for a display.
    while "answers are awaited" not in (line := process.stderr.readline()) and line:
        pass
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert "aborted" in said
    assert (tmp_path / "my_pupil.toml").read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 1
