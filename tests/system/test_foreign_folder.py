"""Commands that are started where a user keeps files of our packages' names: none of theirs is run."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import typer

from entoptic.services.cli import app

FOLDERS = ("services", "pipeline", "tracker_bridge", "entoptic")
FILES = ("pipeline.py", "services.py", "numpy.py", "jax.py", "typer.py")
SCRIPT = str(Path(sys.executable).with_name("entoptic"))
SMALL = ("--width", "90", "--height", "100")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Holds modules that leave word of themselves when they are imported."""
    folder = tmp_path_factory.mktemp("of a user")
    trap = f"open({str(folder / 'imported')!r}, 'a').write(__file__ + '\\n')\nraise RuntimeError('run by accident')\n"
    for name in FOLDERS:
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text(trap, encoding="utf-8")
    for name in FILES:
        (folder / name).write_text(trap, encoding="utf-8")
    return folder


def run(folder: Path, *command: str) -> str:
    """What it prints; it has to succeed, and to have imported nothing of the user's."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, encoding="utf-8", timeout=200
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    assert not (folder / "imported").exists(), (folder / "imported").read_text(encoding="utf-8")
    return done.stdout


def test_the_trap_works(folder: Path) -> None:
    """Python by itself looks into the working directory first."""
    done = subprocess.run([sys.executable, "-m", "services"], cwd=folder, capture_output=True, text=True, check=False)
    assert "run by accident" in done.stderr
    (folder / "imported").unlink()


def test_every_commands_help(folder: Path) -> None:
    names = sorted(typer.main.get_group(app).commands)
    assert len(names) >= 10
    with ThreadPoolExecutor(2) as pool:
        for name, said in zip(names, pool.map(lambda name: run(folder, SCRIPT, name, "--help"), names), strict=True):
            assert f"entoptic {name}" in said


@pytest.mark.slow
def test_a_session_from_its_eyes_to_its_report(folder: Path) -> None:
    run(folder, SCRIPT, "simulate", "--seconds", "1", "--out", "eyes")
    run(folder, SCRIPT, "detect", "eyes", "--out", "events.csv")
    run(folder, SCRIPT, "session", "--recording", "eyes", "--fps", "4", "--seconds", "0.5", *SMALL, "--out", "seen")
    run(folder, SCRIPT, "report", "seen")
    assert (folder / "seen" / "report.html").exists()


def test_a_live_session_whose_processes_the_host_starts(folder: Path) -> None:
    run(folder, SCRIPT, "session", "--live", "--seconds", "1", "--fps", "4", *SMALL, "--out", "live")
    assert (folder / "live" / "report.html").exists()
