"""What goes wrong behind the pages is said or passed over, and never leaves a server that answers and tells nothing."""

import http.client
import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from console_session import MS, PATIENCE_S, MadeUpSession, Served, wait_for

from entoptic.services.console.feed import KEPT_S, Timeline
from entoptic.services.console.figures import Figures
from entoptic.services.console.listing import listed
from entoptic.services.console.live import Live, Places
from entoptic.tracker_bridge.wire import NS_PER_S, BlinkOffset, Eye, TaskKind, TaskOutcome, TrackerTask


def test_a_console_that_comes_late_tells_only_what_is_news(
    serve: Callable[..., Served], session: MadeUpSession
) -> None:
    hours_ago_ns = time.monotonic_ns() - 2 * 3600 * NS_PER_S
    for number in range(6000):
        event = BlinkOffset(hours_ago_ns + number * 100 * MS, Eye.LEFT, 150 * MS)
        session.publisher.publish_event(event)
    old = TrackerTask(hours_ago_ns, TaskKind.GAZE_CALIBRATION, TaskOutcome.STARTED, "hours ago")
    session.publisher.publish_event(old)
    served = serve(Places(None, session.addresses))
    with served.page() as page:
        page.read()
        assert page.messages[0]["type"] == "hello"
        first = page.until("marks")["marks"]
        marks = [*first, *page.until("marks")["marks"]]
        now_s = page.until("traces")["now_s"]
    assert {mark["what"] for mark in marks} <= {"blink onset", "blink", "microsaccade"}
    assert all(mark["t_s"] > now_s - KEPT_S - 5 for mark in marks)


def test_times_after_a_stall_are_not_left_in_the_future() -> None:
    timeline = Timeline(100.0)
    assert timeline.t_s(7 * NS_PER_S, 110.0) == 10.0
    # The first state had waited for three seconds.
    assert timeline.t_s(11 * NS_PER_S, 111.0) == 11.0
    assert timeline.t_s(int(11.1 * NS_PER_S), 111.1) == pytest.approx(11.1)
    assert timeline.t_s(int(11.2 * NS_PER_S), 111.6) == pytest.approx(11.2)


def health(served: Served) -> int:
    connection = http.client.HTTPConnection("127.0.0.1", served.server.port, timeout=PATIENCE_S)
    try:
        connection.request("GET", "/health")
        return connection.getresponse().status
    except OSError:
        return 0
    finally:
        connection.close()


def test_a_server_that_feeds_no_pages_any_more_ends(attached: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(self: Live) -> None:
        raise RuntimeError("too many open files")

    assert health(attached) == 200
    with attached.page() as page:
        page.until("status")
        monkeypatch.setattr(Live, "status", broken)
        page.read_to_the_end()
    wait_for(lambda: not attached.server.lives, "the server's end")
    assert attached.server.failure == "too many open files"
    assert health(attached) != 200


def test_a_thread_that_broke_ends_the_server_too(attached: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(self: Figures, *_: object) -> None:
        raise RuntimeError("out of memory")

    with attached.page() as page:
        page.until("traces", lambda message: message["t_s"])
        monkeypatch.setattr(Figures, "add_state", broken)
        page.read_to_the_end()
    wait_for(lambda: not attached.server.lives, "the server's end")
    assert attached.server.failure == "out of memory"


def test_links_that_lead_out_are_left_out_and_the_rest_is_listed(tmp_path: Path) -> None:
    inputs, outside = tmp_path / "inputs", tmp_path / "outside"
    for folder in (inputs / "rooms", outside):
        folder.mkdir(parents=True)
    (outside / "secret.hdr").touch()
    (outside / "eyes.csv").touch()
    for name in ("lamp.hdr", "rooms/bed.exr", "eyes.csv"):
        (inputs / name).touch()
    (inputs / "out").symlink_to(outside)
    (inputs / "secret.hdr").symlink_to(outside / "secret.hdr")
    (inputs / "loop").symlink_to(inputs / "loop")
    (inputs / "moon.hdr").symlink_to(inputs / "lamp.hdr")
    (linked := tmp_path / "linked").symlink_to(inputs)
    for folder in (inputs, linked):
        found = {one.label: one.value for one in listed("scenes", root=tmp_path, observers=tmp_path, inputs=folder)}
        assert set(found) == {"Street at night", "lamp.hdr", "moon.hdr", "rooms", "rooms/bed.exr"}
        assert found["moon.hdr"] == str((inputs / "lamp.hdr").resolve())
        sources = [one.label for one in listed("sources", root=tmp_path, observers=tmp_path, inputs=folder)]
        assert sources[-1] == "eyes.csv"
        assert not any("out" in label for label in sources)


def test_a_name_that_is_no_text_disturbs_nothing(attached: Served) -> None:
    for folder in (attached.inputs, attached.root, attached.observers):
        folder.mkdir(exist_ok=True)
        try:
            (folder / os.fsdecode(b"caf\xe9.hdr")).touch()
            (folder / os.fsdecode(b"\xff.toml")).touch()
        except OSError:
            pytest.skip("this file system takes only names that are text")
    (attached.inputs / "lamp.hdr").touch()
    with attached.page() as page:
        assert [one["label"] for one in page.ask("list", what="scenes")["data"]] == ["Street at night", "lamp.hdr"]
        for what in ("observers", "sessions", "sources", "pupil maps"):
            assert page.ask("list", what=what)["done"]


def test_an_answer_that_cannot_be_told_is_said(session: MadeUpSession, tmp_path: Path) -> None:
    try:
        (folder := tmp_path / os.fsdecode(b"caf\xe9")).mkdir()
    except OSError:
        pytest.skip("this file system takes only names that are text")
    served = Served(folder, Places(None, session.addresses))
    try:
        with served.page() as page:
            saved = page.ask("save observer", name="anna")
            assert not saved["done"]
            assert "cannot be told" in saved["reply"]
            assert page.ask("list", what="observers")["done"]
    finally:
        served.close()
