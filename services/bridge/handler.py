"""Handles a live bridge's requests: records, calibrates pupils, lights simulated eyes."""

from __future__ import annotations

import collections
import contextlib
import itertools
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import structlog

from entoptic.services.bridge.recording import BridgeRecording
from entoptic.services.bridge.scene_light import SceneLight
from entoptic.services.bridge.tracker_tasks import do_task
from entoptic.services.calibration.pupil_calibration import PupilCalibration
from entoptic.services.ipc.client import Reply
from entoptic.services.ipc.requests import (
    BridgeRequest,
    CalibratePupils,
    GiveStatus,
    StartRecording,
    StopCalibratingPupils,
    StopRecording,
)
from entoptic.services.ipc.status import BridgeStatus, Problem, problem, unwritable
from entoptic.tracker_bridge.chain import Chain
from entoptic.tracker_bridge.events import Event, SourceBack, SourceSilent
from entoptic.tracker_bridge.publisher import Publisher
from entoptic.tracker_bridge.samples import EyeState
from entoptic.tracker_bridge.source import Item, Source, SourceError, Tick
from entoptic.tracker_bridge.sources.simulated.live import LiveEyes

RATE_S = 2.0
"""The rate of states is that of so long."""
FASTEST_HZ = 2000


class BridgeHandler:
    """Give it each item, each record, and each request; all methods are for the bridge's thread."""

    def __init__(
        self,
        source: Source,
        chain: Chain,
        publisher: Publisher,
        log: structlog.typing.FilteringBoundLogger,
        *,
        in_session: bool,
        pupil_map: Path | None = None,
    ) -> None:
        """`in_session`: it is a part of a live session, which alone records. `pupil_map`: what is in use."""
        self._source, self._chain, self._publisher, self._log = source, chain, publisher, log
        self._in_session = in_session
        self._eyes = source if isinstance(source, LiveEyes) else None
        self._pupil_map = pupil_map
        self.calibration: PupilCalibration | None = None
        self.light: SceneLight | None = None
        self._recording: BridgeRecording | None = None
        self._before = (0, 0)
        """Stalls and late samples when the recording began."""
        self._problem: Problem | None = None
        self._silent: str | None = None
        self._newest: EyeState | None = None
        self._states = 0
        self._published_s: collections.deque[float] = collections.deque(maxlen=round(RATE_S * FASTEST_HZ))

    def item(self, item: Item) -> None:
        """What the source yielded, before the chain has it."""
        self._keep(lambda recording: recording.item(item))
        if self.calibration is not None and (found := self.calibration.step(item)) is not None:
            self._chain.use(found)
            out = (self.calibration.result() or {}).get("out")
            self._pupil_map = None if out is None else Path(out)
            self._log.info("pupil map", file=out)
        if self.light is not None and isinstance(item, Tick) and (light := self.light.newest()) is not None:
            self.set_scene_light(light)

    def set_scene_light(self, luminance_cd_m2: float) -> None:
        """The scene's light from now on."""
        if self.calibration is not None:
            self.calibration.scene_light(luminance_cd_m2, time.monotonic_ns())
        elif self._eyes is not None:
            self._eyes.set_luminance(luminance_cd_m2, time.monotonic_ns())

    def record(self, record: EyeState | Event) -> None:
        """What is published."""
        if isinstance(record, EyeState):
            self._states += 1
            self._newest = record
            self._published_s.append(time.monotonic())
        elif isinstance(record, SourceSilent):
            self._silent = record.reason
        elif isinstance(record, SourceBack):
            self._silent = None
        self._keep(lambda recording: recording.record(record))

    def answer(self, request: BridgeRequest) -> Reply:
        """Does it, or says why not."""
        match request:
            case GiveStatus():
                return Reply(True, "the bridge runs", self.status())
            case StartRecording(folder, start_ns):
                return self._begin(Path(folder), start_ns)
            case StopRecording():
                return self._end()
            case CalibratePupils() | StopCalibratingPupils():
                if self.calibration is None:
                    return Reply(
                        False, "this bridge asks no display for screens: start it with --screens and --answers"
                    )
                if isinstance(request, CalibratePupils):
                    return self.calibration.begin(request)
                return self.calibration.stop()
            case _:
                return do_task(self._source, request)

    def close(self) -> None:
        """Ends what is under way, with its files whole."""
        if self._recording is not None:
            self._end()
        if self.calibration is not None:
            self.calibration.close()
        if self.light is not None:
            self.light.close()

    def status(self) -> BridgeStatus:
        """As of now."""
        now_s = time.monotonic()
        lately = sum(1 for _ in itertools.takewhile(lambda at_s: now_s - at_s <= RATE_S, reversed(self._published_s)))
        uncertainty_ns = None if self._newest is None else self._newest.clock_uncertainty_ns
        calibration = self.calibration
        return BridgeStatus(
            source=self._source.info.name,
            states=self._states,
            rate_hz=lately / RATE_S,
            late_samples=self._chain.late_count,
            stalls=self._publisher.stalls,
            clock_uncertainty_ms=None if uncertainty_ns is None else uncertainty_ns * 1e-6,
            recording=None if self._recording is None else str(self._recording.folder),
            calibrating=None if calibration is None else calibration.status(),
            calibrated=None if calibration is None else calibration.result(),
            pupil_map=None if self._pupil_map is None else str(self._pupil_map),
            readers=self._publisher.readers,
            problems=tuple(self._problems()),
        )

    def _problems(self) -> Iterator[Problem]:
        if self._silent is not None:
            yield problem(
                "no tracker",
                "error",
                f"Nothing comes from the tracker: {self._silent}",
                "Check that it is plugged in and its program runs; the session goes on as soon as it is back",
            )
        if self._problem is not None:
            yield self._problem

    def _begin(self, folder: Path, start_ns: int) -> Reply:
        if not self._in_session:
            return Reply(False, "this bridge does not record: start it with --live")
        if self._recording is not None:
            if (self._recording.folder, self._recording.start_ns) == (folder, start_ns):
                return Reply(True, f"{folder} is being recorded already")
            return Reply(False, f"{self._recording.folder} is being recorded: end it first")
        if not folder.is_dir():
            return Reply(False, f"{folder} is no folder that is there: make it first")
        try:
            self._recording = BridgeRecording(folder, start_ns)
        except (OSError, ValueError, SourceError) as error:
            self._problem = unwritable(folder, error)
            return Reply(False, str(self._problem))
        self._before = (self._publisher.stalls, self._chain.late_count)
        self._problem = None
        self._log.info("recording begun", folder=str(folder))
        return Reply(True, f"recording in {folder}")

    def _end(self) -> Reply:
        recording, self._recording = self._recording, None
        if recording is None:
            return Reply(False, str(self._problem or "nothing is being recorded: begin first"))
        try:
            self._finish(recording, None)
        except (OSError, SourceError) as error:
            self._failed(recording, error)
            return Reply(False, str(self._problem))
        self._log.info("recording ended", folder=str(recording.folder))
        return Reply(True, f"{recording.folder} is whole")

    def _finish(self, recording: BridgeRecording, found: Problem | None) -> None:
        stalls, late = self._before
        recording.end(self._source.info.name, self._publisher.stalls - stalls, self._chain.late_count - late, found)

    def _keep(self, write: Callable[[BridgeRecording], None]) -> None:
        """Publishing goes on whatever becomes of the disk."""
        if (recording := self._recording) is None:
            return
        try:
            write(recording)
        except (OSError, SourceError) as error:
            self._recording = None
            self._failed(recording, error)
            with contextlib.suppress(OSError, SourceError):
                self._finish(recording, self._problem)

    def _failed(self, recording: BridgeRecording, error: Exception) -> None:
        self._problem = unwritable(recording.folder, error)
        self._log.error("recording failed", error=str(self._problem))
