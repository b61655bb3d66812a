"""A host and all its processes: asked, killed, filled up and ended."""

import json
import os
import re
import resource
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from live_hosts import SIZE, LiveHost, alive, frames_of, hears_frames, live_host, ports_are_free, until

from entoptic.services.config import EyesConfig, ViewConfig
from entoptic.services.ipc.requests import Record, StartSession, StopRecord, StopSession
from entoptic.services.session_config import SessionConfig

ENDS_WITHIN_S = 2.5
"""Two seconds are promised, of which a host uses 1.8; the rest is for the interpreter's own end while other tests keep
all cores busy. test_kill.py, which runs alone, allows two."""


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveHost]:
    with live_host(tmp_path_factory.mktemp("host"), "console", "--port", "0") as one:
        yield one


@pytest.mark.parametrize(
    ("config", "said"),
    [
        (SessionConfig(eyes=EyesConfig(source="nowhere/")), "nowhere/ does not exist"),
        (SessionConfig(view=ViewConfig(scene="nowhere.hdr")), 'scene "nowhere.hdr": no such file'),
        (SessionConfig(view=ViewConfig(fps=0.0)), "greater|>= 0.1.*config.view.fps"),
        (SessionConfig(eyes=EyesConfig(pupil_map="no.toml")), "no.toml"),
        (SessionConfig(view=ViewConfig(head="no.csv")), "no.csv"),
    ],
)
def test_what_cannot_be_started_is_said_in_one_line(host: LiveHost, config: SessionConfig, said: str) -> None:
    reply = host.ask(StartSession(config))
    assert not reply.done
    assert reply.reply.count("\n") == 0
    assert re.search(said, reply.reply)
    assert set(host.status()["processes"]) == {"web"}


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_session_goes_on_whatever_is_killed_and_its_take_is_whole(host: LiveHost) -> None:
    assert not host.ask(Record()).done
    running = host.start()
    assert not host.ask(StartSession(SessionConfig())).done
    assert host.ask(Record("first")).done
    assert not host.ask(Record("second")).done
    folder = Path(running["root"]) / "first.partial"
    worker_at = running["addresses"]["frames"]
    for name in ("bridge", "worker", "web"):
        until(lambda: (folder / "plan.csv").exists() and frames_of(folder) > 3, "frames are kept")
        pid = host.pids()[name]
        os.kill(pid, signal.SIGKILL)
        host.until(
            lambda now, name=name: now["processes"][name]["state"] == "running" and now["processes"][name]["restarts"],
            f"{name} is started again",
        )
        before = frames_of(folder)
        until(lambda before=before: frames_of(folder) > before + 2, f"frames are kept after {name}")
        assert hears_frames(worker_at)
    assert {path.name for path in folder.glob("eyes*")} == {"eyes", "eyes-2"}
    reply = host.ask(StopRecord())
    assert reply.done
    now = host.until(lambda now: now["last_recording"] and not now["finishing"], "the take is finished")
    finished = Path(now["last_recording"])
    assert finished == Path(running["root"]) / "first"
    assert not folder.exists()
    summary = json.loads((finished / "summary.json").read_text())
    assert [gap["process"] for gap in summary["gaps"]] == ["bridge", "worker"]
    assert all(0 < gap["from_s"] < gap["to_s"] and "signal 9" in gap["why"] for gap in summary["gaps"])
    assert frames_of(finished) == summary["worker"]["frames"] > 9
    for name in ("report.html", "session.json", "settings.toml", "log.jsonl", "bridge.json", "worker.json"):
        assert (finished / name).stat().st_size > 0, name
    logged = {json.loads(line)["process"] for line in (finished / "log.jsonl").read_text().splitlines()}
    assert logged == {"host", "bridge", "worker", "web"}


@pytest.mark.parametrize(("name", "most_bytes", "end"), [("brim", 2000, StopRecord()), ("tub", 20_000, StopSession())])
@pytest.mark.slow
def test_what_cannot_be_written_ends_the_take_and_not_the_session(
    host: LiveHost, name: str, most_bytes: int, end: StopRecord | StopSession
) -> None:
    """As a full disk: from the beginning, or in the middle of it; and the report says so, whoever ended it."""
    if host.status()["state"] != "running":
        host.start()
    pid = host.pids()["worker"]
    soft, hard = resource.prlimit(pid, resource.RLIMIT_FSIZE)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (most_bytes, hard))
    assert host.ask(Record(name)).done
    said = re.compile(f"{name}.partial.*File too large")
    now = host.until(lambda now: said.search(str(now["problems"])), "the problem is said")
    assert now["state"] == "running"
    assert host.pids()["worker"] == pid
    assert hears_frames(now["addresses"]["frames"])
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (soft, hard))
    assert host.ask(end).done
    now = host.until(
        lambda now: (now["last_recording"] or "").endswith(name) and not now["finishing"], "it is finished"
    )
    summary = json.loads((Path(now["last_recording"]) / "summary.json").read_text())
    assert "File too large" in summary["problems"][0]["what"]
    assert summary["interrupted"] is False
    assert "File too large" in (Path(now["last_recording"]) / "report.html").read_text()
    if isinstance(end, StopSession):
        host.until(lambda now: now["state"] == "idle", "the session is over")


@pytest.mark.slow
def test_status_says_how_it_is(host: LiveHost) -> None:
    if host.status()["state"] != "running":
        host.start()
    host.until(lambda now: now["worker"] and now["bridge"], "what its processes say is known")
    printed = host.command("status", "--json")
    (found,) = json.loads(printed.stdout)
    status = found["status"]
    assert status["config"]["eyes"]["source"] == "simulated"
    assert status["worker"]["fps"] == 20.0
    assert status["console_url"].startswith("http://127.0.0.1:")
    assert printed.returncode == (1 if found["problems"] else 0)
    words = host.command("status").stderr
    assert "simulated viewing night-street" in words
    addresses = status["addresses"]
    each = host.command("status", "--json", addresses["bridge"], addresses["worker"])
    assert [one["status"]["of"] for one in json.loads(each.stdout)] == ["bridge", "worker"]
    nobody = host.command("status", "tcp://127.0.0.1:1")
    assert nobody.returncode == 1
    assert "Nobody answers" in nobody.stderr


@pytest.mark.slow
def test_a_stopped_session_leaves_no_process_and_no_port(host: LiveHost) -> None:
    if host.status()["state"] != "running":
        host.start()
    now = host.status()
    pids = [pid for name, pid in host.pids().items() if name != "web"]
    assert host.ask(StopSession()).done
    host.until(lambda now: now["state"] == "idle", "it is stopped")
    assert not any(alive(pid) for pid in pids)
    assert ports_are_free(now["addresses"])
    assert not host.ask(StopSession()).done


@pytest.mark.slow
def test_sigterm_ends_all_within_two_seconds_with_whole_files(host: LiveHost) -> None:
    now = host.start()
    assert host.ask(Record("last")).done
    folder = Path(now["root"]) / "last.partial"
    until(lambda: (folder / "plan.csv").exists() and frames_of(folder) > 3, "frames are kept")
    pids = list(host.pids().values())
    assert host.end(signal.SIGTERM) < ENDS_WITHIN_S
    assert not any(alive(pid) for pid in pids)
    assert ports_are_free(now["addresses"])
    kept = [path for path in (folder, folder.with_name("last")) if path.exists()]
    assert len(kept) == 1
    assert frames_of(kept[0]) > 3
    assert host.command("status").returncode == 1
    assert list((host.folder / "state" / "entoptic" / "hosts").iterdir()) == []


@pytest.mark.slow
def test_a_killed_host_leaves_no_process_and_its_take_can_be_finished(tmp_path: Path) -> None:
    with live_host(tmp_path, "session", "--live", "--width", "90", "--height", "100", "--out", "take") as one:
        folder = tmp_path / "take.partial"
        until(lambda: (folder / "plan.csv").exists() and frames_of(folder) > 3, "frames are kept")
        refused = one.command("session", "--live", "--out", "take")
        assert refused.returncode == 1
        assert "take.partial is there already" in refused.stderr
        now, pids = one.status(), list(one.pids().values())
        refused = one.command("report", str(folder))
        assert refused.returncode == 1
        assert "is being recorded now" in refused.stdout + refused.stderr
        one.end(signal.SIGKILL)
        until(lambda: not any(alive(pid) for pid in pids), "all processes end with their host", 15.0)
        # Its last thread may close them a moment after the process has none to run any more.
        until(lambda: ports_are_free(now["addresses"]), "all ports are free", 15.0)
        assert frames_of(folder) > 3
        done = one.command("report", str(folder))
        assert done.returncode == 0, done.stderr
        assert not folder.exists()
        summary = json.loads((tmp_path / "take" / "summary.json").read_text())
        assert "left no summary" in summary["problems"][0]["what"]
        assert summary["interrupted"] is True
        assert (tmp_path / "take" / "report.html").exists()
        nobody = one.command("status")
        assert (nobody.returncode, list((tmp_path / "state" / "entoptic" / "hosts").iterdir())) == (1, [])


@pytest.mark.slow
def test_a_host_ends_at_once_while_a_session_is_being_opened(tmp_path: Path) -> None:
    """One that takes for ever: nobody writes into the pipe."""
    os.mkfifo(tmp_path / "map.toml")
    with live_host(tmp_path, "console", "--port", "0") as one:
        reply = one.ask(StartSession(SessionConfig(eyes=EyesConfig(pupil_map=str(tmp_path / "map.toml")))))
        assert reply.done, reply
        assert one.status()["state"] == "starting"
        assert one.end(signal.SIGTERM) < ENDS_WITHIN_S


@pytest.mark.slow
def test_a_live_session_without_an_end_is_not_interrupted(tmp_path: Path) -> None:
    with live_host(tmp_path, "session", "--live", *SIZE, "--out", "take") as one:
        folder = tmp_path / "take.partial"
        until(lambda: (folder / "plan.csv").exists() and frames_of(folder) > 3, "frames are kept")
        assert json.loads((folder / "host.json").read_text())["interrupted"] is True  # if it were killed now
        one.end(signal.SIGINT)
        assert one.process.returncode == 130
        done = one.command("report", str(folder if folder.exists() else tmp_path / "take"))
        assert done.returncode == 0, done.stderr
        summary = json.loads((tmp_path / "take" / "summary.json").read_text())
        assert (summary["interrupted"], summary["problems"], summary["gaps"]) == (False, [], [])
