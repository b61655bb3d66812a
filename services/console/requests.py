"""What a page may ask of the console's server; protocol.py says how it is sent and answered."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

import msgspec

from entoptic.services.session_config import SessionConfig

MAX_REQUEST_BYTES: Final = 65_536
"""A page that sends a longer message is disconnected (close code 1009)."""
ObserverName = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}\Z")]
"""Letters, digits, - and _; 64 at most."""
TakeName = Annotated[str, msgspec.Meta(pattern=r"^([A-Za-z0-9][A-Za-z0-9_-]{0,63})?\Z")]
"""The same, or empty for the time."""


class _Request(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", kw_only=True):
    """Page → server."""

    id: Annotated[int, msgspec.Meta(ge=0, le=2**53)]


class Watch(_Request, frozen=True, tag="watch"):
    """Which pictures this page wants: both until it says otherwise; none while nobody sees the page."""

    perceived: bool = True
    displayed: bool = True


class Start(_Request, frozen=True, tag="start"):
    """A session is to begin, with the settings in force. A running one is to be stopped first. Hosted only."""

    config: SessionConfig


class Stop(_Request, frozen=True, tag="stop"):
    """The session is to end, with its take. Hosted only."""


class Record(_Request, frozen=True, tag="record"):
    """A take is to begin. Hosted only."""

    name: TakeName = ""


class StopRecord(_Request, frozen=True, tag="stop record"):
    """The take is to end. Its report is written while the status says `finishing`. Hosted only."""


class CalibratePupils(_Request, frozen=True, tag="calibrate pupils"):
    """A pupil calibration is to begin: open the page at `hello.screens_url`.

    How it goes is in the status' `calibrating` and `calibrated`.
    """

    name: TakeName = ""
    """Of the pupil map; the time unless given. Reply data: {"pupil_map": path}, for a later SessionConfig."""
    protocol: Literal["robust", "luidolt"] = "robust"
    white_s: Annotated[float, msgspec.Meta(ge=1.0, le=120.0)] | None = None
    black_s: Annotated[float, msgspec.Meta(ge=1.0, le=120.0)] | None = None
    eyes: Literal["both", "left", "right"] = "both"
    map_mm: bool = False
    overwrite: bool = False
    """Whether a valid run may replace a map of that name; unless it is set such a one is refused, with the reply data
    {"exists": true}."""


class StartScreens(_Request, frozen=True, tag="start screens"):
    """The screens of a pupil calibration are to begin, or to go on, as by the button on their own page."""


class StopCalibratingPupils(_Request, frozen=True, tag="stop calibrating pupils"):
    """It is to be broken off."""


class CalibrateGaze(_Request, frozen=True, tag="calibrate gaze"):
    """The tracker is to calibrate gaze, by itself; how it goes comes as marks of `tracker task`."""


class StopCalibratingGaze(_Request, frozen=True, tag="stop calibrating gaze"):
    """It is to be broken off."""


class RecordTracker(_Request, frozen=True, tag="record tracker"):
    """The tracker is to record, by itself."""

    name: str = ""


class StopRecordTracker(_Request, frozen=True, tag="stop record tracker"):
    """Its recording is to end."""


class Perceive(_Request, frozen=True, tag="perceive"):
    """Settings are to be changed, from the next frame on; all pages get the new `settings`."""

    changes: dict[str, Any] = {}
    """By a field's path: {"observer.age_years": 60}. What is not named stays as it is."""
    from_defaults: bool = False
    """Whether all that is not named goes back to its default."""


class SaveObserver(_Request, frozen=True, tag="save observer"):
    """The settings in force are to be kept under a name. Reply data where one is there already and `overwrite` is not
    set: {"exists": true}."""

    name: ObserverName
    overwrite: bool = False


class LoadObserver(_Request, frozen=True, tag="load observer"):
    """Settings kept under a name are to be in force."""

    name: ObserverName


class List(_Request, frozen=True, tag="list"):
    """Reply data: a list of objects, as Listed."""

    what: Literal["observers", "scenes", "sources", "sessions", "pupil maps"]


Request = (
    Watch
    | Start
    | Stop
    | Record
    | StopRecord
    | CalibratePupils
    | StartScreens
    | StopCalibratingPupils
    | CalibrateGaze
    | StopCalibratingGaze
    | RecordTracker
    | StopRecordTracker
    | Perceive
    | SaveObserver
    | LoadObserver
    | List
)


_request: msgspec.json.Decoder[Request] = msgspec.json.Decoder(Request)


class _Numbered(msgspec.Struct, frozen=True):
    id: int | None = None


class RequestError(Exception):
    """A page's message is no request: the message says why."""

    def __init__(self, why: str, re: int | None) -> None:
        super().__init__(why)
        self.re = re
        """Its id, where that could be read."""


def decode_request(text: str | bytes) -> Request:
    """Raises RequestError."""
    try:
        return _request.decode(text)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise RequestError(f"not understood: {error}", _id_of(text)) from None


def _id_of(text: str | bytes) -> int | None:
    try:
        return msgspec.json.decode(text, type=_Numbered).id
    except (msgspec.DecodeError, UnicodeError, RecursionError):
        return None
