"""What the processes of a live session may be asked to do (services/ipc/client.py).

Each is one msgpack map whose `do` says which; other languages see docs/wire-format.md.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec

from entoptic.services.session_config import SessionConfig


class _Request(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do"):
    """One wish."""


class StartRecording(_Request, frozen=True, tag="start recording"):
    """The tracker is to record, by itself."""

    name: str = ""
    """What the recording is to be called."""


class StopRecording(_Request, frozen=True, tag="stop recording"):
    """The tracker is to end its recording."""


class StartCalibration(_Request, frozen=True, tag="start calibration"):
    """The tracker is to calibrate gaze, by itself."""


class StopCalibration(_Request, frozen=True, tag="stop calibration"):
    """The tracker is to end its calibration of gaze."""


class CalibratePupils(_Request, frozen=True, tag="calibrate pupils"):
    """White and black screens on the display that follows the bridge's screens (services/calibration/display.py)."""

    out: str
    """The pupil map to write, a .toml file in a folder that is there; from then on the bridge uses it."""
    protocol: Literal["robust", "luidolt"] = "robust"
    white_s: Annotated[float, msgspec.Meta(ge=1.0, le=120.0)] | None = None
    black_s: Annotated[float, msgspec.Meta(ge=1.0, le=120.0)] | None = None
    eyes: Literal["both", "left", "right"] = "both"
    map_mm: bool = False
    """Maps a tracker's millimetres onto 2–8 mm too."""


class StopCalibratingPupils(_Request, frozen=True, tag="stop calibrating pupils"):
    """Nothing is changed then."""


class BeginTake(_Request, frozen=True, tag="begin take"):
    """From now on all is kept in a folder, which is there."""

    folder: str
    start_ns: int
    """Zero of the tables' times, on the monotonic clock; later begins with the same go on where a crash broke off."""


class EndTake(_Request, frozen=True, tag="end take"):
    """Nothing is kept any more; the files are whole when the answer comes."""


class Perceive(_Request, frozen=True, tag="perceive"):
    """Other settings, from the next frame on."""

    settings: dict[str, Any]
    """All of services.settings.Settings, as built-in types."""


class GiveStatus(_Request, frozen=True, tag="status"):
    """How it goes; the reply's data are the process's figures."""


class StartSession(_Request, frozen=True, tag="start session"):
    """A bridge and a worker are to be started."""

    config: SessionConfig


class StopSession(_Request, frozen=True, tag="stop session"):
    """They are to be ended, with the take if one is running."""


class Record(_Request, frozen=True, tag="record"):
    """A take is to begin, in a folder of its own."""

    name: str = ""
    """Of the folder; the time unless given."""


class StopRecord(_Request, frozen=True, tag="stop record"):
    """The take is to end; the report is written."""


TrackerRequest = StartRecording | StopRecording | StartCalibration | StopCalibration
BridgeRequest = TrackerRequest | CalibratePupils | StopCalibratingPupils | BeginTake | EndTake | GiveStatus
WorkerRequest = Perceive | BeginTake | EndTake | GiveStatus
HostRequest = StartSession | StopSession | Record | StopRecord | GiveStatus
