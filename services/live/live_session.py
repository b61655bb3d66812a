"""A live session: a bridge and a worker that are kept running, and what is recorded of them.

Theory of operation: `step` is called some fifty times a second and never waits; whatever takes long (a folder's inputs,
its film and its report) is done by a thread of its own, one after another. A recording begins when the worker can
show it; a live tracker begins at once.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

from msgspec.structs import replace

from entoptic.services import recording
from entoptic.services.ipc.addresses import Addresses, free_addresses
from entoptic.services.ipc.client import Context, Reply
from entoptic.services.ipc.status import BridgeStatus, Gap, Problem, WorkerStatus, merged, problem
from entoptic.services.ipc.status_poll import StatusPoll
from entoptic.services.live.journal import Journal
from entoptic.services.live.recorder import Recorder
from entoptic.services.live.supervised import Supervised
from entoptic.services.process_config import BridgeConfig, WorkerLinks
from entoptic.services.results import session_file
from entoptic.services.results.folder import ResultsFolderError
from entoptic.services.session_config import OpenedSession, WorkerConfig
from entoptic.tracker_bridge.sources import SIMULATED

BRIDGE, WORKER = "bridge", "worker"
ENDS_WITHIN_S: Final = 5.0
"""A session that a person stops; a worker in the middle of a compilation is then ended by force."""


class LiveSession:
    """One session, from its start to its end."""

    def __init__(
        self, opened: OpenedSession, scratch: Path, context: Context, journal: Journal, work: ThreadPoolExecutor
    ) -> None:
        """`scratch` is a folder for what is needed while it runs. Raises FrameError where it cannot be written."""
        self.opened, self.state = opened, "starting"
        self.started = session_file.now()
        self.begun_ns = time.monotonic_ns()
        self.addresses = free_addresses()
        self.folder: Path | None = None
        """Of the recording that runs."""
        self.last_folder: Path | None = None
        self.finishing: Path | None = None
        self.problems: tuple[Problem, ...] = ()
        """What ended it, or a recording, before it was asked to."""
        self._interrupted = False
        self._context, self._journal, self._work = context, journal, work
        self._checkpoint = scratch / "worker.checkpoint"
        self._checkpoint.unlink(missing_ok=True)
        self._source_begun_ns: int | None = None
        self._recorder: Recorder | None = None
        self._noted: tuple[Gap, ...] = ()
        self._record_as: Path | None = None
        self._jobs: list[tuple[Future[Any], Callable[[Any], None]]] = []
        at = self.addresses
        self._polls = {name: StatusPoll(control, context=context) for name, control in self._controls(at).items()}
        self._ends_at_s: float | None = None
        self._do(recording.prepare_report, lambda nothing: None)
        self.bridge = Supervised(BRIDGE, self._bridge_config, "ready", journal, self._on_bridge)
        self.worker = Supervised(WORKER, self._worker_config, "prepared", journal)
        self.processes = (self.bridge, self.worker)
        self.worker.start()
        if opened.source.info.live or opened.config.eyes.source == SIMULATED:
            self.bridge.start()

    def _bridge_config(self) -> BridgeConfig:
        """As of now: with the newest pupil map, and where the source has come to."""
        at, eyes = self.addresses, self.opened.config.eyes
        return BridgeConfig(
            eyes=replace(eyes, pupil_map=(self.bridge_status and self.bridge_status.pupil_map) or eyes.pupil_map),
            states=at.states,
            events=at.events,
            replay=at.replay,
            control=at.bridge,
            screens=at.screens,
            answers=at.answers,
            sees=at.frames if eyes.source == SIMULATED else None,
            live=True,
            begun_ns=self._source_begun_ns,
        )

    def _worker_config(self) -> WorkerConfig:
        at, config = self.addresses, self.opened.config
        links = WorkerLinks(
            states=at.states, events=at.events, frames=at.frames, control=at.worker, resume=str(self._checkpoint)
        )
        return WorkerConfig(links=links, view=replace(config.view, seconds=None), settings=config.settings)

    def _on_bridge(self, message: dict[str, Any]) -> None:
        if message["event"] == "ready" and self._source_begun_ns is None:
            self._source_begun_ns = message.get("begun_ns") or time.monotonic_ns()

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Of both processes, by time."""
        return tuple(sorted((gap for one in self.processes for gap in one.gaps), key=lambda gap: gap.from_ns))

    @property
    def is_over(self) -> bool:
        """Whether nothing of it is left, and its last folder is finished."""
        return self.state == "ended"

    def step(self) -> None:
        """Does what is to be done now."""
        for one in self.processes:
            if one.step() and self._recorder is not None:
                self._recorder.tell(one.name)
            elif not one.lives and self._recorder is not None:
                self._recorder.lost(one.name)
            self._poll(one)
            if one.state == "failed" and self.state in ("starting", "running"):
                self._give_up(one)
        if self.worker.is_ready and self.bridge.state == "stopped" and self.state == "starting":
            self.bridge.start()
        if self.state == "starting" and self.worker.is_ready and self.bridge.is_ready:
            self._begin()
        self._end_when_done()
        self._step_recorder()
        self._finish_jobs()
        if self.state == "stopping" and not any(one.lives for one in self.processes):
            self._end_recording_now()
            if not self._jobs:
                self.state = "ended"
                self.close()

    def _begin(self) -> None:
        self.state = "running"
        seconds = self.opened.config.view.seconds
        self._ends_at_s = None if seconds is None else time.monotonic() + seconds
        self._journal.say("running")
        if self._record_as is not None:
            final, self._record_as = self._record_as, None
            try:
                self._begin_recording(final)
            except (recording.RecordingFolderError, ResultsFolderError) as error:
                self._add(problem("recording failed", "error", str(error), "Mend it, then record again"))

    def _end_when_done(self) -> None:
        if self.state not in ("starting", "running"):
            return
        if self._ends_at_s is not None and time.monotonic() >= self._ends_at_s:
            self.stop(ENDS_WITHIN_S)
        elif any(one.state == "stopped" and one.ended is not None for one in self.processes):
            # A recording is over: the worker shows what is left of it, and the bridge has nobody to speak to.
            self.stop(ENDS_WITHIN_S)

    def _give_up(self, process: Supervised) -> None:
        self._add(*process.problems())
        self._journal.say("given up", process=process.name, error=process.last_error)
        self.stop(ENDS_WITHIN_S)

    def stop(self, within_s: float = ENDS_WITHIN_S) -> None:
        """Ends it; its processes have that long before they are ended by force."""
        self.state = "stopping"
        for one in self.processes:
            one.stop(within_s)

    def interrupt(self, within_s: float) -> None:
        """Ends it where nobody stopped it: cut short, if it has an end of its own."""
        config, source = self.opened.config, self.opened.source.info
        endless = config.view.seconds is None and (source.live or config.eyes.source == SIMULATED)
        self._interrupted = self.state in ("starting", "running") and not endless
        self.stop(within_s)

    def record(self, final: Path) -> Reply:
        """Begins to record into that folder, as soon as the worker can.

        Raises RecordingFolderError and ResultsFolderError.
        """
        if self.state not in ("starting", "running"):
            return Reply(False, "the session is about to end: start another one first")
        if self._recorder is not None or self._record_as is not None:
            return Reply(False, f"{(self.folder or self._record_as or final).name} is being recorded: stop that first")
        recording.refuse(final)
        if self.state == "starting":
            self._record_as = final
            return Reply(True, f"recording {final.name} begins as soon as the first frame can be shown")
        self._begin_recording(final)
        return Reply(True, f"recording {final.name}", {"folder": str(self.folder)})

    def _begin_recording(self, final: Path) -> None:
        opened = recording.as_of_now(self.opened, self.worker_status, self.bridge_status)
        self.folder = folder = recording.make(final, opened)
        self.problems = ()
        for poll in self._polls.values():  # what was wrong with the recording before this one
            poll.status = None if poll.status is None else replace(poll.status, problems=())
        self._journal.begin_recording(folder)
        self._recorder = Recorder(self._context, folder, self._controls(self.addresses))
        self._journal.say("recording begins", folder=str(folder), start_ns=self._recorder.start_ns)
        self._note_gaps(self._recorder, folder)
        self._do(lambda: recording.keep_inputs(folder, opened.config), self._add)

    def _note_gaps(self, recorder: Recorder, folder: Path) -> None:
        """In case this host is ended by force; what cannot be written now is told at the end."""
        self._noted = self.gaps
        with contextlib.suppress(OSError):
            recording.note_meanwhile(folder, recorder.start_ns, self._noted)

    def stop_record(self) -> Reply:
        """Ends the recording; its report is written by and by."""
        if self._record_as is not None:
            self._record_as = None
            return Reply(True, "nothing is recorded")
        if self._recorder is None or self.folder is None or self._recorder.is_ending:
            return Reply(False, "nothing is being recorded")
        self._recorder.end()
        final = self.folder.with_name(self.folder.name.removesuffix(recording.PARTIAL))
        return Reply(True, f"the recording ends; its report will be in {final}", {"folder": str(final)})

    def _step_recorder(self) -> None:
        if self._recorder is not None and self.folder is not None:
            if self.gaps != self._noted:
                self._note_gaps(self._recorder, self.folder)
            self._recorder.step()
            self._add(self._recorder.problem)
            self._recorder.problem = None
            if self._recorder.is_over and self.state in ("starting", "running"):
                self._end_recording_now()

    def _end_recording_now(self) -> None:
        """The processes record nothing any more, or are gone: the rest is the host's."""
        if self._recorder is None or self.folder is None:
            return
        recorder, folder = self._recorder, self.folder
        recorder.close()
        self._journal.say("recording ends", folder=str(folder))
        self._journal.end_recording()
        # Why a recording ended by itself is known to the processes alone.
        reported = [poll.status.problems for poll in self._polls.values() if poll.status is not None]
        found = merged(self.problems, *reported)
        try:
            recording.note(folder, recorder.start_ns, self.gaps, interrupted=self._interrupted, problems=found)
        except OSError as error:
            what, remedy = (
                f"{folder} cannot be finished: {error.strerror}",
                f"Make room, then `entoptic report {folder}`",
            )
            self._add(problem("recording not finished", "error", what, remedy))
        self._recorder, self.folder, self.finishing = None, None, folder
        self._do(lambda: recording.finish(folder), self._finished)

    def _finished(self, folder: Path) -> None:
        self.last_folder = folder
        self._do(lambda: recording.draw_report(folder), self._drawn)

    def _drawn(self, found: Problem | None) -> None:
        self.finishing = None
        self._add(found)

    def _add(self, *found: Problem | None) -> None:
        self.problems = merged(self.problems, (one for one in found if one is not None))

    def _do(self, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        self._jobs.append((self._work.submit(work), then))

    def _finish_jobs(self) -> None:
        while self._jobs and self._jobs[0][0].done():
            future, then = self._jobs.pop(0)
            error = future.exception()
            if error is None:
                then(future.result())
            else:
                self.finishing = None
                self._add(problem("recording not finished", "error", str(error), "Mend it, then finish it again"))
                self._journal.say("failed", error=str(error))

    def _poll(self, one: Supervised) -> None:
        poll = self._polls[one.name]
        poll.step()
        if not one.is_ready:
            poll.excuse()

    @property
    def bridge_status(self) -> BridgeStatus | None:
        """As it said last; None where it does not answer."""
        status = self._polls[BRIDGE].status
        return status if isinstance(status, BridgeStatus) and not self._polls[BRIDGE].is_silent else None

    @property
    def worker_status(self) -> WorkerStatus | None:
        """The same of the worker."""
        status = self._polls[WORKER].status
        return status if isinstance(status, WorkerStatus) and not self._polls[WORKER].is_silent else None

    def all_problems(self) -> tuple[Problem, ...]:
        """Its own, and those of its processes."""
        silent = [
            problem(
                f"{one.name} silent",
                "error",
                f"The {one.name} has not answered for {self._polls[one.name].silent_s:.0f} s",
                "Stop the session and start it again",
            )
            for one in self.processes
            if one.is_ready and self._polls[one.name].is_silent
        ]
        reported = [status.problems for status in (self.bridge_status, self.worker_status) if status is not None]
        return merged(self.problems, silent, *reported, *(one.problems() for one in self.processes))

    @staticmethod
    def _controls(at: Addresses) -> dict[str, str]:
        return {BRIDGE: at.bridge, WORKER: at.worker}

    def close(self) -> None:
        """Leaves no process behind, at once."""
        for one in self.processes:
            one.kill()
        for poll in self._polls.values():
            poll.close()
        if self._recorder is not None:
            self._recorder.close()
