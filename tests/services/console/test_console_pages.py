"""What pages are told, and what they may ask, over real sockets."""

import io
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from console_session import PATIENCE_S, MadeUpSession, Served, Visitor, wait_for
from msgspec.structs import replace
from PIL import Image
from websockets.sync.client import connect

from entoptic.services.console.live import Places
from entoptic.services.ipc import requests as asked
from entoptic.services.ipc.messages import DISPLAYED, PERCEIVED
from entoptic.services.ipc.status import WorkerStatus, problem
from entoptic.services.process_config import PageConfig, PageLinks, ServerConfig
from entoptic.services.settings import Settings, changed, load
from entoptic.tracker_bridge.wire import Phase


def test_a_page_gets_all_it_needs_at_once(attached: Served) -> None:
    with attached.page() as page:
        page.read()
        kinds = [message["type"] for message in page.messages]
    assert kinds[:4] == ["hello", "fields", "settings", "status"]
    hello, fields, settings, _ = page.messages[:4]
    assert hello["version"] == 2
    assert not hello["hosted"]
    assert fields["fields"][0]["path"] == "observer.age_years"
    assert settings["settings"]["observer"]["age_years"] == 30.0


def test_traces_marks_and_figures_arrive(attached: Served) -> None:
    with attached.page() as page:
        traces = page.until("traces", lambda message: len(message["t_s"]) > 1)
        assert traces["left"]["measured_mm"][0] == 4.1
        assert traces["right"]["pupil_diameter_mm"][0] == 4.0
        assert traces["left"]["phase"][0] == "tracking"
        assert traces["gaze_deg"][0] == [3.0, -1.0]
        assert -1 < traces["now_s"] - traces["t_s"][-1] < 1
        marks = page.until("marks", lambda message: len(message["marks"]) >= 3)["marks"]
        blink = next(mark for mark in marks if mark["what"] == "blink")
        assert blink["eye"] == "left"
        assert blink["until_s"] - blink["t_s"] == pytest.approx(0.15, abs=1e-3)
        assert {"blink onset", "microsaccade"} <= {mark["what"] for mark in marks}
        frame = page.until("shown")
        assert frame["plan"][0]["effect"] == "glare"
        status = page.until("status", lambda message: message["latency"] and message["states_hz"] > 50)
        assert status["bridge"]["source"] == "made up"
        assert status["latency"]["p50_ms"] == pytest.approx(36.0)
        assert sum(status["latency"]["counts"]) > 0
        assert status["problems"] == []


def test_a_page_that_comes_later_gets_the_last_seconds(attached: Served) -> None:
    with attached.page() as first:
        first.until("marks")
        with attached.page() as second:
            second.until("status")
            before = [message for message in second.messages if message["type"] in ("traces", "marks")]
    assert len(before) > 3


def test_pictures_are_made_for_those_who_look_and_for_nobody_else(attached: Served, session: MadeUpSession) -> None:
    with attached.page() as page:
        while {message[0] for message in page.pictures} != {1, 2}:
            page.read()
        image = Image.open(io.BytesIO(page.pictures[-1][5:]))
        assert image.size == (64, 48)
        number = int.from_bytes(page.pictures[-1][1:5], "big")
        assert 0 < number <= session.frame
        assert page.ask("watch", perceived=True, displayed=False)["done"]
        wait_for(lambda: DISPLAYED not in session.wanted and PERCEIVED in session.wanted, "an end of what nobody sees")
    wait_for(lambda: not {PERCEIVED, DISPLAYED} & session.wanted, "the end of all pictures")


def test_settings_act_at_once_and_all_pages_hear_of_it(attached: Served, session: MadeUpSession) -> None:
    with attached.page() as page, attached.page() as other:
        page.until("status", lambda message: message["running"])
        assert page.ask("change settings", changes={"observer.age_years": 61})["done"]
        told = other.until("settings", lambda message: message["settings"]["observer"]["age_years"] == 61)
        assert told["because_of"] is None
        assert session.asked[-1].settings.observer.age_years == 61
        refused = page.ask("change settings", changes={"observer.age_years": 610})
        assert not refused["done"]
        assert "observer.age_years" in refused["reply"]
        session.refusal = "not now"
        assert page.ask("change settings", changes={"observer.age_years": 62})["reply"] == "not now"
        assert attached.console.live.settings.observer.age_years == 61


def test_an_observer_is_kept_and_loaded_again(attached: Served, session: MadeUpSession) -> None:
    with attached.page() as page:
        assert page.ask("change settings", changes={"observer.particles": 1500, "glare.level": "half"})["done"]
        assert page.ask("save observer", name="anna")["done"]
        assert load(attached.observers / "anna.toml").observer.particles == 1500
        again = page.ask("save observer", name="anna")
        assert not again["done"]
        assert again["data"] == {"exists": True}
        assert page.ask("save observer", name="anna", overwrite=True)["done"]
        for name in ("../anna", "", "a/b", ".hidden", "a" * 65, "anna\n", "anna.toml"):
            refused = page.ask("save observer", name=name)
            assert not refused["done"], name
        assert [path.name for path in attached.observers.iterdir()] == ["anna.toml"]
        assert page.ask("change settings", from_defaults=True)["done"]
        assert page.ask("load observer", name="anna")["done"]
        told = page.until("settings", lambda message: message["observer"] == "anna")
        assert told["settings"]["observer"]["particles"] == 1500
        assert not page.ask("load observer", name="nobody")["done"]
        assert [one["value"] for one in page.ask("list", what="observers")["data"]] == ["anna"]


def test_what_cannot_be_read_is_answered_and_nothing_breaks(attached: Served) -> None:
    with attached.page() as page:
        for bad in (
            "", "nonsense", "[]", "{}", '{"request": {"do": "fly"}, "id": 1}', '{"request": {"do": "stop session"}}',
            '{"request": {"do": "stop session"}, "id": -1}', '{"request": {"do": "stop session", "more": 2}, "id": 1}',
            '{"request": {"do": "start recording", "folder": "/", "start_ns": 0}, "id": 1}',
            "[" * 30_000, '{"request": {"do": "stop session"}, "id": 1e400}', "\U0001f600" * 9000,
            b"\x00\xff", b"",
        ):  # fmt: skip
            page.socket.send(bad)
            reply = page.until("reply")
            assert not reply["done"], bad
            assert reply["reply"].startswith("not understood")
        assert page.ask("list", what="scenes")["done"]


def test_a_message_that_is_too_long_ends_the_connection(attached: Served) -> None:
    with attached.page() as page:
        page.socket.send("x" * 70_000)
        assert page.read_to_the_end().code == 1009
    with attached.page() as page:
        page.until("hello")


def test_start_and_record_are_the_hosts(hosted: Served, session: MadeUpSession, attached: Served) -> None:
    with hosted.page() as page:
        page.until("status", lambda message: message["running"])
        assert page.ask("change settings", changes={"observer.age_years": 44})["done"]
        assert page.ask("start session", config={"eyes": {"source": "capture"}})["done"]
        start = session.asked[-1]
        assert isinstance(start, asked.StartSession)
        assert start.config.eyes.source == "capture"
        assert start.config.settings.observer.age_years == 44
        assert page.ask("record", name="one")["done"]
        assert session.asked[-1] == asked.Record("one")
        assert page.ask("stop record")["done"]
        assert page.ask("stop session")["done"]
        assert session.asked[-1] == asked.StopSession()
        assert "view.fov_deg" in page.ask("start session", config={"view": {"fov_deg": 0}})["reply"]
        session.refusal = "the scene is not there"
        assert page.ask("start session", config={})["reply"] == "the scene is not there"
    with attached.page() as page:
        assert not page.ask("start session", config={})["done"]


def test_calibrations_and_the_trackers_tasks_are_the_bridges(attached: Served, session: MadeUpSession) -> None:
    with attached.page() as page:
        reply = page.ask("calibrate pupils", name="anna", eyes="left")
        calibrate = session.asked[-1]
        assert isinstance(calibrate, asked.CalibratePupils)
        assert calibrate.out == reply["data"]["pupil_map"]
        assert Path(calibrate.out).parent.is_dir()
        assert calibrate.eyes == "left"
        for do, expected in (
            ("stop calibrating pupils", asked.StopCalibratingPupils()),
            ("start calibration", asked.StartCalibration()),
            ("stop calibration", asked.StopCalibration()),
            ("stop tracker recording", asked.StopTrackerRecording()),
        ):
            assert page.ask(do)["done"]
            assert session.asked[-1] == expected
        assert page.ask("start tracker recording", name="r")["done"]
        assert session.asked[-1] == asked.StartTrackerRecording("r")
        assert "display" in page.ask("start screens")["reply"]


def test_a_pupil_map_is_replaced_only_where_that_is_asked_for(attached: Served, session: MadeUpSession) -> None:
    with attached.page() as page:
        kept = Path(page.ask("calibrate pupils", name="anna")["data"]["pupil_map"])
        kept.touch()
        before = len(session.asked)
        refused = page.ask("calibrate pupils", name="anna")
        assert not refused["done"]
        assert refused["data"] == {"exists": True}
        assert len(session.asked) == before
        assert page.ask("calibrate pupils", name="anna", overwrite=True)["done"]
        assert session.asked[-1].out == str(kept)


def test_a_lost_pupil_is_said_and_so_is_its_return(attached: Served, session: MadeUpSession) -> None:
    with attached.page() as page:
        session.phase = Phase.LOST
        problem = page.until("status", lambda message: message["problems"])["problems"][0]
        assert problem["code"].startswith("pupil lost")
        assert problem["severity"] == "error"
        session.phase = Phase.TRACKING
        page.until("status", lambda message: not message["problems"])


def test_a_host_that_vanishes_is_said(serve: Callable[..., Served]) -> None:
    with serve(Places("tcp://127.0.0.1:9")).page() as page:
        problems = page.until("status", lambda message: message["problems"])["problems"]
    assert [problem["code"] for problem in problems] == ["host gone"]


def codes(message: dict[str, Any]) -> list[str]:
    return [one["code"] for one in message["problems"]]


def test_it_follows_a_session_that_begins_later(hosted: Served, session: MadeUpSession) -> None:
    session.is_over = True
    session.set(settings_of(77.0, 100))
    with hosted.page() as page:
        page.until("status", lambda message: codes(message) == ["nothing runs"])
        session.is_over = False
        page.until("settings", lambda message: message["settings"]["observer"]["age_years"] == 77)
        page.until("traces", lambda message: message["t_s"])
        page.until("shown")


def test_what_was_wrong_with_a_session_ends_with_it(hosted: Served, session: MadeUpSession) -> None:
    full = problem("disk full", "error", "the recording ended", "make room")
    session.worker = replace(session.worker, problems=(full,))
    with hosted.page() as page:
        status = page.until("status", lambda message: codes(message) == ["disk full"])
        assert status["host"]["state"] == "running"
        session.is_over = True
        page.until("status", lambda message: codes(message) == ["nothing runs"])


def settings_of(age_years: float, particles: int) -> Settings:
    return changed(Settings(), {"observer.age_years": age_years, "observer.particles": particles})


def test_a_server_started_in_mid_session_takes_the_settings_in_force(
    serve: Callable[..., Served], session: MadeUpSession
) -> None:
    session.set(settings_of(66.0, 1500))
    # A slider that is moved before anybody has said anything changes that one setting alone.
    with serve(Places(session.host)).page() as page:
        page.until("status", lambda message: message["running"])
        assert page.ask("change settings", changes={"observer.age_years": 67})["done"]
        assert session.asked[-1].settings == settings_of(67.0, 1500)
    with serve(Places(session.host)).page() as page:
        page.until("settings", lambda message: message["settings"]["observer"]["age_years"] == 67)
        assert page.ask("change settings", changes={"glare.level": "half"})["done"]
        settings = page.until("settings", lambda message: message["because_of"] is not None)["settings"]
        assert (settings["observer"]["particles"], settings["glare"]["level"]) == (1500, "half")


def test_settings_that_the_worker_took_back_are_shown_as_it_has_them(attached: Served, session: MadeUpSession) -> None:
    session.set(settings_of(50.0, 100))
    with attached.page() as page:
        page.until("settings", lambda message: message["settings"]["observer"]["age_years"] == 50)
        assert page.ask("change settings", changes={"observer.particles": 4000})["done"]
        page.until("settings", lambda message: message["settings"]["observer"]["particles"] == 4000)
        session.set(settings_of(50.0, 100))
        page.until("settings", lambda message: message["settings"]["observer"]["particles"] == 100)


def test_what_a_worker_said_before_the_newest_change_is_not_taken_over(attached: Served) -> None:
    live = attached.console.live
    wait_for(lambda: live.revision == 1, "the worker's word")
    live.use(settings_of(61.0, 100), "anna", 9)
    live.take_over(WorkerStatus(settings=settings_of(50.0, 100), revision=8))
    assert (live.settings.observer.age_years, live.observer) == (61.0, "anna")
    live.take_over(WorkerStatus(settings=settings_of(61.0, 100), revision=10))
    assert live.observer == "anna"
    live.take_over(WorkerStatus(settings=settings_of(50.0, 100), revision=11))
    assert (live.settings.observer.age_years, live.observer) == (50.0, None)


@pytest.mark.parametrize("how", ["signal", "standard input"])
def test_the_command_serves_and_ends_when_told(how: str, session: MadeUpSession, tmp_path: Path) -> None:
    names = ("states", "events", "bridge", "screens", "answers", "frames", "worker")
    links = PageLinks(**{name: getattr(session.addresses, name) for name in names})
    command = [sys.executable, "-m", "entoptic.services.child", "web"]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, cwd=tmp_path, text=True, start_new_session=True
    )
    try:
        assert process.stderr is not None
        assert process.stdin is not None
        config = ServerConfig(page=PageConfig(port=0), links=links)
        process.stdin.write(msgspec.json.encode(config).decode() + "\n")
        process.stdin.flush()
        at = f"127.0.0.1:{json.loads(process.stderr.readline())['port']}"
        with connect(f"ws://{at}/live", origin=f"http://{at}", max_size=None) as socket:
            assert json.loads(socket.recv(PATIENCE_S))[0]["type"] == "hello"
            if how == "signal":
                process.terminate()
            else:
                process.stdin.close()
            page = Visitor(socket)
            page.read_to_the_end()
        assert page.messages[-1]["type"] == "bye"
        assert process.wait(PATIENCE_S) == 0
    finally:
        process.kill()
        process.wait()
        process.stderr.close()
        process.stdin.close()
