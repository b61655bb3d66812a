"""`entoptic psf`: once as a process, then as its shell would see it."""

import subprocess
import sys
from pathlib import Path

import pytest

from entoptic.services import cli
from entoptic.services.settings import load

SMALL = ("psf", "--size-px", "101", "--wavelengths", "6")


class Done:
    """How a command ended and what it said."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._monkeypatch, self._capsys = monkeypatch, capsys
        self.returncode: object = 0
        self.stderr = ""

    def run(self, *arguments: str) -> None:
        self._monkeypatch.setattr(sys, "argv", ["entoptic", *arguments])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        self.returncode = ended.value.code
        self.stderr = self._capsys.readouterr().err


@pytest.fixture
def entoptic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Done:
    monkeypatch.chdir(tmp_path)
    return Done(monkeypatch, capsys)


@pytest.mark.slow
def test_an_eye_is_shown_saved_and_taken_up_again(tmp_path: Path, entoptic: Done) -> None:
    tuned = (
        "--pupil-diameter-mm=6",
        "--set=age_years=61",
        "--set=iris=blue",
        "--set=particles=2000",
        "--set=observer.seed=5",
    )
    done = subprocess.run(
        [sys.executable, "-m", "entoptic", *SMALL, *tuned, "--out", "one", "--save-observer", "my_eye.toml"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"one", "my_eye.toml"}
    written = {".entoptic", "encircled.csv", "mtf.csv", "profile.csv", "profiles.png", "psf.png", "pupil_plane.png"}
    assert {path.name for path in (tmp_path / "one").iterdir()} == written
    assert "wave/CIE 135" in done.stderr
    observer = load(tmp_path / "my_eye.toml").observer
    assert (observer.age_years, observer.iris, observer.particles, observer.seed) == (61, "blue", 2000, 5)

    entoptic.run(*SMALL, "--pupil-diameter-mm", "6", "--settings", "my_eye.toml", "--out", "two")
    assert entoptic.returncode == 0, entoptic.stderr
    for name in sorted(written):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes(), name


@pytest.mark.parametrize(
    ("arguments", "status", "named"),
    [
        (("--spectrum", "nowhere.csv"), 1, "nowhere.csv"),
        (("--spectrum", "moonshine"), 1, "moonshine"),
        (("--set", "iris=pink"), 1, "pink"),
        (("--set", "glare.model=bloom"), 1, "bloom"),
        (("--settings", "nowhere.toml"), 1, "nowhere.toml"),
        (("--save-observer", "no/my_eye.toml"), 1, "no/my_eye.toml"),
        (("--set", "particles=400", "--set", "particle_mm=0.5"), 1, "block"),
        (("--pupil-diameter-mm", "9"), 2, "--pupil-diameter-mm"),
    ],
)
def test_what_is_wrong_is_named(
    tmp_path: Path, entoptic: Done, arguments: tuple[str, ...], status: int, named: str
) -> None:
    entoptic.run(*SMALL, *arguments)
    assert entoptic.returncode == status, entoptic.stderr
    assert named in entoptic.stderr.replace("\n", "")
    assert "Traceback" not in entoptic.stderr
    assert not list(tmp_path.iterdir())
