"""What a person gets for a mistake: one line that names the thing, a status that is not 0, nothing left behind."""

import sys
from pathlib import Path

import pytest
import zmq

from entoptic.services import cli


class Done:
    """How a command ended and what it said, as its shell would see it."""

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
def entoptic(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Done:
    monkeypatch.chdir(folder)
    return Done(monkeypatch, capsys)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "empty_folder").mkdir()
    (tmp_path / "empty_recording").mkdir()
    (tmp_path / "empty_recording" / "pupil.pldata").write_bytes(b"")
    (tmp_path / "text.hdr").write_text("no picture")
    (tmp_path / "text.tsv").write_text("a\tb\n1\t2\n")
    (tmp_path / "bad.toml").write_text("[observer]\nheight = 3\n")
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--recording", "nowhere"), "nowhere"),
        (("--recording", "capture"), "add --live"),
        (("--recording", "empty_folder"), "empty_folder"),
        (("--recording", "empty_recording"), "pupil.pldata"),
        (("--recording", "text.tsv"), "text.tsv"),
        (("--scene", "nowhere.exr"), "nowhere.exr"),
        (("--scene", "empty_folder"), "empty_folder"),
        (("--scene", "text.hdr"), "text.hdr"),
        (("--scene", "text.tsv"), "text.tsv"),
        (("--head", "nowhere.csv"), "nowhere.csv"),
        (("--settings", "bad.toml"), "height"),
        (("--out", "empty_recording"), "empty_recording"),
    ],
)
def test_a_session_names_what_is_wrong(folder: Path, entoptic: Done, arguments: tuple[str, ...], named: str) -> None:
    before = sorted(folder.rglob("*"))
    entoptic.run("session", *arguments)
    assert entoptic.returncode == 1
    errors = [line for line in entoptic.stderr.splitlines() if line.startswith("error:")]
    assert len(errors) == 1
    assert named in errors[0]
    assert "Traceback" not in entoptic.stderr
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("session", "--fov", "0"), "--fov"),
        (("session", "--fps", "-1"), "--fps"),
        (("session", "--width", "0"), "--width"),
        (("session", "--colour"), "--colour"),
        (("session", "--eyes", "third"), "--eyes"),
        (("session", "--seconds", "0"), "--seconds"),
        (("bridge", "--seed", "-1"), "--seed"),
        (("console", "--port", "70000"), "--port"),
        (("render", "x.hdr", "--pupil-diameter-mm", "40"), "--pupil-diameter-mm"),
    ],
)
def test_an_option_out_of_range_is_named(entoptic: Done, arguments: tuple[str, ...], named: str) -> None:
    entoptic.run(*arguments)
    assert entoptic.returncode == 2
    assert named in entoptic.stderr
    assert "Traceback" not in entoptic.stderr


def test_a_port_in_use_is_named(entoptic: Done) -> None:
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    socket = context.socket(zmq.REP)
    port = socket.bind_to_random_port("tcp://127.0.0.1")
    try:
        entoptic.run("bridge", "--states", f"tcp://127.0.0.1:{port}", "--seconds", "1")
    finally:
        context.destroy(linger=0)
    assert entoptic.returncode == 1
    assert f"error: cannot listen on tcp://127.0.0.1:{port}" in entoptic.stderr
