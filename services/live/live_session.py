"""A live session: a bridge and a worker that are kept running, and the takes that are kept of them.

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

from entoptic.services import recording as takes
from entoptic.services.ipc.addresses import free_addresses
from entoptic.services.ipc.client import Client, Context, Reply
from entoptic.services.ipc.requests import GiveStatus
from entoptic.services.ipc.status import Gap
from entoptic.services.live.journal import Journal
from entoptic.services.live.kept_take import KeptTake
from entoptic.services.live.supervised import Supervised
from entoptic.services.process_config import BridgeConfig, WorkerLinks
from entoptic.services.results import session_file
from entoptic.services.results.folder import ResultsFolderError
from entoptic.services.session_config import OpenedSession, WorkerConfig
from entoptic.tracker_bridge.sources import SIMULATED

STATUS_EVERY_S: Final = 0.5
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
        """Of the take that runs."""
        self.last_folder: Path | None = None
        self.finishing: Path | None = None
        self.trouble: str | None = None
        """What ended it, or a take, before it was asked to."""
        self.figures: dict[str, dict[str, Any]] = {BRIDGE: {}, WORKER: {}}
        """What each said of itself last."""
        self._interrupted = False
        self._context, self._journal, self._work = context, journal, work
        self._checkpoint = scratch / "worker.checkpoint"
        self._checkpoint.unlink(missing_ok=True)
        self._source_begun_ns: int | None = None
        self._take: KeptTake | None = None
        self._noted: tuple[Gap, ...] = ()
        self._record_as: Path | None = None
        self._jobs: list[tuple[Future[Any], Callable[[Any], None]]] = []
        self._asked: dict[str, Client] = {}
        self._ask_at_s = 0.0
        self._ends_at_s: float | None = None
        self._do(takes.prepare_report, lambda nothing: None)
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
            eyes=replace(eyes, pupil_map=self.figures[BRIDGE].get("pupil_map") or eyes.pupil_map),
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
            if one.step() and self._take is not None:
                self._take.tell(one.name)
            elif not one.lives and self._take is not None:
                self._take.lost(one.name)
            if one.state == "failed" and self.state in ("starting", "running"):
                self._end(f"the {one.name} is given up, since it crashed again and again; {one.last_error}")
        if self.worker.is_ready and self.bridge.state == "stopped" and self.state == "starting":
            self.bridge.start()
        if self.state == "starting" and self.worker.is_ready and self.bridge.is_ready:
            self._begin()
        self._end_when_done()
        self._step_take()
        self._ask_figures()
        self._finish_jobs()
        if self.state == "stopping" and not any(one.lives for one in self.processes):
            self._end_take_now()
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
                self._begin_take(final)
            except (takes.TakeError, ResultsFolderError) as error:
                self.trouble = str(error)

    def _end_when_done(self) -> None:
        if self.state not in ("starting", "running"):
            return
        if self._ends_at_s is not None and time.monotonic() >= self._ends_at_s:
            self.stop(ENDS_WITHIN_S)
        elif any(one.state == "stopped" and one.ended is not None for one in self.processes):
            # A recording is over: the worker shows what is left of it, and the bridge has nobody to speak to.
            self.stop(ENDS_WITHIN_S)

    def _end(self, trouble: str) -> None:
        self.trouble = trouble
        self._journal.say("given up", trouble=trouble)
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
        """Begins a take in that folder, as soon as the worker can. Raises TakeError and ResultsFolderError."""
        if self.state not in ("starting", "running"):
            return Reply(False, "the session is about to end: start another one first")
        if self._take is not None or self._record_as is not None:
            return Reply(False, f"{(self.folder or self._record_as or final).name} is being recorded: stop that first")
        takes.refuse(final)
        if self.state == "starting":
            self._record_as = final
            return Reply(True, f"recording {final.name} begins as soon as the first frame can be shown")
        self._begin_take(final)
        return Reply(True, f"recording {final.name}", {"folder": str(self.folder)})

    def _begin_take(self, final: Path) -> None:
        opened = takes.as_of_now(self.opened, self.figures[WORKER], self.figures[BRIDGE])
        self.folder = takes.make(final, opened)
        self.trouble = None
        for figures in self.figures.values():  # what was wrong with the take before this one
            figures.pop("trouble", None)
        self._journal.begin_take(self.folder)
        controls = {BRIDGE: self.addresses.bridge, WORKER: self.addresses.worker}
        self._take = KeptTake(self._context, self.folder, controls)
        self._journal.say("take begins", folder=str(self.folder), start_ns=self._take.start_ns)
        self._note_gaps(self._take, self.folder)
        self._do(lambda folder=self.folder: takes.keep_inputs(folder, opened.config), self._say_trouble)  # type: ignore[misc]

    def _note_gaps(self, take: KeptTake, folder: Path) -> None:
        """In case this host is ended by force; what cannot be written now is told at the end."""
        self._noted = self.gaps
        with contextlib.suppress(OSError):
            takes.note_meanwhile(folder, take.start_ns, self._noted)

    def stop_record(self) -> Reply:
        """Ends the take; its report is written by and by."""
        if self._record_as is not None:
            self._record_as = None
            return Reply(True, "nothing is recorded")
        if self._take is None or self.folder is None or self._take.is_ending:
            return Reply(False, "nothing is being recorded")
        self._take.end()
        final = self.folder.with_name(self.folder.name.removesuffix(takes.PARTIAL))
        return Reply(True, f"the recording ends; its report will be in {final}", {"folder": str(final)})

    def _step_take(self) -> None:
        if self._take is not None and self.folder is not None:
            if self.gaps != self._noted:
                self._note_gaps(self._take, self.folder)
            self._take.step()
            if self._take.trouble is not None:
                self.trouble, self._take.trouble = self._take.trouble, None
            if self._take.is_over and self.state in ("starting", "running"):
                self._end_take_now()

    def _end_take_now(self) -> None:
        """The processes keep nothing any more, or are gone: the rest is the host's."""
        if self._take is None or self.folder is None:
            return
        take, folder = self._take, self.folder
        take.close()
        self._journal.say("take ends", folder=str(folder))
        self._journal.end_take()
        try:
            takes.note(folder, take.start_ns, self.gaps, interrupted=self._interrupted, trouble=self._all_trouble())
        except OSError as error:
            self.trouble = f"{folder} cannot be finished: {error.strerror}; make room, then `entoptic report {folder}`"
        self._take, self.folder, self.finishing = None, None, folder
        self._do(lambda: takes.finish(folder), self._finished)

    def _all_trouble(self) -> str | None:
        """Its own, and what the processes say: a take that a full disk ended is known to them alone."""
        found: list[str] = []
        for one in (self.trouble, *(figures.get("trouble") for figures in self.figures.values())):
            if one and not any(one in other for other in found):
                found.append(one)
        return "; ".join(found) or None

    def _finished(self, finished: takes.Finished) -> None:
        self.last_folder = finished.folder
        self._do(lambda: takes.draw_report(finished.folder), self._drawn)

    def _drawn(self, trouble: str | None) -> None:
        self.finishing = None
        self._say_trouble(trouble)

    def _say_trouble(self, trouble: str | None) -> None:
        self.trouble = trouble or self.trouble

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
                self._say_trouble(str(error))
                self._journal.say("trouble", error=str(error))

    def _ask_figures(self) -> None:
        due = time.monotonic() >= self._ask_at_s
        if due:
            self._ask_at_s = time.monotonic() + STATUS_EVERY_S
        for one, address in ((self.bridge, self.addresses.bridge), (self.worker, self.addresses.worker)):
            asked = self._asked.get(one.name)
            if asked is not None and (reply := asked.poll()) is not None:
                self.figures[one.name] = reply.data or {}
                self._forget(one.name)
            elif asked is not None and not one.lives:
                self._forget(one.name)
            elif asked is None and due and one.is_ready:
                self._asked[one.name] = Client(address, context=self._context)
                self._asked[one.name].send(GiveStatus())

    def _forget(self, name: str) -> None:
        self._asked.pop(name).close()

    def close(self) -> None:
        """Leaves no process behind, at once."""
        for one in self.processes:
            one.kill()
        for name in tuple(self._asked):
            self._forget(name)
        if self._take is not None:
            self._take.close()
