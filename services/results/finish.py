"""A folder of frames when all is over: one film of its parts, and its figures, whatever became of the worker."""

from __future__ import annotations

import array
from pathlib import Path
from typing import Any

import msgspec

from entoptic.atomic_file import write_json
from entoptic.errors import OutputError
from entoptic.pipeline.frame import FrameError
from entoptic.pipeline.sinks.video_parts import begins_s, join
from entoptic.services.results.folder import BRIDGE, WORKER
from entoptic.services.results.frames import film_parts
from entoptic.services.results.render_log import FILE as RENDER_LOG
from entoptic.services.results.render_log import FrameRecord, Perceive, RenderLog, RenderLogError, Resumed
from entoptic.services.results.tally import PLAN, Tally, WorkerSummary, dropped_of

FILM = "perceived.mp4"
APART = "perceived_apart-"
"""What a part that does not fit into the film is called then, with its number."""


def write_summary(summary: WorkerSummary, folder: Path) -> None:
    """Writes what a worker did into its folder, whole or not at all. Raises OSError."""
    write_json(folder / WORKER, summary)


def finish(folder: Path) -> dict[str, Any]:
    """Makes a take's folder whole, and says what a summary needs of its frames; raises nothing. It can be done again.

    worker: what the worker did (WorkerSummary), from the tables where its own last word is missing; its frames are
        those of the render log, which are written before a frame's row
    bridge: what the bridge said at its end, None where that is missing
    perception: settings of the first frame; missing where it cannot be read
    film: name of the film, None without one
    film_begins_s: when its first frame was due, in the tables' time
    settings_changed_s: when settings changed, in the tables' time
    restarted_s: when a worker that was started again rendered its first frame
    folder_notes: what could not be had, a sentence each
    """
    notes: list[str] = []
    film = _join(folder, notes)
    done: dict[str, Any] = {
        "film": film,
        "film_begins_s": None if film is None else begins_s(folder / FILM),
        "bridge": _bridge(folder, notes),
    }
    seen = None
    try:
        render_log = RenderLog(folder / RENDER_LOG)
        seen = _Seen(render_log)
        done["perception"] = msgspec.to_builtins(render_log.begun.perception)
        notes += [] if render_log.note is None else [render_log.note]
    except RenderLogError as error:
        notes.append(f"{error}.")
    return {
        **done,
        "worker": msgspec.to_builtins(_worker(folder, seen, notes)),
        "settings_changed_s": [] if seen is None else [round(t_s, 3) for t_s in seen.changed_s],
        "restarted_s": [] if seen is None else [round(t_s, 3) for t_s in seen.restarted_s],
        "folder_notes": notes,
    }


class _Seen:
    """What the render log of a recording comes to; times are the tables'. Raises RenderLogError."""

    def __init__(self, render_log: RenderLog) -> None:
        self.fps, self.sha256 = render_log.begun.view.fps, ""
        self.changed_s: list[float] = []
        self.restarted_s: list[float] = []
        times_s = array.array("d")
        zero_s, resumed = render_log.begun.zero_s, False
        shown = present = render_log.begun.perception
        for record in render_log:
            match record:
                case Perceive():
                    present = record.perception
                case Resumed():
                    zero_s, present, resumed = record.zero_s, record.perception, True
                case FrameRecord():
                    times_s.append(record.t_s - zero_s)
                    self.changed_s += times_s[-1:] if present != shown else []
                    self.restarted_s += times_s[-1:] if resumed else []
                    shown, resumed, self.sha256 = present, False, record.sha256.hex()
        self.frames, self.dropped = len(times_s), dropped_of(times_s, self.fps)


def _join(folder: Path, notes: list[str]) -> str | None:
    """One film of all parts, which then go; those that do not fit in get names of their own.

    A film that is there was whole before a part of it went, so that nothing is ever joined over it.
    """
    film = folder / FILM
    parts = film_parts(folder)
    if parts and film.exists():
        names = ", ".join(part.name for part in parts)
        notes.append(f"{names} was left as it is, since {FILM} was there already: it may hold the same frames.")
    elif parts:
        try:
            apart = {path for path, _ in join(parts, film)}
            for part in parts:
                if part in apart:
                    part.rename(folder / f"{APART}{part.stem.rpartition('-')[2]}{part.suffix}")
                else:
                    part.unlink(missing_ok=True)
        except (OutputError, FrameError, OSError) as error:
            notes.append(f"The film stays in parts: {error}.")
    for part in sorted(folder.glob(f"{APART}*")):
        at_s = begins_s(part)
        holds = "holds no whole frame" if at_s is None else f"begins at {at_s:.1f} s and is of another form"
        notes.append(f"{part.name} is not in the film: it {holds}.")
    return FILM if film.exists() else None


def _bridge(folder: Path, notes: list[str]) -> dict[str, Any] | None:
    try:
        return msgspec.json.decode((folder / BRIDGE).read_bytes(), type=dict[str, Any])
    except (OSError, msgspec.DecodeError, UnicodeDecodeError):
        notes.append("The bridge's last word is missing.")
        return None


def _worker(folder: Path, seen: _Seen | None, notes: list[str]) -> WorkerSummary:
    found = _last_word(folder, seen, notes)
    if seen is None:
        return found
    return msgspec.structs.replace(found, frames=seen.frames, dropped_frames=seen.dropped)


def _last_word(folder: Path, seen: _Seen | None, notes: list[str]) -> WorkerSummary:
    try:
        return msgspec.json.decode((folder / WORKER).read_bytes(), type=WorkerSummary)
    except FileNotFoundError:
        notes.append("The worker's last word is missing: figures are those of its tables.")
    except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
        notes.append(f"{WORKER} cannot be read ({error}): figures are those of the tables.")
    fps, sha256 = (1.0, "") if seen is None else (seen.fps, seen.sha256)
    try:
        tally = Tally.read(folder / PLAN, fps)
    except (OSError, UnicodeDecodeError) as error:
        notes.append(f"{PLAN} cannot be read: {error}.")
        tally = Tally(fps)
    return tally.summary(None, sha256, None)
