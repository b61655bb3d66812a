import json
from pathlib import Path

import pytest

from entoptic.services.live import journal as journals
from entoptic.services.live.journal import Journal


def lines(path: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_all_stands_in_the_hosts_file_and_in_the_recordings_while_it_runs(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "log")
    journal.add({"event": "before", "process": "bridge", "pid": 7})
    journal.begin_recording(tmp_path)
    journal.add({"event": "during", "process": "worker", "pid": 8})
    journal.add({"event": "progress", "frame": 3})
    journal.end_recording()
    journal.say("after", folder="there")
    journal.close()
    assert [one["event"] for one in lines(journal.path)] == ["before", "during", "after"]
    assert lines(tmp_path / "log.jsonl") == [{"event": "during", "process": "worker", "pid": 8}]
    assert journal.problem is None


def test_the_hosts_file_stays_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journals, "MOST_BYTES", 1000)
    journal = Journal(tmp_path)
    for k in range(100):
        journal.say("word", number=k)
    journal.close()
    kept = sorted(tmp_path.glob("*.jsonl*"))
    assert len(kept) == 2
    assert all(path.stat().st_size < 1300 for path in kept)
    assert lines(journal.path)[-1]["number"] == 99


def test_old_files_go(tmp_path: Path) -> None:
    for k in range(30):
        (tmp_path / f"host-{k}.jsonl").write_text("")
    Journal(tmp_path).close()
    assert len(list(tmp_path.glob("host-*.jsonl"))) <= journals.KEPT_FILES + 1


def test_a_disk_that_takes_nothing_is_said_and_harms_nobody(tmp_path: Path) -> None:
    (tmp_path / "log").write_text("a file where the folder should be")
    journal = Journal(tmp_path / "log")
    journal.say("word")
    assert journal.problem is not None
    assert "cannot be written" in journal.problem.what
    journal.begin_recording(tmp_path / "nowhere")
    journal.say("word")
    journal.close()
