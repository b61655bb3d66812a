"""A folder of frames when all is over: one film of its parts, and its figures, whatever became of the worker."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from pipeline.frame import FrameError
from pipeline.sinks.video_parts import join
from services.results.frames import film_parts
from services.results.moments import FILE as MOMENTS
from services.results.moments import Moment, Moments, MomentsError, Perceive, Resumed
from services.results.tally import PLAN, Tally, WorkerSummary

FILM = "perceived.mp4"
SUMMARY, BRIDGE = "worker.json", "bridge.json"


def write_summary(summary: WorkerSummary, folder: Path) -> None:
    """Writes what a worker did into its folder, whole or not at all. Raises OSError."""
    new = folder / f".{SUMMARY}.new"
    new.write_bytes(msgspec.json.format(msgspec.json.encode(summary), indent=2) + b"\n")
    new.replace(folder / SUMMARY)


def finish(folder: Path) -> dict[str, Any]:
    """Makes a take's folder whole, and says what a summary needs of its frames; raises nothing.

    worker: what the worker did (WorkerSummary), from the tables where its own last word is missing
    bridge: what the bridge said at its end, None where that is missing
    film: name of the film, None without one
    settings_changed_s: when settings changed, in the tables' time
    restarted_s: when a worker that was started anew rendered its first frame
    folder_notes: what could not be had, a sentence each
    """
    notes: list[str] = []
    film = _join(folder, notes)
    changed_s: list[float] = []
    restarted_s: list[float] = []
    digest = ""
    fps = 1.0
    try:
        moments = Moments(folder / MOMENTS)
        fps, zero_s, resumed = moments.begun.fps, moments.begun.zero_s, False
        shown = present = moments.begun.perception
        for record in moments:
            match record:
                case Perceive():
                    present = record.perception
                case Resumed():
                    zero_s, present, resumed = record.zero_s, record.perception, True
                case Moment():
                    changed_s += [record.t_s - zero_s] if present != shown else []
                    restarted_s += [record.t_s - zero_s] if resumed else []
                    shown, resumed = present, False
                    digest = record.sha256.hex()
        notes += [] if moments.note is None else [moments.note]
    except MomentsError as error:
        notes.append(f"{error}.")
    return {
        "worker": msgspec.to_builtins(_worker(folder, fps, digest, notes)),
        "bridge": _bridge(folder, notes),
        "film": film,
        "settings_changed_s": [round(t_s, 3) for t_s in changed_s],
        "restarted_s": [round(t_s, 3) for t_s in restarted_s],
        "folder_notes": notes,
    }


def _join(folder: Path, notes: list[str]) -> str | None:
    """One film of all parts, which then go, but for those that do not fit in."""
    parts = film_parts(folder)
    if parts:
        try:
            left_over = join(parts, folder / FILM)
            notes += [note for _, note in left_over]
            apart = {path for path, _ in left_over}
            for part in parts:
                if part not in apart:
                    part.unlink(missing_ok=True)
        except (FrameError, OSError) as error:
            notes.append(f"The film stays in parts: {error}.")
    return FILM if (folder / FILM).exists() else None


def _bridge(folder: Path, notes: list[str]) -> dict[str, Any] | None:
    try:
        return msgspec.json.decode((folder / BRIDGE).read_bytes(), type=dict[str, Any])
    except (OSError, msgspec.DecodeError, UnicodeDecodeError):
        notes.append("The bridge's last word is missing.")
        return None


def _worker(folder: Path, fps: float, digest: str, notes: list[str]) -> WorkerSummary:
    try:
        return msgspec.json.decode((folder / SUMMARY).read_bytes(), type=WorkerSummary)
    except FileNotFoundError:
        notes.append("The worker's last word is missing: figures are those of its tables.")
    except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
        notes.append(f"{SUMMARY} cannot be read ({error}): figures are those of the tables.")
    try:
        tally = Tally.read(folder / PLAN, fps)
    except (OSError, UnicodeDecodeError) as error:
        notes.append(f"{PLAN} cannot be read: {error}.")
        tally = Tally(fps)
    return tally.summary(None, digest, None)
