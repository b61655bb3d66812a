"""What a tracker that records and calibrates by itself is told to do, for whoever asks its bridge."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from entoptic.services.ipc.client import Reply
from entoptic.services.ipc.requests import (
    StartCalibration,
    StartTrackerRecording,
    StopCalibration,
    StopTrackerRecording,
    TrackerRequest,
)
from entoptic.tracker_bridge.source import SourceError


@runtime_checkable
class TaskedTracker(Protocol):
    """A source whose tracker records and calibrates by itself."""

    def start_recording(self, name: str = "") -> None:
        """Has it record."""

    def stop_recording(self) -> None:
        """Has it end its recording."""

    def start_calibration(self) -> None:
        """Has it calibrate gaze."""

    def stop_calibration(self) -> None:
        """Has it end its calibration."""


def do_task(source: object, request: TrackerRequest) -> Reply:
    """Tells a source's tracker, and says so. What becomes of it comes as a TrackerTask event."""
    if not isinstance(source, TaskedTracker):
        return Reply(False, "this source neither records nor calibrates by itself: run the bridge on `capture`")
    try:
        match request:
            case StartTrackerRecording(name):
                source.start_recording(name)
            case StopTrackerRecording():
                source.stop_recording()
            case StartCalibration():
                source.start_calibration()
            case StopCalibration():
                source.stop_calibration()
    except SourceError as error:
        return Reply(False, str(error))
    return Reply(True, f"asked to {request.__struct_config__.tag}; the outcome comes as an event")
