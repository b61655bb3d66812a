"""What the processes of a live session may be asked to do (services/ipc/client.py).

Each is one msgpack map whose `do` says which; other languages see docs/wire-format.md.
"""

from __future__ import annotations

import msgspec

from entoptic.services.config import CalibrationConfig
from entoptic.services.session_config import SessionConfig
from entoptic.services.settings import Settings


class _Request(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do"):
    """One command."""


class StartTrackerRecording(_Request, frozen=True, tag="start tracker recording"):
    """The tracker is to record, by itself."""

    name: str = ""
    """What the recording is to be called."""


class StopTrackerRecording(_Request, frozen=True, tag="stop tracker recording"):
    """The tracker is to end its recording."""


class StartCalibration(_Request, frozen=True, tag="start calibration"):
    """The tracker is to calibrate gaze, by itself."""


class StopCalibration(_Request, frozen=True, tag="stop calibration"):
    """The tracker is to end its calibration of gaze."""


class CalibratePupils(CalibrationConfig, frozen=True, tag_field="do", tag="calibrate pupils"):
    """White and black screens on the display that follows the bridge's screens (services/calibration/display.py)."""

    out: str
    """The pupil map to write, a .toml file in a folder that is there; from then on the bridge uses it."""


class StopCalibratingPupils(_Request, frozen=True, tag="stop calibrating pupils"):
    """Nothing is changed then."""


class StartRecording(_Request, frozen=True, tag="start recording"):
    """From now on all is recorded in a folder, which is there."""

    folder: str
    start_ns: int
    """Zero of the tables' times, on the monotonic clock; a process that was started again goes on with it."""


class StopRecording(_Request, frozen=True, tag="stop recording"):
    """Nothing is recorded any more; the files are whole when the reply comes."""


class ChangeSettings(_Request, frozen=True, tag="change settings"):
    """Other settings, from the next frame on; the reply's data is their revision."""

    settings: Settings


class GiveStatus(_Request, frozen=True, tag="status"):
    """How it is; the reply's data is the process's record of status.py."""


class StartSession(_Request, frozen=True, tag="start session"):
    """A bridge and a worker are to be started."""

    config: SessionConfig


class StopSession(_Request, frozen=True, tag="stop session"):
    """They are to be ended, with the recording if one is running."""


class Record(_Request, frozen=True, tag="record"):
    """A recording is to begin, in a folder of its own."""

    name: str = ""
    """Of the folder; the time unless given."""


class StopRecord(_Request, frozen=True, tag="stop record"):
    """The recording is to end; the report is written."""


TrackerRequest = StartTrackerRecording | StopTrackerRecording | StartCalibration | StopCalibration
BridgeRequest = TrackerRequest | CalibratePupils | StopCalibratingPupils | StartRecording | StopRecording | GiveStatus
WorkerRequest = ChangeSettings | StartRecording | StopRecording | GiveStatus
HostRequest = StartSession | StopSession | Record | StopRecord | GiveStatus
