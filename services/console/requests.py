"""What a page may ask of the console's server; protocol.py says how it is sent and answered.

What host and bridge do is passed on to them as it is: services/ipc/requests.py, OfHost and OfBridge here.
"""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal, get_args

import msgspec

from entoptic.services.config import CalibrationConfig
from entoptic.services.ipc.requests import Record, StartSession, StopCalibratingPupils, StopRecord, StopSession
from entoptic.services.ipc.requests import TrackerRequest as TrackerRequest

MAX_REQUEST_BYTES: Final = 65_536
"""A page that sends a longer message is disconnected (close code 1009)."""
ObserverName = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}\Z")]
"""Letters, digits, - and _; 64 at most."""
MapName = Annotated[str, msgspec.Meta(pattern=r"^([A-Za-z0-9][A-Za-z0-9_-]{0,63})?\Z")]
"""The same, or empty for the time."""


class _Request(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", kw_only=True):
    """Of the server itself."""


class Watch(_Request, frozen=True, tag="watch"):
    """Which pictures this page wants: both until it says otherwise; none while nobody sees the page."""

    perceived: bool = True
    displayed: bool = True


class CalibratePupils(CalibrationConfig, frozen=True, tag_field="do", tag="calibrate pupils"):
    """A pupil calibration is to begin: open the page at `hello.screens_url`.

    How it goes is in the bridge's status, `calibrating` and `calibrated`.
    """

    name: MapName = ""
    """Of the pupil map; the time unless given. Reply data: {"pupil_map": path}, for a later SessionConfig."""
    overwrite: bool = False
    """Whether a valid run may replace a map of that name; unless it is set such a one is refused, with the reply data
    {"exists": true}."""


class StartScreens(_Request, frozen=True, tag="start screens"):
    """The screens of a pupil calibration are to begin, or to go on, as by the button on their own page."""


class ChangeSettings(_Request, frozen=True, tag="change settings"):
    """Settings are to be changed, from the next frame on; all pages get the new `settings`."""

    changes: dict[str, Any] = {}
    """By a field's path: {"observer.age_years": 60}. What is not named stays as it is."""
    from_defaults: bool = False
    """Whether all that is not named goes back to its default."""


class SaveObserver(_Request, frozen=True, tag="save observer"):
    """The settings in force are to be saved under a name. Reply data where one is there already and `overwrite` is not
    set: {"exists": true}."""

    name: ObserverName
    overwrite: bool = False


class LoadObserver(_Request, frozen=True, tag="load observer"):
    """Settings saved under a name are to be in force."""

    name: ObserverName


class List(_Request, frozen=True, tag="list"):
    """Reply data: a list of objects, as Listed."""

    what: Literal["observers", "scenes", "sources", "sessions", "pupil maps"]


OfHost = StartSession | StopSession | Record | StopRecord
OfBridge = StopCalibratingPupils | TrackerRequest
OF_HOST = get_args(OfHost)
Request = (
    Watch | CalibratePupils | StartScreens | ChangeSettings | SaveObserver | LoadObserver | List | OfHost | OfBridge
)


class Numbered(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Page → server."""

    id: Annotated[int, msgspec.Meta(ge=0, le=2**53)]
    """Comes back with the reply."""
    request: Request


_request: msgspec.json.Decoder[Numbered] = msgspec.json.Decoder(Numbered)


class _Number(msgspec.Struct, frozen=True):
    id: int | None = None


class RequestError(Exception):
    """A page's message is no request: the message says why."""

    def __init__(self, why: str, re: int | None) -> None:
        super().__init__(why)
        self.re = re
        """Its id, where that could be read."""


def decode_request(text: str | bytes) -> Numbered:
    """Raises RequestError."""
    try:
        return _request.decode(text)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise RequestError(f"not understood: {error}", _id_of(text)) from None


def _id_of(text: str | bytes) -> int | None:
    try:
        return msgspec.json.decode(text, type=_Number).id
    except (msgspec.DecodeError, UnicodeError, RecursionError):
        return None
