"""A recording, from the worker's side: begun and ended at any time, and ended by itself where the disk is full."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import structlog

from entoptic.errors import EntopticError
from entoptic.services.config import Save
from entoptic.services.ipc.messages import LatencyMs
from entoptic.services.ipc.status import Problem, unwritable
from entoptic.services.rendering import Rendered
from entoptic.services.results.finish import write_summary
from entoptic.services.results.frames import Results
from entoptic.services.results.render_log import FILE as RENDER_LOG
from entoptic.services.results.render_log import Begun, FrameRecord
from entoptic.services.results.tally import Reception, WorkerSummary
from entoptic.services.settings import Settings

UNWRITABLE = (OSError, EntopticError)


class WorkerRecording:
    """What is kept of a live session at present: nothing, or a recording. Nothing is raised but by `begin`."""

    def __init__(self, log: structlog.typing.FilteringBoundLogger) -> None:
        self._log = log
        self._results: Results | None = None
        self._reception_before = Reception(0, 0, 0, 0, {})
        self._goes_on = False
        self.start_ns = 0
        self.folder: str | None = None
        self.problem: Problem | None = None
        """Why the last recording ended before it was asked to."""

    def begin(self, folder: str, start_ns: int, begun: Begun, save: frozenset[Save], reception: Reception) -> None:
        """Raises OSError or an EntopticError where nothing can be kept there."""
        # What a worker before this one heard went with it: then nothing is known of all of the recording.
        self._goes_on = (Path(folder) / RENDER_LOG).exists()
        self._results = Results(Path(folder), begun, save)
        self.folder, self.start_ns, self.problem, self._reception_before = folder, start_ns, None, reception
        self._log.info("recording begins", folder=folder)

    @property
    def runs(self) -> bool:
        """Whether one is running."""
        return self._results is not None

    def perceive(self, perception: Settings) -> None:
        """Settings change, from the next frame on."""
        if self._results is not None:
            with self._ended_by_problem():
                self._results.perceive(perception)

    def add(self, rendered: Rendered, record: FrameRecord) -> None:
        """Keeps a frame."""
        if self._results is not None:
            with self._ended_by_problem():
                self._results.add(rendered, record)

    def note(self, rendered: Rendered, latency: LatencyMs | None) -> None:
        """Keeps its row."""
        if self._results is not None:
            with self._ended_by_problem():
                self._results.note(rendered, latency)

    def check(self) -> None:
        """Looks whether the files are still there; now and then."""
        if self._results is not None:
            with self._ended_by_problem():
                self._results.check()

    def end(self, reception: Reception, warm_up_s: float | None) -> WorkerSummary | None:
        """Makes all files whole; what is in them. None where nothing was recorded or the summary cannot be written."""
        results, self._results = self._results, None
        if results is None:
            return None
        known = None if self._goes_on else _since(self._reception_before, reception)
        summary = results.summary(known, warm_up_s)
        try:
            with results:
                pass
            write_summary(summary, results.folder)
        except UNWRITABLE as error:
            self._failed(error)
            return None
        self._log.info("recording ended", folder=self.folder, frames=summary.frames)
        self.folder = None
        return summary

    @contextlib.contextmanager
    def _ended_by_problem(self) -> Iterator[None]:
        try:
            yield
        except UNWRITABLE as error:
            results, self._results = self._results, None
            assert results is not None
            with contextlib.suppress(*UNWRITABLE), results:
                pass
            self._failed(error)

    def _failed(self, error: Exception) -> None:
        self.problem = unwritable(self.folder or "", error)
        self._log.error("recording failed", folder=self.folder, error=str(self.problem))
        self.folder = None


def _since(before: Reception, now: Reception) -> Reception:
    refused = {name: count - before.messages_refused.get(name, 0) for name, count in now.messages_refused.items()}
    return Reception(
        now.states_received - before.states_received,
        now.states_skipped - before.states_skipped,
        now.event_gaps - before.event_gaps,
        now.events_lost - before.events_lost,
        {name: count for name, count in refused.items() if count},
    )
