"""Pupil calibrations before one display: of `entoptic calibrate`, and of a live bridge while its stream goes on.

Theory of operation: whoever reads a source gives `step` every item, a bridge before the chain has it, so that what is
measured is the tracker's own whatever pupil map is in use. Between `begin` and the end of a run the items step it
(run.py); then it is judged, written and drawn (outcome.py), and the step that finds this done returns the new map,
once. Simulated eyes see the screens from the first one to the end of the run, the scene otherwise: whoever knows the
scene's light says it to `scene_light`, at all times.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import msgspec

from entoptic.services.calibration.outcome import Concluded, Concluding, Job, Named, Outcome
from entoptic.services.calibration.result import refuse_unwritable
from entoptic.services.calibration.run import CalibrationRun, Room, eyes_of, protocol_of
from entoptic.services.ipc.client import Reply
from entoptic.services.ipc.requests import CalibratePupils
from entoptic.tracker_bridge.calibration import CalibrationError, Stage
from entoptic.tracker_bridge.calibration_quality import REMEDIES, Failure
from entoptic.tracker_bridge.pupil_map import PupilMap, PupilMapError
from entoptic.tracker_bridge.source import Item

WORKING_OUT: Final = "working it out"
"""The stage after the screens."""
_IDLE_WORDS = "Connected. A calibration is begun from the console; this page then follows."
BEGIN_WORDS = "Press Start when you sit well."
_ABORTED_WORDS = "Stopped. Nothing was changed."


class PupilCalibration:
    """One display, and one run at a time. All methods are for the thread that reads the source."""

    def __init__(
        self,
        room: Room,
        source: str,
        *,
        scene_cd_m2: float = 10.0,
        conclude: Callable[[Job], Concluded | Concluding] = Concluding,
        plot_failed: bool = True,
        own_time: bool = False,
    ) -> None:
        """`source`: its name. `scene_cd_m2`: what simulated eyes see until `scene_light` says otherwise.

        `plot_failed`: whether a run without a result leaves its plot. `own_time`: the source's times are not those of
        the monotonic clock, and are the only ones.
        """
        self._room, self._display, self._source = room, room.display, source
        self._display.tell(_IDLE_WORDS, again=False)
        self._scene_cd_m2 = scene_cd_m2
        self._conclude, self._plot_failed, self._own_time = conclude, plot_failed, own_time
        # Never those of a process that ran before this one: a page may still show its last screen.
        self._ids = itertools.count(time.monotonic_ns() // 1_000_000)
        self._now_ns = 0
        self._request: CalibratePupils | None = None
        self._run: CalibrationRun | None = None
        self._concluding: Concluded | Concluding | None = None
        self._last_status: dict[str, Any] = {}
        self.outcome: Outcome | None = None
        """What came of the last one; None before there was one, and while one runs."""

    def begin(self, request: CalibratePupils, words: str = BEGIN_WORDS) -> Reply:
        """Waits for Start on the display, which shows `words`."""
        if self._run is not None or self._concluding is not None:
            return Reply(False, "a pupil calibration runs already: wait for its end, or stop it")
        try:
            refuse_unwritable(Path(request.out))
            protocol = protocol_of(request)
        except (PupilMapError, CalibrationError) as error:
            return Reply(False, str(error))
        self._display.answers(0)  # what was said while nothing ran means nothing now
        self._run = CalibrationRun(protocol, self._room, eyes_of(request), self._ids)
        self._request, self.outcome = request, None
        self._display.tell(words, again=True)
        where = "press Start on the display" if self._display.connected else "open the screens' page on a display"
        return Reply(True, f"calibration begun: {where}")

    def stop(self) -> Reply:
        """Ends the run without a result."""
        if self._run is None:
            what = "no pupil calibration runs" if self._concluding is None else "its screens are over already"
            return Reply(False, f"{what}: there is nothing to stop")
        self._run.abort()
        self._end_run()
        return Reply(True, "calibration stopped: nothing was changed")

    def step(self, item: Item) -> PupilMap | None:
        """For every item of the source. A new map, once, when one was found: to be used from now on."""
        if self._run is not None:
            self._now_ns = item.t_ns if self._own_time else time.monotonic_ns()
            self._run.step(item, self._now_ns)
            if self._run.is_over:
                self._end_run()
        if self._concluding is None or (outcome := self._concluding.outcome) is None:
            return None
        self._concluding = None
        self._end(outcome)
        return outcome.found

    def scene_light(self, luminance_cd_m2: float, t_ns: int) -> None:
        """What simulated eyes see of the scene from a time on, while they do not see the screens."""
        self._scene_cd_m2 = luminance_cd_m2
        before_screens = self._run is not None and self._run.stage is not Stage.READY
        if self._room.eyes is not None and not before_screens:
            self._room.eyes.set_luminance(luminance_cd_m2, t_ns)

    def status(self) -> dict[str, Any] | None:
        """How far it is; None while none runs. `display`: whether one is connected."""
        run = self._run
        if run is None:
            return None if self._concluding is None else {**self._last_status, "stage": WORKING_OUT}
        return {**run.status(self._now_ns), "display": self._display.connected}

    def result(self) -> dict[str, Any] | None:
        """The outcome for a page: what `Outcome` says, `ok`, and the file as `out`."""
        if self.outcome is None or self._request is None:
            return None
        ok = self.outcome.found is not None
        return {
            "ok": ok,
            "out": self._request.out if ok else None,
            "plot": self.outcome.plot,
            "eyes": msgspec.to_builtins(self.outcome.eyes),
            "problems": [msgspec.to_builtins(problem) for problem in self.outcome.problems],
        }

    def close(self) -> None:
        """Leaves no process behind, and closes the display; a run without an outcome is lost."""
        if self._concluding is not None:
            self._concluding.end()
        self._display.close()

    def _end_run(self) -> None:
        """The screens are over: the eyes see the scene again."""
        run, request = self._run, self._request
        if run is None or request is None:
            return
        self._last_status = self.status() or {}
        self._run = None
        self.scene_light(self._scene_cd_m2, self._now_ns)
        if run.stage is Stage.ABORTED:
            stopped = Named(Failure.ABORTED, "the run was stopped before its end", REMEDIES[Failure.ABORTED])
            self._end(Outcome(None, None, {}, (stopped,), _ABORTED_WORDS))
            return
        name, uncertainty_ns = self._display.name, self._display.uncertainty_ns
        recorded, plot_failed = run.recorded(), self._plot_failed
        job = Job(recorded, request.out, self._source, name, uncertainty_ns, request.map_mm, plot_failed)
        self._concluding = self._conclude(job)

    def _end(self, outcome: Outcome) -> None:
        self.outcome = outcome
        self._display.tell(outcome.words, again=False)
