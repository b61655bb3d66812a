"""What a live worker says to those who ask, while it begins and while it stops."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import structlog
import zmq
from msgspec.structs import replace

from entoptic.pipeline import FrameError
from entoptic.pipeline.budget import SHIPPED
from entoptic.pipeline.effects.tone import Operator, Tone
from entoptic.pipeline.scenes import Head
from entoptic.pipeline.scenes.head_path import open_head_path
from entoptic.pipeline.sinks.images import write_exr
from entoptic.services.config import ViewConfig
from entoptic.services.ipc.client import Reply, ask
from entoptic.services.ipc.requests import ChangeSettings, GiveStatus, StartRecording, StopRecording
from entoptic.services.ipc.status import WorkerStatus, status_of
from entoptic.services.process_config import WorkerLinks
from entoptic.services.reader import StateReader
from entoptic.services.rendering import Rendering
from entoptic.services.results.render_log import FrameRecord, RenderLog
from entoptic.services.results.tally import WorkerSummary
from entoptic.services.session_config import EYES, open_view, view_of
from entoptic.services.settings import Settings
from entoptic.services.worker.checkpoint import Checkpoint, Keeper
from entoptic.services.worker.live import LiveWorker
from entoptic.services.worker.requests import WorkerRequests

ANY = "tcp://127.0.0.1:*"
NOBODY = "tcp://127.0.0.1:9"
PATIENCE_S = 60.0
# Each of these takes seconds to compile, and so does the night street.
QUICK = msgspec.convert({"plan": {"leave_out": ["acuity", "glare", "night_colour", "rod_noise"]}}, Settings)


class Asking:
    """Asks from a thread."""

    def __init__(self, address: str, request: msgspec.Struct) -> None:
        self.reply: Reply | None = None

        def go() -> None:
            self.reply = ask(address, request, patience_ms=int(PATIENCE_S * 1e3))

        self._thread = threading.Thread(target=go, daemon=True)
        self._thread.start()

    def wait(self) -> Reply:
        self._thread.join(PATIENCE_S)
        assert self.reply is not None
        return self.reply


@pytest.fixture
def context() -> Iterator[zmq.Context[zmq.Socket[bytes]]]:
    with zmq.Context() as made:
        yield made


def until_asked(requests: WorkerRequests) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not requests._commands.qsize():
        assert time.monotonic() < deadline
        time.sleep(0.005)


class Worked:
    """A live worker with nobody's eyes before it; it goes on from a checkpoint, so that little is compiled."""

    def __init__(self, folder: Path, context: zmq.Context[zmq.Socket[bytes]], stop: Callable[[], bool]) -> None:
        log: Any = structlog.get_logger()
        now_ns = time.monotonic_ns()
        scene = folder / "scene.exr"
        write_exr(scene, np.full((32, 64, 3), 10.0, np.float32))
        view = ViewConfig(
            scene=str(scene), mean_luminance_cd_m2=10.0, width_px=32, height_px=24, fov_deg=90.0, fps=20.0,
            head="still", save=(),
        )  # fmt: skip
        self.before = Checkpoint(
            written_ns=now_ns, view=view, zero_ns=now_ns - 10 * 10**9, frame=100, t_s=5.0, dropped=7, head=Head(),
            perception=QUICK, costs=SHIPPED, state=None,
        )  # fmt: skip
        Keeper(folder / "checkpoint", log).write(self.before)
        opened, _ = open_view(view)
        rendering = Rendering(opened, view_of(view), EYES[view.eyes], Settings())
        self._reader = StateReader(NOBODY, NOBODY)
        links = WorkerLinks(states=NOBODY, events=NOBODY, control=ANY, resume=str(folder / "checkpoint"))
        self.worker = LiveWorker(self._reader, rendering, open_head_path(view.head), links, view, stop, log)
        self.requests = WorkerRequests(ANY, None, self.worker.status, self.worker.change, context)

    def run(self) -> WorkerSummary | None:
        try:
            return self.worker.run(self.requests)
        finally:
            self.requests.close()
            self._reader.close()


def test_who_ends_a_recording_as_the_worker_stops_is_told_the_truth(
    context: zmq.Context[zmq.Socket[bytes]], tmp_path: Path
) -> None:
    ends: list[Asking] = []

    def stop() -> bool:
        """Between the last look at what is wished and the end of the loop."""
        status = worked.worker.status()
        if not ends and status.recording and status.frame > 100:
            ends.append(Asking(worked.requests.address, StopRecording()))
            until_asked(worked.requests)
        return bool(ends)

    worked = Worked(tmp_path, context, stop)
    begins = Asking(worked.requests.address, StartRecording(str(tmp_path), time.monotonic_ns()))
    until_asked(worked.requests)
    summary = worked.run()
    assert begins.wait().done
    assert summary is not None
    assert summary.frames >= 1
    assert ends[0].wait() == Reply(True, f"{summary.frames} frames are recorded", {"frames": summary.frames})
    assert (tmp_path / "worker.json").exists()
    # Frames that were due while no worker was there are left out too.
    first = next(record for record in RenderLog(tmp_path / "render_log.msgpack") if isinstance(record, FrameRecord))
    assert first.frame >= 200
    assert first.dropped == worked.before.dropped + first.frame - worked.before.frame - 1


def status_at(address: str) -> WorkerStatus:
    status = status_of(ask(address, GiveStatus()).data)
    assert isinstance(status, WorkerStatus)
    return status


def test_the_status_says_which_settings_are_in_force(context: zmq.Context[zmq.Socket[bytes]], tmp_path: Path) -> None:
    wanted = replace(QUICK, observer=replace(QUICK.observer, age_years=66.0))
    seen: list[WorkerStatus] = []

    def stop() -> bool:
        address = worked.requests.address
        if not seen:
            seen.append(status_at(address))
            reply = ask(address, ChangeSettings(wanted))
            # From the reply on the status has them, though no frame has been rendered with them yet.
            seen.append(status_at(address))
            assert reply.data == seen[-1].revision > seen[0].revision
        return worked.worker._rendering.perception == wanted

    worked = Worked(tmp_path, context, stop)
    worked.run()
    assert (seen[0].settings, seen[1].settings) == (QUICK, wanted)


def test_settings_that_cannot_be_rendered_are_taken_back_with_a_revision_of_their_own(
    context: zmq.Context[zmq.Socket[bytes]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    impossible = replace(QUICK, observer=replace(QUICK.observer, age_years=66.0))
    render = Rendering.render

    def cannot(self: Rendering, *arguments: Any) -> Any:
        if self.perception == impossible:
            raise FrameError("no memory")
        return render(self, *arguments)

    monkeypatch.setattr(Rendering, "render", cannot)
    asked: list[int] = []

    def stop() -> bool:
        if not asked:
            asked.append(ask(worked.requests.address, ChangeSettings(impossible)).data)
        return bool(worked.worker.status().problems)

    worked = Worked(tmp_path, context, stop)
    worked.run()
    status = worked.worker.status()
    assert status.settings == QUICK
    assert status.revision > asked[0]
    assert [(one.code, one.severity) for one in status.problems] == [("settings taken back", "warning")]
    assert "no memory" in status.problems[0].what


def test_settings_outside_their_range_are_refused(context: zmq.Context[zmq.Socket[bytes]]) -> None:
    requests = WorkerRequests(ANY, None, WorkerStatus, lambda settings: 0, context)
    try:
        far = replace(QUICK, observer=replace(QUICK.observer, age_years=660.0))
        reply = ask(requests.address, ChangeSettings(far))
        assert not reply.done
        assert "observer.age_years" in reply.reply
        lost = replace(QUICK, tone=Tone(operator=Operator.CURVE, curve="nowhere.csv"))
        assert "nowhere.csv" in ask(requests.address, ChangeSettings(lost)).reply
    finally:
        requests.close()


def test_a_worker_that_stops_says_so_to_all_who_wait(context: zmq.Context[zmq.Socket[bytes]]) -> None:
    requests = WorkerRequests(ANY, None, WorkerStatus, lambda settings: 0, context)
    try:
        end = Asking(requests.address, StopRecording())
        until_asked(requests)
        requests.over(Reply(False, "nothing is being recorded"))
        assert end.wait() == Reply(False, "nothing is being recorded")
        begin = Asking(requests.address, StartRecording(".", 0))
        assert begin.wait() == Reply(False, "the worker stops")
    finally:
        requests.close()
