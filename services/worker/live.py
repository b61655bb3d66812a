"""The pipeline process that keeps the clock: frames when they are due, for whoever watches, and into recordings.

Theory of operation: one loop, and a thread that listens (requests.py). Frame k is due at zero_ns + k/fps of the
machine's monotonic clock; those whose time has passed are left out. A worker that is started again reads what the last
one remembered (checkpoint.py) and goes on with the frame that is due now: to the eyes it was one long frame.
"""

from __future__ import annotations

import collections
import contextlib
import statistics
import threading
import time
from pathlib import Path

import msgspec
import structlog
import zmq

from entoptic.pipeline import FrameError
from entoptic.pipeline.budget import load as load_costs
from entoptic.pipeline.optics import OpticsError
from entoptic.pipeline.scenes import Head
from entoptic.pipeline.scenes.head_path import HeadPath, open_head_path
from entoptic.services import keys as key_files
from entoptic.services.config import ViewConfig
from entoptic.services.ipc.client import Reply
from entoptic.services.ipc.messages import LatencyMs
from entoptic.services.ipc.requests import StartRecording
from entoptic.services.ipc.status import Problem, WorkerStatus, problem, unwritable
from entoptic.services.process import Stop, cache_folder
from entoptic.services.process_config import WorkerLinks
from entoptic.services.reader import StateReader
from entoptic.services.rendering import Rendered, Rendering, frames_known, gaze_deg, impulses_of
from entoptic.services.results import finish
from entoptic.services.results.render_log import FrameRecord, begin
from entoptic.services.results.tally import Reception, WorkerSummary
from entoptic.services.session_config import EYES, WorkerConfig, open_view, view_of
from entoptic.services.settings import Settings
from entoptic.services.worker.checkpoint import Checkpoint, Keeper
from entoptic.services.worker.publish import LivePublisher
from entoptic.services.worker.recording import UNWRITABLE, WorkerRecording
from entoptic.services.worker.requests import Command, WorkerRequests
from entoptic.tracker_bridge.wire import NS_PER_S, EyeState

GONE_S = 3.0
"""After so long without a state or a heartbeat a bridge says nothing about the eyes any more. Engineering choice: three
heartbeats."""
STALE_NS = 500_000_000
"""An older state has no latency: no sample has come for a while, or its time is another machine's."""
WORK_FRAMES = 24
"""Of which a status says what a frame takes. Engineering choice: a second's."""
LOOKS_UP_S = 0.05
"""A loop that waits looks so often whether it is to stop."""


class LiveWorker:
    """Renders by the clock. `status` is for any thread, all else for one."""

    def __init__(
        self,
        reader: StateReader,
        rendering: Rendering,
        head_path: HeadPath,
        links: WorkerLinks,
        view: ViewConfig,
        stop: Stop,
        log: structlog.typing.FilteringBoundLogger,
        publisher: LivePublisher | None = None,
    ) -> None:
        self._reader, self._rendering, self._head_path = reader, rendering, head_path
        self._links, self._view, self._stop, self._log, self._publisher = links, view, stop, log, publisher
        # It runs until it is stopped, whatever becomes of the bridge; else it ends with the stream.
        self._hosted = links.control is not None
        self._recording = WorkerRecording(log)
        self._keeper = None if links.resume is None else Keeper(Path(links.resume), log)
        self._warm_up_s: float | None = None
        self._zero_ns: int | None = None
        self._frame, self._t_s, self._dropped = -1, 0.0, 0
        self._head = Head()
        self._state: EyeState | None = None
        self._settings = (time.monotonic_ns(), rendering.perception)
        """From the next frame on, with their revision: a time, so that it grows over a restart too."""
        self._changing = threading.Lock()
        self._refused: Problem | None = None
        """Why settings were taken back."""
        self._recent: collections.deque[int] = collections.deque()
        """When each of the last second's frames was kept."""
        self._work_ms: collections.deque[tuple[float, float]] = collections.deque(maxlen=WORK_FRAMES)
        """Of the last frames: making it, and all of it."""
        self._preparing = True

    def status(self) -> WorkerStatus:
        """As of now; for any thread."""
        revision, settings = self._settings
        return WorkerStatus(
            scene=self._view.scene,
            frame=self._frame,
            fps=self._view.fps,
            reached_fps=self._reached_fps(),
            scene_ms=self._median_ms(0),
            frame_ms=self._median_ms(1),
            dropped=self._dropped,
            preparing=self._preparing,
            recording=self._recording.folder,
            viewers=0 if self._publisher is None else self._publisher.viewers,
            settings=settings,
            revision=revision,
            problems=tuple(one for one in (self._recording.problem, self._refused) if one is not None),
        )

    def change(self, settings: Settings) -> int:
        """Other settings, from the next frame on; their revision. For any thread."""
        with self._changing:
            self._settings = (time.monotonic_ns(), settings)
            return self._settings[0]

    def run(self, requests: WorkerRequests | None = None) -> WorkerSummary | None:
        """Until asked to stop, or to the end of what was asked for; what lies in `out`, if it is given."""
        frames = self._prepare()
        try:
            if self._links.out is not None and not self._stop():
                self._zero_ns = self._zero_ns or time.monotonic_ns()
                self._begin(StartRecording(str(self._links.out), self._zero_ns))
            frame = self._next_frame()
            # Those that were due while no worker was there, and the last second's, of which no checkpoint knows.
            self._dropped += frame - self._frame - 1
            while not self._stop() and (frames is None or frame < frames) and not self._stream_ended():
                wait_s = self._due_s(frame)
                if requests is not None:
                    requests.serve(self._do, min(wait_s, LOOKS_UP_S))
                elif wait_s > 0:
                    time.sleep(min(wait_s, LOOKS_UP_S))
                if wait_s <= LOOKS_UP_S and self._due_s(frame) <= 0:
                    self._render(frame)
                    self._after_frame(frame, frames)
                    after = max(self._next_frame(), frame + 1)
                    self._dropped += after - frame - 1
                    frame = after
        finally:
            summary, ended = self._end()
            if requests is not None:
                requests.over(ended)
        return summary

    def _prepare(self) -> int | None:
        """Before the first frame; how many there will be."""
        checkpoint = None if self._keeper is None else self._keeper.read(self._view)
        self._log.info("preparing", scene=self._view.scene, resumed=checkpoint is not None)
        if checkpoint is None:
            self._warm_up_s = round(self._rendering.warm_up(self._stop), 2)
        else:
            # What was compiled lies on the disk; what the next frame does not call for can wait.
            self._go_on_from(checkpoint)
        start_ns = end_ns = None
        if self._hosted:
            self._reader.subscribe()
        elif (started := self._reader.wait_for_start(self._stop)) is not None:
            start_ns, end_ns = started.t_ns, started.t_end_ns
        if checkpoint is None:
            self._log.info("prepared", seconds=self._warm_up_s)
        return frames_known(self._view.seconds, end_ns, start_ns or 0, self._view.fps)

    def _go_on_from(self, checkpoint: Checkpoint) -> None:
        self._zero_ns, self._frame, self._t_s = checkpoint.zero_ns, checkpoint.frame, checkpoint.t_s
        self._dropped, self._head = checkpoint.dropped, checkpoint.head
        with self._changing:
            if self._settings[1] == self._rendering.perception:  # else they were changed meanwhile
                self._settings = (time.monotonic_ns(), checkpoint.perception)
        self._rendering.perception, self._rendering.costs = checkpoint.perception, checkpoint.costs
        self._rendering.memory = checkpoint.state

    def _next_frame(self) -> int:
        """The one that is due now."""
        if self._zero_ns is None:
            return 0
        return max(int((time.monotonic_ns() - self._zero_ns) / NS_PER_S * self._view.fps), self._frame + 1)

    def _due_s(self, frame: int) -> float:
        """How long until then."""
        if self._zero_ns is None:
            return 0.0
        return frame / self._view.fps - (time.monotonic_ns() - self._zero_ns) / NS_PER_S

    def _stream_ended(self) -> bool:
        return not self._hosted and self._reader.ended is not None

    def _do(self, command: Command) -> Reply:
        return self._begin(command) if isinstance(command, StartRecording) else self._end()[1]

    def _use(self, settings: Settings) -> None:
        self._rendering.perception = settings
        self._recording.perceive(settings)
        if self._keeper is not None:
            self._keeper.hurry()

    def _begin(self, command: StartRecording) -> Reply:
        if self._recording.runs:
            same = (self._recording.folder, self._recording.start_ns) == (command.folder, command.start_ns)
            return Reply(same, f"{self._recording.folder} is being recorded" + ("" if same else ": end it first"))
        if self._zero_ns is None:
            self._zero_ns = time.monotonic_ns()
        begun = begin(self._view, self._rendering, live=True, zero_s=(command.start_ns - self._zero_ns) / NS_PER_S)
        try:
            self._recording.begin(
                command.folder, command.start_ns, begun, frozenset(self._view.save), _reception(self._reader)
            )
        except UNWRITABLE as error:
            self._recording.problem = unwritable(command.folder, error)
            self._log.error("recording not begun", folder=command.folder, error=str(error))
            return Reply(False, str(self._recording.problem))
        return Reply(True, f"frames are recorded in {command.folder}")

    def _end(self) -> tuple[WorkerSummary | None, Reply]:
        if not self._recording.runs:
            return None, Reply(False, str(self._recording.problem or "nothing is being recorded"))
        summary = self._recording.end(_reception(self._reader), self._warm_up_s)
        if summary is None:
            return None, Reply(False, str(self._recording.problem or "the recording could not be ended"))
        return summary, Reply(True, f"{summary.frames} frames are recorded", {"frames": summary.frames})

    def _render(self, frame: int) -> None:
        begun_ns = time.monotonic_ns()
        self._zero_ns = self._zero_ns if self._zero_ns is not None else begun_ns
        t_s = frame / self._view.fps
        dt_s = t_s - self._t_s
        newest = self._reader.newest()
        self._state = newest or (None if self._reader.silent_s > GONE_S else self._state)
        saccades = self._reader.saccades_received()
        has_impulses = self._rendering.perception.observer.ocular_dynamics.vitreous and self._state is not None
        saccade_impulses = impulses_of(saccades, self._state.t_ns) if has_impulses and self._state is not None else ()
        head = self._head_path.step(t_s, dt_s, self._head, gaze_deg(self._state))
        arguments = (frame, t_s, dt_s, head, self._state, saccade_impulses)
        before, (revision, settings) = self._rendering.perception, self._settings
        if settings != before:
            self._use(settings)
        try:
            rendered = self._rendering.render(*arguments)
        except (FrameError, OpticsError) as error:
            if settings == before:
                raise
            self._restore(revision, before, error)
            rendered = self._rendering.render(*arguments)
        else:
            self._refused = self._refused if settings == before else None
        timings = tuple(rendered.timings)
        self._rendering.correct(timings)
        self._t_s, self._head, self._frame = t_s, head, frame
        record = FrameRecord(frame, t_s, dt_s, head, self._state, saccade_impulses, self._dropped, timings)
        self._work_ms.append((rendered.scene_ms, rendered.total_ms))
        self._sink(rendered, record, begun_ns)

    def _restore(self, revision: int, before: Settings, error: Exception) -> None:
        self._refused = problem(
            "settings taken back",
            "warning",
            f"The last settings were taken back, since they cannot be rendered: {error}",
            "Those from before go on. Choose other values under Settings",
        )
        self._log.warning("settings taken back", error=str(error))
        with self._changing:
            if self._settings[0] == revision:  # else others have come meanwhile
                self._settings = (time.monotonic_ns(), before)
        self._use(before)

    def _sink(self, rendered: Rendered, record: FrameRecord, begun_ns: int) -> None:
        """Keeps a frame and shows it; its row is written last, since it says how long that took."""
        sink_ns = time.monotonic_ns()
        self._recording.add(rendered, record)
        kept_ns = time.monotonic_ns()
        self._recent.append(kept_ns)
        if self._publisher is not None:
            self._publisher.show(
                rendered,
                EYES[self._view.eyes],
                self._rendering.perception,
                t_ns=begun_ns,
                fps=self._view.fps,
                reached_fps=self._reached_fps(),
                dropped=self._dropped,
                latency=lambda: self._latency(begun_ns),
                sink_ms=(kept_ns - sink_ns) / 1e6,
                recording=self._recording.folder,
            )
        self._recording.note(rendered, self._latency(begun_ns))

    def _latency(self, begun_ns: int) -> LatencyMs | None:
        """Up to now, when a frame is kept and its pictures are published."""
        state, sent_ns = self._state, self._reader.newest_sent_ns
        if state is None or sent_ns is None or begun_ns - state.t_ns > STALE_NS:
            return None
        if not state.t_ns <= sent_ns <= begun_ns:
            return None  # not of this machine's clock
        return LatencyMs(
            (sent_ns - state.t_ns) / 1e6, (begun_ns - sent_ns) / 1e6, (time.monotonic_ns() - begun_ns) / 1e6
        )

    def _reached_fps(self) -> float:
        """Of the last second or so; frames that wait for the next one to be shown count as late."""
        recent = tuple(self._recent)
        if len(recent) < 2:
            return 0.0
        return (len(recent) - 1) * NS_PER_S / max(recent[-1] - recent[0], time.monotonic_ns() - recent[-1], 1)

    def _median_ms(self, which: int) -> float | None:
        recent = [work[which] for work in tuple(self._work_ms)]
        return round(statistics.median(recent), 1) if recent else None

    def _after_frame(self, frame: int, frames: int | None) -> None:
        if self._preparing:
            if self._warm_up_s is None:
                # Started again: whatever the first frame calls for is loaded by now.
                self._log.info("prepared", seconds=None)
            self._log.info("first frame", frame=frame, t_s=round(self._t_s, 3))
            self._preparing = False
        while len(self._recent) > 2 and self._recent[-1] - self._recent[0] > NS_PER_S:
            self._recent.popleft()
        self._log.info("progress", frame=frame + 1, frames=frames, dropped=self._dropped)
        if self._keeper is not None and self._keeper.due:
            self._recording.check()
            self._keeper.write(self._checkpoint())

    def _checkpoint(self) -> Checkpoint:
        assert self._zero_ns is not None
        return Checkpoint(
            written_ns=time.monotonic_ns(),
            view=self._view,
            zero_ns=self._zero_ns,
            frame=self._frame,
            t_s=self._t_s,
            dropped=self._dropped,
            head=self._head,
            perception=self._rendering.perception,
            costs=self._rendering.costs,
            state=self._rendering.kept_memory,
        )


def run(config: WorkerConfig, stop: Stop, log: structlog.typing.FilteringBoundLogger) -> None:
    """A live worker with its sockets, until it is stopped or the stream ends.

    Raises FrameError, SettingsError, BridgeSilentError or ShutOutError; PortInUseError, and OpenAddressError for an
    address of its own that is not local unless there are keys.
    """
    links = config.links
    scene, view = open_view(config.view)
    head_path = open_head_path(view.head)
    costs = load_costs(cache_folder()).beside_scene(scene.cost)
    rendering = Rendering(scene, view_of(view), EYES[view.eyes], config.settings, costs)
    if links.out is not None:
        Path(links.out).mkdir(parents=True, exist_ok=True)
    client_keys = None if links.keys is None else key_files.load_client(Path(links.keys))
    keys = None if links.server_keys is None else key_files.load_server(Path(links.server_keys))
    with contextlib.ExitStack() as opened:
        reader = StateReader(links.states, links.events, keys=client_keys)
        opened.callback(reader.close)
        publisher = None if links.frames is None else LivePublisher(links.frames, keys)
        if publisher is not None:
            opened.callback(publisher.close)
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context() if publisher is None else publisher.context
        if publisher is None:
            opened.callback(context.term)
        worker = LiveWorker(reader, rendering, head_path, links, view, stop, log, publisher)
        requests = (
            None
            if links.control is None
            else WorkerRequests(links.control, keys, worker.status, worker.change, context)
        )
        if requests is not None:
            opened.callback(requests.close)
        log.info(
            "ready",
            frames=None if publisher is None else publisher.address,
            control=None if requests is None else requests.address,
        )
        summary = worker.run(requests)
    if links.out is not None:
        finish.finish(Path(links.out))
    log.info("ended", **({} if summary is None else msgspec.to_builtins(summary)))


def _reception(reader: StateReader) -> Reception:
    """What was received of the bridge so far."""
    return Reception(reader.received, reader.skipped, reader.events.gaps, reader.events.lost, reader.refused)
