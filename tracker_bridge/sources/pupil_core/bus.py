"""A message off Pupil Capture's data port: to samples, to an event, or to a count. Pure: no sockets, no clock.

A message is a topic and a msgpack map, and raw image data behind them on topics that are not read here. Each message
becomes exactly one thing, by a name that is counted: what it was, that it is not ours, or the error that kept it from
being read. Nothing is raised.

Two datums, 2-D and 3-D, come of one eye image, one message each. The 3-D one counts. A 2-D one counts only for an eye
of which no 3-D datum has come for IMAGES_WITHOUT_3D images, so nothing is ever held back to wait for its fellow.

Versions before 2.0 send one datum an image under `pupil.0`, and gaze under `gaze` or `gaze.2d.0.`; what a datum says
of itself decides, so both are read alike.
"""

from __future__ import annotations

import collections
from collections.abc import Sequence
from typing import Final, TypeVar

import msgspec

from entoptic.tracker_bridge.events import TaskKind, TaskOutcome, TrackerStatus, TrackerTask
from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.pupil_core.datum import (
    SCENE_FOV_DEG,
    PupilDatum,
    base_pupils,
    decode_gaze,
    decode_pupil,
    gaze_samples,
    needs_scene_fov,
    pupil_sample,
)

IMAGES_WITHOUT_3D: Final = 10
"""After so many images with a 2-D datum only, an eye has no 3-D detector. Engineering choice: 50 ms at 200 Hz; a
single 3-D message that the network lost must not let its 2-D fellow through."""

MAX_BYTES: Final = 1_000_000
"""No message that is read is larger. Engineering choice: a gaze datum has 1.5 kB, and a blink, the largest, holds all
pupils of 0.2 s; what is larger is no datum, and is not unpacked."""

_TASKS: Final = {
    "notify.calibration.started": (TaskKind.GAZE_CALIBRATION, TaskOutcome.STARTED),
    "notify.calibration.stopped": (TaskKind.GAZE_CALIBRATION, TaskOutcome.STOPPED),
    "notify.calibration.successful": (TaskKind.GAZE_CALIBRATION, TaskOutcome.SUCCEEDED),
    "notify.calibration.failed": (TaskKind.GAZE_CALIBRATION, TaskOutcome.FAILED),
    # Names of the versions before 1.0.
    "notify.calibration_successful": (TaskKind.GAZE_CALIBRATION, TaskOutcome.SUCCEEDED),
    "notify.calibration_failed": (TaskKind.GAZE_CALIBRATION, TaskOutcome.FAILED),
    "notify.recording.started": (TaskKind.RECORDING, TaskOutcome.STARTED),
    "notify.recording.stopped": (TaskKind.RECORDING, TaskOutcome.STOPPED),
}
_EYE_STARTED: Final = "notify.eye_process.started"
_EYE_STOPPED: Final = "notify.eye_process.stopped"
_REMARKS: Final = ("logging.error", "logging.warning")

_NAMED: Final = (*_TASKS, _EYE_STARTED, _EYE_STOPPED, *_REMARKS)

SUBSCRIPTIONS: Final = tuple(topic.encode() for topic in ("pupil.", "gaze", "blinks", *_NAMED))
"""What to subscribe to: by whole names among the notifications, whose `calibration.setup.v2` has 900 kB."""

PUPIL = "pupil"
SECOND_OF_IMAGE = "second datum of an image"
GAZE = "gaze"
NO_DIRECTION = "gaze without a direction"
BLINK = "Pupil's own blink"
TASK = "calibration or recording"
STATUS = "eye process"
REMARK = "remark"
NOT_OURS = "not ours"


class BusError(SourceError):
    """A message that cannot be read; it is counted under the name of its class."""


class FramesError(BusError):
    """Not one topic and one map."""


class TopicError(BusError):
    """The topic is no text."""


class TooLargeError(BusError):
    """More than MAX_BYTES."""


class DatumError(BusError):
    """A pupil, gaze or blink datum with a missing or wrong field."""


class NotificationError(BusError):
    """A notification or a log record with a missing or wrong field."""


ERRORS: Final = frozenset(error.__name__ for error in BusError.__subclasses__())
"""Under which names a message that cannot be read is counted."""


class _Blink(msgspec.Struct, frozen=True):
    type: str
    confidence: float
    timestamp: float


class _Notification(msgspec.Struct, frozen=True):
    subject: str
    reason: str = ""
    rec_path: str = ""
    eye_id: Eye | None = None


class _LogRecord(msgspec.Struct, frozen=True):
    msg: str
    name: str = ""


_Known = TypeVar("_Known", _Blink, _Notification, _LogRecord)

_blinks = msgspec.msgpack.Decoder(_Blink)
_notifications = msgspec.msgpack.Decoder(_Notification)
_log_records = msgspec.msgpack.Decoder(_LogRecord)


class Read(msgspec.Struct, frozen=True):
    """What one message became."""

    became: str
    """One of this module's names, or the name of an error."""
    samples: tuple[PupilSample | GazeSample, ...] = ()
    """Their times are nanoseconds of PUPIL's clock."""
    event: TrackerTask | TrackerStatus | None = None
    remark: str = ""
    """What Capture logged: why it did not do what it was asked."""


class _OneAnImage:
    """Which datums of one eye are the first of their image."""

    def __init__(self) -> None:
        self._without_3d = 0
        self._last_2d_s: float | None = None

    def takes(self, datum: PupilDatum) -> bool:
        if datum.diameter_3d is not None:
            # Only at the change from 2-D to 3-D has the image's other datum gone out already.
            repeats = datum.timestamp == self._last_2d_s
            self._without_3d, self._last_2d_s = 0, None
            return not repeats
        self._without_3d += 1
        if self._without_3d <= IMAGES_WITHOUT_3D:
            return False
        self._last_2d_s = datum.timestamp
        return True


class PupilBus:
    """Reads messages in order of arrival. Adds no latency: a message's samples are those of the message."""

    def __init__(self) -> None:
        self.counts: collections.Counter[str] = collections.Counter()
        """What the messages became."""
        self._images = {eye: _OneAnImage() for eye in Eye}
        self._own_gaze_ns: dict[Eye, int] = {}
        self._assumed_fov = False

    def read(self, frames: Sequence[bytes], received_ns: int) -> Read:
        """What a message says. Events get the time at which it was received, bridge's clock."""
        try:
            read = self._read(frames, received_ns)
        except BusError as error:
            read = Read(type(error).__name__)
        self.counts[read.became] += 1
        return read

    def _read(self, frames: Sequence[bytes], received_ns: int) -> Read:
        if not frames:
            raise FramesError("no frame at all")
        try:
            topic = bytes(frames[0][:200]).decode()
        except UnicodeDecodeError:
            raise TopicError("the topic is no text") from None
        kind = topic.split(".", 1)[0]
        if kind not in ("pupil", "gaze", "blinks") and topic not in _NAMED:
            return Read(NOT_OURS)
        if len(frames) != 2:
            raise FramesError(f"{topic} has {len(frames)} frames, not 2")
        payload = frames[1]
        if len(payload) > MAX_BYTES:
            raise TooLargeError(f"{topic} has {len(payload):,} bytes")
        try:
            if kind == "pupil":
                return self._pupil(topic, payload)
            if kind == "gaze":
                return self._gaze(payload, received_ns)
            if kind == "blinks":
                _decode(_blinks, payload)
                return Read(BLINK)
        except SourceError as error:
            raise DatumError(f"{topic}: {error}") from None
        return _notice(topic, payload, received_ns)

    def _pupil(self, topic: str, payload: bytes) -> Read:
        datum = decode_pupil(payload)
        eye, *detector = topic.split(".")[1:] or [""]
        if eye != str(datum.id.value):
            raise SourceError(f"a datum of eye {datum.id.value}")
        # Without a detector in its topic, from before 2.0, a datum is the only one of its image.
        if detector and not self._images[datum.id].takes(datum):
            return Read(SECOND_OF_IMAGE)
        return Read(PUPIL, (pupil_sample(datum),))

    def _gaze(self, payload: bytes, received_ns: int) -> Read:
        datum = decode_gaze(payload)
        samples = gaze_samples(datum, base_pupils(datum))
        if not samples:
            return Read(NO_DIRECTION)
        event = None
        if needs_scene_fov(datum) and not self._assumed_fov:
            self._assumed_fov = True
            width, height = SCENE_FOV_DEG
            event = TrackerStatus(
                received_ns,
                True,
                "Gaze comes as places in the scene image only, a field of view of "
                f"{width:g}° by {height:g}° is assumed: choose 3-D gaze mapping in Pupil Capture for true directions",
            )
        # Each eye image goes into two binocular datums: its own direction is news only once.
        return Read(GAZE, (samples[0], *(own for own in samples[1:] if self._is_new(own))), event)

    def _is_new(self, own: GazeSample) -> bool:
        if own.eye is None or self._own_gaze_ns.get(own.eye) == own.t_ns:
            return False
        self._own_gaze_ns[own.eye] = own.t_ns
        return True


def _notice(topic: str, payload: bytes, received_ns: int) -> Read:
    try:
        if topic in _REMARKS:
            record = _decode(_log_records, payload)
            return Read(REMARK, remark=f"{record.name}: {record.msg}" if record.name else record.msg)
        notification = _decode(_notifications, payload)
        if f"notify.{notification.subject}" != topic:
            raise SourceError(f"it says `{notification.subject}` of itself")
    except SourceError as error:
        raise NotificationError(f"{topic}: {error}") from None
    if topic in _TASKS:
        kind, outcome = _TASKS[topic]
        return Read(TASK, event=TrackerTask(received_ns, kind, outcome, notification.reason or notification.rec_path))
    if notification.eye_id is None:
        raise NotificationError(f"{topic}: no eye_id")
    on, eye = topic == _EYE_STARTED, notification.eye_id.name.lower()
    detail = f"Pupil Capture has switched the {eye} eye's camera {'on' if on else 'off'}"
    return Read(STATUS, event=TrackerStatus(received_ns, on, detail))


def _decode(decoder: msgspec.msgpack.Decoder[_Known], payload: bytes) -> _Known:
    try:
        return decoder.decode(payload)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise SourceError(str(error)) from None
