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

from entoptic.pipeline.budget import SHIPPED
from entoptic.pipeline.scenes import Head
from entoptic.pipeline.scenes.head_path import open_head_path
from entoptic.pipeline.sinks.images import write_exr
from entoptic.services.config import ViewConfig
from entoptic.services.ipc.client import Reply, ask
from entoptic.services.ipc.requests import BeginTake, EndTake, GiveStatus, Perceive
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


def until_wished(requests: WorkerRequests) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not requests._wishes.qsize():
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
        self.requests = WorkerRequests(ANY, None, self.worker.status, context)

    def run(self) -> WorkerSummary | None:
        try:
            return self.worker.run(self.requests)
        finally:
            self.requests.close()
            self._reader.close()


def test_who_ends_a_take_as_the_worker_stops_is_told_the_truth(
    context: zmq.Context[zmq.Socket[bytes]], tmp_path: Path
) -> None:
    ends: list[Asking] = []

    def stop() -> bool:
        """Between the last look at what is wished and the end of the loop."""
        status = worked.worker.status()
        if not ends and status["take"] and status["frame"] > 100:
            ends.append(Asking(worked.requests.address, EndTake()))
            until_wished(worked.requests)
        return bool(ends)

    worked = Worked(tmp_path, context, stop)
    begins = Asking(worked.requests.address, BeginTake(str(tmp_path), time.monotonic_ns()))
    until_wished(worked.requests)
    summary = worked.run()
    assert begins.wait().done
    assert summary is not None
    assert summary.frames >= 1
    assert ends[0].wait() == Reply(True, f"{summary.frames} frames are kept", {"frames": summary.frames})
    assert (tmp_path / "worker.json").exists()
    # Frames that were due while no worker was there are left out too.
    first = next(record for record in RenderLog(tmp_path / "render_log.msgpack") if isinstance(record, FrameRecord))
    assert first.frame >= 200
    assert first.dropped == worked.before.dropped + first.frame - worked.before.frame - 1


def test_the_status_says_which_settings_are_in_force(context: zmq.Context[zmq.Socket[bytes]], tmp_path: Path) -> None:
    wanted = msgspec.structs.replace(QUICK, observer=msgspec.structs.replace(QUICK.observer, age_years=66.0))
    seen: list[dict[str, Any]] = []

    def stop() -> bool:
        status = ask(worked.requests.address, GiveStatus()).data
        assert status is not None
        if not seen:
            seen.append(status["settings"])
            assert ask(worked.requests.address, Perceive(msgspec.to_builtins(wanted))).done
        seen.append(status["settings"])
        return msgspec.convert(seen[-1], Settings) == wanted

    worked = Worked(tmp_path, context, stop)
    worked.run()
    assert msgspec.convert(seen[0], Settings) == QUICK
    assert seen[-1]["plan"]["leave_out"] == ["acuity", "glare", "night_colour", "rod_noise"]


def test_a_worker_that_stops_says_so_to_all_who_wait(context: zmq.Context[zmq.Socket[bytes]]) -> None:
    requests = WorkerRequests(ANY, None, dict, context)
    try:
        end = Asking(requests.address, EndTake())
        until_wished(requests)
        requests.over(Reply(False, "no take is running"))
        assert end.wait() == Reply(False, "no take is running")
        begin = Asking(requests.address, BeginTake(".", 0))
        assert begin.wait() == Reply(False, "the worker stops")
    finally:
        requests.close()
