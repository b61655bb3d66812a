"""How the processes are, and what is wrong: the record that each answers `status` with (requests.GiveStatus)."""

from __future__ import annotations

import errno
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

import msgspec

from entoptic.services.ipc.addresses import Addresses
from entoptic.services.session_config import SessionConfig
from entoptic.services.settings import Settings

Severity = Literal["error", "warning", "note"]
"""error: it does not work; warning: it works worse; note: nothing is wrong, but good to know."""
_RANK = {"error": 0, "warning": 1, "note": 2}


class Problem(msgspec.Struct, frozen=True):
    """Something that is wrong."""

    code: str
    """Stays the same while it lasts: `no tracker`, `disk full` …"""
    severity: Severity
    what: str
    """A sentence for a person."""
    remedy: str
    """What to do: a sentence."""

    def __str__(self) -> str:
        return f"{self.what} {self.remedy}"


def problem(code: str, severity: Severity, what: str, remedy: str) -> Problem:
    """With both texts made into sentences."""
    return Problem(code, severity, _sentence(what), _sentence(remedy))


def _sentence(text: str) -> str:
    text = text.strip().rstrip(".") + "."
    # A file name stays as it is.
    return text[0].upper() + text[1:] if text.split()[0].isalpha() else text


def merged(*lists: Iterable[Problem]) -> tuple[Problem, ...]:
    """Each once, whoever says it, the worst first."""
    found = dict.fromkeys(one for each in lists for one in each)
    return tuple(sorted(found, key=lambda one: _RANK[one.severity]))


def unwritable(folder: Path | str, error: Exception) -> Problem:
    """Why a recording ended before it was asked to: the same of bridge and worker, whose files lie on one disk."""
    is_full = isinstance(error, OSError) and error.errno == errno.ENOSPC
    why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return problem(
        "disk full" if is_full else "recording failed",
        "error",
        f"The recording in {folder} ended: {why}",
        "What was recorded before is kept. Make room or mend it, then record again",
    )


class Gap(msgspec.Struct, frozen=True):
    """While a process was not there; on the monotonic clock."""

    process: str
    from_ns: int
    to_ns: int | None
    """When it was ready again; None while it is not."""
    why: str

    def since(self, start_ns: int) -> dict[str, object]:
        """As it is told: seconds from a start."""
        return {
            "process": self.process,
            "from_s": round((self.from_ns - start_ns) * 1e-9, 3),
            "to_s": None if self.to_ns is None else round((self.to_ns - start_ns) * 1e-9, 3),
            "why": self.why,
        }


class BridgeStatus(msgspec.Struct, frozen=True, kw_only=True, tag_field="of", tag="bridge"):
    """A bridge."""

    source: str | None = None
    states: int = 0
    rate_hz: float | None = None
    """States in the last two seconds, each second."""
    late_samples: int = 0
    stalls: int = 0
    """How often a reader fell behind by a whole queue."""
    clock_uncertainty_ms: float | None = None
    recording: str | None = None
    """The folder; None while nothing is recorded."""
    calibrating: dict[str, Any] | None = None
    """A pupil calibration that runs: stage, screen, step, steps, seconds_done, seconds."""
    calibrated: dict[str, Any] | None = None
    """The result of the last one (services/calibration/pupil_calibration.py)."""
    pupil_map: str | None = None
    """The file in use."""
    readers: int = 0
    problems: tuple[Problem, ...] = ()


class WorkerStatus(msgspec.Struct, frozen=True, kw_only=True, tag_field="of", tag="worker"):
    """A worker, which owns the settings in force."""

    scene: str | None = None
    frame: int = -1
    """The last one that was rendered."""
    fps: float | None = None
    """Asked for."""
    reached_fps: float | None = None
    scene_ms: float | None = None
    """Median of what making a frame took lately."""
    frame_ms: float | None = None
    """The same of all its work."""
    dropped: int | None = None
    """Frames left out so far."""
    preparing: bool = False
    """Whether there is no frame yet: it still compiles."""
    recording: str | None = None
    viewers: int = 0
    settings: Settings = Settings()
    """In force, or from the next frame on."""
    revision: int = 0
    """Of the settings: grows with each change, also when the worker is started again."""
    problems: tuple[Problem, ...] = ()


class ProcessStatus(msgspec.Struct, frozen=True):
    """A process as its host sees it."""

    name: str
    pid: int | None = None
    state: Literal["starting", "running", "restarting", "stopped", "failed", "silent"] = "starting"
    restarts: int = 0
    last_error: str | None = None


class HostStatus(msgspec.Struct, frozen=True, kw_only=True, tag_field="of", tag="host"):
    """A host, with what it hears of its processes."""

    pid: int = 0
    running: bool = False
    """Whether there is a session."""
    state: str = "idle"
    """Of the session: idle, starting, running, stopping or ended."""
    config: SessionConfig | None = None
    """That the session was started with."""
    started: str | None = None
    """ISO time."""
    recording: str | None = None
    """Folder that is being written."""
    finishing: str | None = None
    """Folder whose report is being written."""
    last_recording: str | None = None
    """The last finished folder."""
    root: str = "."
    """Folder of all recordings."""
    processes: dict[str, ProcessStatus] = {}
    addresses: Addresses | None = None
    """Of the session's processes."""
    console_url: str | None = None
    gaps: tuple[dict[str, Any], ...] = ()
    """When a process was away, in seconds from the session's start."""
    bridge: BridgeStatus | None = None
    worker: WorkerStatus | None = None
    log: str | None = None
    problems: tuple[Problem, ...] = ()
    """Its own, and those of its processes."""


Status = BridgeStatus | WorkerStatus | HostStatus


def status_of(data: Any) -> Status | None:
    """What a process replied to GiveStatus; None where it makes no sense."""
    try:
        status: Status = msgspec.convert(data, Status)
    except msgspec.ValidationError:
        return None
    return status
