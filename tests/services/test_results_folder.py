from pathlib import Path

import pytest

from entoptic.services.results.folder import ResultsFolderError, keep, refuse_foreign, results_folder


def files(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()}


def test_results_appear_when_all_is_well(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    with results_folder(out) as folder:
        (folder / "mark").write_text("whole")
        assert not out.exists()
    assert files(out) == {"mark": "whole", ".entoptic": "mark"}


def test_of_what_fails_half_way_nothing_stays_and_earlier_results_do(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with results_folder(out) as folder:
        (folder / "mark").write_text("first")

    def fails_half_way() -> None:
        with results_folder(out) as folder:
            (folder / "mark").write_text("half")
            raise ValueError("half-way")

    with pytest.raises(ValueError, match="half-way"):
        fails_half_way()
    assert files(out) == {"mark": "first", ".entoptic": "mark"}
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_earlier_results_are_replaced_whole(tmp_path: Path) -> None:
    for name in ("old", "new"):
        with results_folder(tmp_path / "out") as folder:
            (folder / "mark").write_text(name)
            (folder / name).write_text(name)
    assert files(tmp_path / "out") == {"mark": "new", "new": "new", ".entoptic": "mark\nnew"}


def test_what_is_somebodys_own_is_left_and_named(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "one.jpg").write_text("mine")
    for out in (tmp_path / "photos", tmp_path / "photos" / "one.jpg", tmp_path / "photos" / "one.jpg" / "out"):
        with (
            pytest.raises(ResultsFolderError, match=r"(holds something|cannot make).*choose another --out"),
            results_folder(out),
        ):
            pass
    assert files(tmp_path / "photos") == {"one.jpg": "mine"}


def test_a_note_beside_earlier_results_is_somebodys_own(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with results_folder(out) as folder:
        (folder / "psf.png").write_text("first")
    (out / "notes.txt").write_text("mine")
    with pytest.raises(ResultsFolderError, match="holds something"), results_folder(out):
        pass
    assert (out / "notes.txt").read_text() == "mine"


def test_the_folder_one_stands_in_and_the_root_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for out in (Path("."), Path("/")):
        with pytest.raises(ResultsFolderError, match="choose another --out"), results_folder(out):
            pass


def test_a_recording_that_is_not_finished_is_never_touched(tmp_path: Path) -> None:
    unfinished = tmp_path / "take.partial"
    unfinished.mkdir()
    (unfinished / "render_log.msgpack").write_text("an hour of it")
    with results_folder(tmp_path / "take") as folder:
        (folder / "mark").write_text("offline")
    assert files(unfinished) == {"render_log.msgpack": "an hour of it"}
    assert files(tmp_path / "take") == {"mark": "offline", ".entoptic": "mark"}


def test_what_a_killed_process_left_is_replaced_and_nothing_else(tmp_path: Path) -> None:
    left = tmp_path / "out.new"
    left.mkdir()
    (left / "notes.txt").write_text("mine")
    with pytest.raises(ResultsFolderError, match=r"out\.new is in the way"), results_folder(tmp_path / "out"):
        pass
    assert files(left) == {"notes.txt": "mine"}
    (left / ".entoptic").touch()
    with results_folder(tmp_path / "out") as folder:
        assert files(folder) == {".entoptic": ""}
    assert not left.exists()


def test_a_report_that_is_drawn_later_is_ours(tmp_path: Path) -> None:
    (tmp_path / "take.partial").mkdir()
    keep(tmp_path / "take.partial", tmp_path / "take", "report.html")
    (tmp_path / "take" / "report.html").write_text("drawn later")
    refuse_foreign(tmp_path / "take")
