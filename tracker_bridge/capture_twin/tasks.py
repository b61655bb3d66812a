"""Gaze calibrations and recordings that clients ask for, with the notifications of Capture 3.6.14.

Their keys are those of a real calibration and a real recording, but for `calibration.failed`, which was only read of.
"""

from __future__ import annotations

import datetime
import itertools
import re
from pathlib import Path
from typing import Any, Final

from entoptic.tracker_bridge.samples import Eye
from entoptic.tracker_bridge.sources.pupil_core.form import Map
from entoptic.tracker_bridge.sources.pupil_core.recorder import PupilRecorder, RecordingError

FIT_S: Final = 5.2
"""How long fitting took on a real HMD calibration; the world process does nothing else meanwhile."""

_POINTS_S: Final = 10.0
"""How long the stand-in shows points that nobody sees before it ends a calibration itself. Engineering choice."""

_ENOUGH_S: Final = 1.0
"""A calibration stopped before has no points to fit. Engineering choice."""

_GAZER: Final = "Gazer3D"

_EYE_CAMERAS: Final = {
    Eye.RIGHT: [[1.0, 0.0, 0.0, 31.5], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 41.88], [0.0, 0.0, 0.0, 1.0]],
    Eye.LEFT: [[-1.0, 0.0, 0.0, -31.5], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 41.88], [0.0, 0.0, 0.0, 1.0]],
}
"""From each eye camera to the scene camera, mm, as form.py puts them."""

_GAZE_DISTANCE_MM: Final = 500.0


def announcement(subject: str, **fields: Any) -> Map:
    """A notification of the program's own, as it sends them."""
    return {**fields, "subject": subject, "topic": f"notify.{subject}"}


def command(subject: str, **fields: Any) -> Map:
    """A notification that asks the program for something; the subject stands first in these."""
    return {"subject": subject, **fields, "topic": f"notify.{subject}"}


class Calibration:
    """A gaze calibration: collecting points, then fitting. Times are s since any start; `pupil_s` is Pupil time."""

    def __init__(self, fit_s: float = FIT_S) -> None:
        self._fit_s = fit_s
        self._started_s: float | None = None
        self._fitted_s: float | None = None
        self._enough = False

    @property
    def is_fitting(self) -> bool:
        """Whether the world process stands still."""
        return self._fitted_s is not None

    def notified(self, subject: str, t_s: float) -> list[Map]:
        """What a notification makes it announce."""
        if subject == "calibration.should_start" and self._started_s is None and not self.is_fitting:
            self._started_s = t_s
            return [command("calibration.started")]
        if subject == "calibration.should_stop" and self._started_s is not None:
            return self._stop(t_s)
        return []

    def tick(self, t_s: float, pupil_s: float) -> list[Map]:
        """What it announces as time goes by."""
        if self._started_s is not None and t_s - self._started_s >= _POINTS_S:
            return self._stop(t_s)
        if self._fitted_s is None or t_s < self._fitted_s:
            return []
        self._fitted_s = None
        about = {"gazer_class_name": _GAZER, "timestamp": pupil_s}
        if not self._enough:
            reason = "Not sufficient reference data available."
            return [announcement("calibration.failed", reason=reason, **about, record=True)]
        result = {"params": _fitted(), "record": True, "version": 2}
        return [
            announcement("calibration.successful", **about, record=True),
            announcement("calibration.result.v2", **about, **result),
        ]

    def _stop(self, t_s: float) -> list[Map]:
        self._enough = self._started_s is not None and t_s - self._started_s >= _ENOUGH_S
        self._started_s = None
        self._fitted_s = t_s + (self._fit_s if self._enough else 0.0)
        return [command("calibration.stopped")]


def _fitted() -> Map:
    right, left = _EYE_CAMERAS[Eye.RIGHT], _EYE_CAMERAS[Eye.LEFT]
    return {
        "left_model": {"eye_camera_to_world_matrix": left, "gaze_distance": _GAZE_DISTANCE_MM},
        "right_model": {"eye_camera_to_world_matrix": right, "gaze_distance": _GAZE_DISTANCE_MM},
        "binocular_model": {"eye_camera_to_world_matrix0": right, "eye_camera_to_world_matrix1": left},
    }


class Recording:
    """A recording of what is published, in a new folder `folder`/SESSION/000, 001, …"""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._recorder: PupilRecorder | None = None

    def notified(self, contents: Map, pupil_s: float) -> list[Map]:
        """What a notification makes it announce. Raises RecordingError where the recording cannot be written."""
        subject = contents["subject"]
        if subject == "recording.should_start" and self._recorder is None:
            name = _session_name(contents.get("session_name"))
            try:
                folder = _free(self._folder / name)
            except OSError as error:
                # Too long for the file system, or in a folder that may not be looked into.
                raise RecordingError(f"{self._folder / name}: {error.strerror}. Choose another name") from None
            self._recorder = PupilRecorder(folder, start_synced_s=pupil_s, name=name)
            about = {"rec_path": self._path(), "session_name": name, "record_eye": False, "compression": True}
            return [command("recording.started", **about, start_time_synced=pupil_s)]
        if subject == "recording.should_stop" and self._recorder is not None:
            path = self._path()
            self.close()
            return [command("recording.stopped", rec_path=path)]
        return []

    def write(self, datum: Map) -> None:
        """Takes a published datum in. Raises RecordingError where it cannot be written; then the recording is over."""
        if self._recorder is None:
            return
        try:
            self._recorder.write(datum["topic"].partition(".")[0], datum)
        except Exception:
            self._recorder = None
            raise

    def close(self) -> None:
        """Ends the recording, if there is one."""
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            recorder.close()

    def _path(self) -> str:
        assert self._recorder is not None
        return f"{self._recorder.folder.resolve().as_posix()}/"


def _session_name(asked: object) -> str:
    """The name asked for, which may be a path, without what would lead out of the folder; the day where none was."""
    parts = re.split(r"[/\\]", asked) if isinstance(asked, str) else []
    named = [name for part in parts if (name := re.sub(r"[^\w -]+", "_", part).strip(" _")[:100])]
    return "/".join(named) or datetime.datetime.now().strftime("%Y_%m_%d")


def _free(session: Path) -> Path:
    """The first number that no recording of the session has."""
    return next(path for number in itertools.count() if not (path := session / f"{number:03}").exists())
