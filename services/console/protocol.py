"""Every message between the console's server and a page, over the WebSocket `/live`.

**Server → page, text**: a JSON array of messages, each an object whose `type` says which: `hello`, `fields`,
`settings`, `traces`, `marks`, `shown`, `status`, `reply`, `bye`. A page passes over types and keys that it does not
know. The first array begins with `hello`; then `fields`, `settings` and `status` come without being asked.

**Server → page, binary**: one picture: 1 byte kind (PERCEIVED or DISPLAYED), 4 bytes frame number (unsigned, big
endian), then a JPEG. Only the newest picture is sent; a page that is slow misses pictures. Before a picture comes the
`shown` of its frame, unless the page fell behind.

**Page → server, text**: `{"id": 1, "request": {"do": …}}`, 64 kB at most: `do` says which request of requests.py,
`id` comes back in the reply's `re`. Each request is answered once, in order; what is not understood too.

Times `t_s` are seconds on the server's monotonic clock since `hello`'s zero, the same for all pages; `traces` says what
time it is now. Lengths are in mm, angles in degrees, to the right and up positive. What is not known is null, never 0.
"""

from __future__ import annotations

from typing import Any, Final, Literal

import msgspec

from entoptic.services.ipc.messages import Shown
from entoptic.services.ipc.status import BridgeStatus, HostStatus, Problem, ProcessStatus, WorkerStatus

VERSION: Final = 2
PERCEIVED, DISPLAYED = 1, 2
"""First byte of a picture."""


class _Message(msgspec.Struct, frozen=True, tag_field="type"):
    """Server → page."""


class Hello(_Message, frozen=True, tag="hello"):
    """The first message of every connection."""

    version: int
    """Of this protocol: a page that expects another one reloads itself."""
    program: str
    """The program's version."""
    hosted: bool
    """Whether sessions can be started, stopped and recorded from here; otherwise bridge and worker run by themselves
    and the buttons for that are hidden."""
    screens_url: str | None
    """Where the full-screen page of a pupil calibration is: `/screens/`; null where there is none."""


class Field(msgspec.Struct, frozen=True):
    """One setting as something to move."""

    path: str
    """Where it stands in the settings, like `observer.age_years`."""
    group: str
    """Heading: Observer, Display, Plan, Glare …"""
    label: str
    """For a person, with its unit."""
    kind: Literal["number", "int", "bool", "choice", "choices", "text", "texts"]
    """`choices`: any number of `options`, a list of strings; `texts`: any number of strings."""
    default: Any
    help: str
    """A sentence; may be empty."""
    first: bool = False
    """Whether it belongs to those that are always in sight (LUI 5.2.4); the others may be folded away."""
    low: float | None = None
    high: float | None = None
    """The range, ends included unless `low_open`; null where there is none."""
    low_open: bool = False
    """`low` itself is not allowed."""
    slider: tuple[float, float] | None = None
    """The stretch of the range that is of use, where the range itself is too long for a slider."""
    step: float | None = None
    """A step that suits a slider; the server takes any value in the range."""
    log: bool = False
    """Whether a slider is better logarithmic."""
    optional: bool = False
    """Whether null, for none, is allowed."""
    options: tuple[tuple[str, str], ...] = ()
    """Of a choice: each value, and a sentence on it that may be empty."""
    list: Literal["sources", "scenes", "pupil maps"] | None = None
    """What there is to choose from, of requests.List; another text may be given too."""


class Fields(_Message, frozen=True, tag="fields"):
    """All settings, those to show first first. Once a connection."""

    fields: tuple[Field, ...]
    session: tuple[Field, ...]
    """What a session is made of beside its settings; paths are those of a SessionConfig."""


class SettingsNow(_Message, frozen=True, tag="settings"):
    """The settings in force, all of them: after `hello`, and whenever any page changed one."""

    settings: dict[str, Any]
    """Nested tables as of services.settings.Settings: `settings.observer.age_years`."""
    observer: str | None = None
    """The saved observer that they were loaded from or saved to, while nothing was changed since."""
    because_of: int | None = None
    """In the page that asked, the id of its request; null in all others."""


class EyeTrace(msgspec.Struct, frozen=True):
    """One eye; each list as long as the `t_s` beside it."""

    measured_mm: list[float | None]
    """As the tracker gave it, nonsense included."""
    pupil_diameter_mm: list[float | None]
    """As trusted and filtered."""
    phase: list[str]
    """tracking, closing, blink, opening, dropout or lost: shade what is not `tracking`."""
    openness: list[float | None]
    """0 closed … 1 open."""
    borrowed: list[bool]
    """Whether the diameter is the other eye's."""


class Traces(_Message, frozen=True, tag="traces"):
    """Eye states since the last one, about 25 times a second; empty lists while none come."""

    now_s: float
    """The time now: where a scrolling plot ends."""
    t_s: list[float]
    left: EyeTrace
    right: EyeTrace
    gaze_deg: list[tuple[float, float] | None]
    """Azimuth and elevation of both eyes together."""


class Mark(msgspec.Struct, frozen=True):
    """Something that happened."""

    what: Literal[
        "blink onset",
        "blink",
        "pupil lost",
        "pupil back",
        "saccade",
        "microsaccade",
        "source silent",
        "source back",
        "clock jumped",
        "tracker task",
        "tracker status",
        "stream started",
        "stream ended",
    ]
    """`blink` comes when it is over, after its `blink onset`; dropouts are to be seen in a trace's `phase`."""
    t_s: float
    """When it was, or began."""
    until_s: float | None = None
    """When it ended, of a blink or a saccade."""
    eye: Literal["left", "right"] | None = None
    """None where it is of both, or of none."""
    amplitude_deg: float | None = None
    """Of a saccade."""
    text: str = ""
    """For a person: the tracker's words, a reason."""
    task: str | None = None
    """Of a tracker's task: gaze calibration or recording."""
    outcome: str | None = None
    """Of a tracker's task: started, succeeded, failed or stopped."""


class Marks(_Message, frozen=True, tag="marks"):
    """Events since the last one, each once, in the order in which the bridge told them."""

    marks: list[Mark]


class ShownNow(Shown, frozen=True, tag_field="type", tag="shown"):
    """What was rendered in a frame; with many pages open not of every frame.

    `t_s` is on the pages' clock, and `recording` is a name. A picture holds all eyes' side by side, in
    the order of `eyes`, perhaps scaled down.
    """


class Latency(msgspec.Struct, frozen=True):
    """From a sample to its light, over the frames of the last minute."""

    p50_ms: float
    p95_ms: float
    bin_ms: float
    """Width of a bar of the histogram; the first begins at 0."""
    counts: list[int]
    """Frames in each bar; the last one holds all that took longer."""
    sample_to_state_ms: float
    """Medians of the three parts."""
    state_to_frame_ms: float
    frame_to_sink_ms: float


class StatusNow(_Message, frozen=True, tag="status"):
    """How it goes, twice a second: what the processes say of themselves, and what is known here alone."""

    running: bool
    """Whether a session runs."""
    host: HostStatus | None
    """Without bridge and worker, which follow. Null where there is none, or it does not answer; so are these."""
    bridge: BridgeStatus | None
    worker: WorkerStatus | None
    processes: tuple[ProcessStatus, ...]
    recording: str | None
    """Name of the folder that is being written; null while nothing is recorded."""
    recording_s: float | None
    """How long it is by now."""
    finishing: str | None
    """Name of a recording that has ended and whose report is being written; null otherwise."""
    last_recording: str | None
    """Name of the last finished folder; its report is at `/sessions/NAME/report.html`."""
    states_hz: float
    """States that came here in the last two seconds, each second."""
    latency: Latency | None
    pages: int
    """Pages that are open."""
    problems: tuple[Problem, ...]
    """The worst first."""


class Replied(_Message, frozen=True, tag="reply"):
    """The answer to a request."""

    re: int | None
    """The request's id; null where it had none that could be read."""
    done: bool
    reply: str
    """For a person: what was done, or why not and what to do."""
    data: Any = None
    """For the page; see the request."""


class Bye(_Message, frozen=True, tag="bye"):
    """The server closes the connection now."""

    reason: str
    again: bool
    """Whether to try to connect again: the server is being started again, or this page was too slow."""


Message = Hello | Fields | SettingsNow | Traces | Marks | ShownNow | StatusNow | Replied | Bye


class Listed(msgspec.Struct, frozen=True):
    """One thing of a list."""

    value: str
    """What a request names it by: of scenes and sources for a SessionConfig."""
    label: str
    """For a person."""
    when: str | None = None
    """ISO time of its last change."""
    report_url: str | None = None
    """Of sessions: where to look, null while there is none."""
    film_url: str | None = None
    running: bool = False
    """Of sessions: still being written."""


_encoder = msgspec.json.Encoder()


def encode(message: Message) -> bytes:
    """One object, to be put into an array by `together`."""
    return _encoder.encode(message)


def together(messages: list[bytes]) -> str:
    """What is sent as one text."""
    return (b"[" + b",".join(messages) + b"]").decode()


def picture(kind: int, frame: int, jpeg: bytes) -> bytes:
    """What is sent as one binary message."""
    return bytes((kind,)) + (frame & 0xFFFFFFFF).to_bytes(4, "big") + jpeg
