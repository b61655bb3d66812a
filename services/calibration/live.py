"""The pupil calibration that a live bridge owns: white and black screens on a display, while the stream goes on.

Theory of operation: the bridge gives `step` every item of its source, before the chain, so that what is measured is the
tracker's own whatever pupil map is in use. Between `begin` and the end of the run the items step it
(run.py); then another process works it out (outcome.py), and the step that finds it done
returns the new map, once. Simulated eyes see the screens from the first one to the end of the run, the scene otherwise:
whoever knows the scene's light says it to `scene_light`, at all times.
"""

from __future__ import annotations

import itertools
import time
from pathlib import Path
from typing import Any, Final

import msgspec
import zmq

from entoptic.services.calibration import run as calibrate
from entoptic.services.calibration.display import SocketDisplay
from entoptic.services.calibration.outcome import Concluding, Job, Named, Outcome
from entoptic.services.calibration.result import refuse_unwritable
from entoptic.services.calibration.run import CalibrationRun, Lit, Room
from entoptic.services.ipc.client import Reply
from entoptic.services.ipc.requests import CalibratePupils
from entoptic.tracker_bridge.access import ServerKeys
from entoptic.tracker_bridge.calibration import CalibrationError, Stage
from entoptic.tracker_bridge.calibration_quality import REMEDIES, Failure
from entoptic.tracker_bridge.pupil_map import PupilMap, PupilMapError
from entoptic.tracker_bridge.samples import NS_PER_S
from entoptic.tracker_bridge.source import Item

WORKING_OUT: Final = "working it out"
"""The stage after the screens."""
_IDLE_WORDS = "Connected. A calibration is begun from the console; this page then follows."
_BEGIN_WORDS = "Press Start when you sit well."
_ABORTED_WORDS = "Stopped. Nothing was changed."


class PupilCalibration:
    """One display, and one run at a time. All methods are for the bridge's thread.

    Raises PortInUseError, and OpenAddressError for an address that is not local unless there are keys.
    """

    def __init__(
        self,
        screens: str,
        answers: str,
        source: str,
        *,
        keys: ServerKeys | None = None,
        context: zmq.Context[zmq.Socket[bytes]] | None = None,
        eyes: Lit | None = None,
        scene_cd_m2: float = 10.0,
    ) -> None:
        """`screens`: where they are asked for; `answers`: where displays answer. `source`: its name.

        With keys `context` is the publisher's, whose authenticator lets in whom it knows. `eyes`: simulated ones that
        answer to light, and `scene_cd_m2` what they see until `scene_light` says otherwise.
        """
        self._display = SocketDisplay(screens, answers, "page in a browser", keys=keys, context=context)
        self._display.tell(_IDLE_WORDS, again=False)
        self._source = source
        self._room = Room(self._display, eyes)
        self._scene_cd_m2 = scene_cd_m2
        # Never those of a bridge that ran before this one: a page may still show its last screen.
        self._ids = itertools.count(time.monotonic_ns() // 1_000_000)
        self._request: CalibratePupils | None = None
        self._run: CalibrationRun | None = None
        self._concluding: Concluding | None = None
        self._begun_ns = 0
        self._result: dict[str, Any] | None = None
        self._last_status: dict[str, Any] = {}

    @property
    def addresses(self) -> tuple[str, str]:
        """Where screens are asked for, and where displays answer."""
        return self._display.commands_address, self._display.answers_address

    def begin(self, request: CalibratePupils) -> Reply:
        """Waits for Start on the display."""
        if self._run is not None or self._concluding is not None:
            return Reply(False, "a pupil calibration runs already: wait for its end, or stop it")
        try:
            refuse_unwritable(Path(request.out))
            protocol = calibrate.protocol_of(request.protocol, request.white_s, request.black_s)
        except (PupilMapError, CalibrationError) as error:
            return Reply(False, str(error))
        self._display.answers(0)  # what was said while nothing ran means nothing now
        self._run = CalibrationRun(protocol, self._room, calibrate.eyes_of(request.eyes), self._ids)
        self._request, self._result, self._begun_ns = request, None, time.monotonic_ns()
        self._display.tell(_BEGIN_WORDS, again=True)
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
            self._run.step(item, time.monotonic_ns())
            if self._run.is_over:
                self._end_run()
        elif self._concluding is not None and (outcome := self._concluding.outcome) is not None:
            self._concluding = None
            return self._take(outcome)
        return None

    def scene_light(self, luminance_cd_m2: float, t_ns: int) -> None:
        """What simulated eyes see of the scene from a time on, while they do not see the screens."""
        self._scene_cd_m2 = luminance_cd_m2
        if self._room.eyes is not None and not self.before_screens:
            self._room.eyes.set_luminance(luminance_cd_m2, t_ns)

    @property
    def before_screens(self) -> bool:
        """Whether the eyes look at the screens instead of the scene."""
        return self._run is not None and self._run.stage is not Stage.READY

    def status(self) -> dict[str, Any] | None:
        """How far it is; None while none runs. `display`: whether one is connected."""
        run = self._run
        if run is None:
            return None if self._concluding is None else {**self._last_status, "stage": WORKING_OUT}
        return {
            "stage": run.stage.value,
            "screen": run.screen.value,
            "step": run.step_number,
            "steps": len(run.protocol.steps),
            "seconds_done": run.seconds_done(time.monotonic_ns()),
            "seconds": run.protocol.seconds,
            "display": self._display.connected,
        }

    def result(self) -> dict[str, Any] | None:
        """What came of the last one; None before there was one, and while one runs."""
        return self._result

    def close(self) -> None:
        """Leaves no process behind; a run without an outcome is lost."""
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
        self.scene_light(self._scene_cd_m2, time.monotonic_ns())
        if run.stage is Stage.ABORTED:
            stopped = Named(Failure.ABORTED, "the run was stopped before its end", REMEDIES[Failure.ABORTED])
            self._take(Outcome(None, None, {}, (stopped,), _ABORTED_WORDS))
            return
        display = self._display
        job = Job(
            run.recorded(), request.out, self._source, display.name, display.uncertainty_ns, map_mm=request.map_mm
        )
        self._concluding = Concluding(job)

    def _take(self, outcome: Outcome) -> PupilMap | None:
        now_ns = time.monotonic_ns()
        ok = outcome.found is not None
        self._result = {
            "ok": ok,
            "out": self._request.out if ok and self._request is not None else None,
            "plot": outcome.plot,
            "eyes": msgspec.to_builtins(outcome.eyes),
            "problems": [msgspec.to_builtins(problem) for problem in outcome.problems],
            "seconds": (now_ns - self._begun_ns) / NS_PER_S,
            "finished_at_ns": now_ns,
        }
        self._display.tell(outcome.words, again=False)
        return outcome.found
