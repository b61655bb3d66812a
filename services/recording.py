"""A recording's folder: made when it begins, finished when it ends, or afterwards where its host died.

While it grows it is called NAME.partial, and all in it is readable at every moment; the finished one is called NAME.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import re
import shutil
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import msgspec
from msgspec.structs import replace

from entoptic.atomic_file import write_json
from entoptic.errors import EntopticError, OutputError
from entoptic.services import settings as settings_file
from entoptic.services.ipc.status import BridgeStatus, Gap, Problem, WorkerStatus, problem
from entoptic.services.results import session_file
from entoptic.services.results.finish import finish as finish_frames
from entoptic.services.results.folder import ResultsFolderError, keep, refuse_foreign
from entoptic.services.session_config import OpenedSession, SessionConfig

PARTIAL: Final = ".partial"
SUMMARY: Final = "summary.json"
HOST: Final = "host.json"
"""What the host knows of a recording, kept in its folder until that is finished: gaps and problems."""
REPORT: Final = "report.html"
CUT_OFF: Final = problem(
    "cut off",
    "error",
    "The host left no summary: it was ended by force, or the power failed",
    "Look at log.jsonl; what was recorded until then is whole",
)
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,63}")


class RecordingFolderError(EntopticError):
    """A recording cannot be made or finished: the message names the folder and the remedy."""


class HostNotes(msgspec.Struct, frozen=True):
    """What the host adds to a recording's summary."""

    gaps: tuple[dict[str, Any], ...] = ()
    interrupted: bool = False
    problems: tuple[Problem, ...] = ()


def name_of_now(root: Path) -> str:
    """A folder's name that is free."""
    return _free(root, f"{datetime.now():%Y-%m-%d_%H-%M-%S}")


def folder_for(root: Path, name: str) -> Path:
    """The final folder of a recording to be made. Raises RecordingFolderError for a name that would lie elsewhere."""
    if name and (not _NAME.fullmatch(name) or name.endswith((".", " ", PARTIAL))):
        raise RecordingFolderError(f"{name!r} is no name for a folder: use up to 64 letters, digits, spaces, - and _")
    return root / (_free(root, name) if name else name_of_now(root))


def refuse(final: Path) -> None:
    """Raises what `make` would, before anything is started."""
    _make(final).rmdir()


def make(final: Path, opened: OpenedSession) -> Path:
    """Makes the folder of a recording that begins; returns where it is to be written.

    Raises RecordingFolderError, and ResultsFolderError for a `final` that holds something else.
    """
    folder = _make(final)
    try:
        settings_file.write(folder / "settings.toml", opened.config.settings)
        session_file.of_session(opened, "live").write(folder)
    except (OSError, OutputError) as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise _unwritable(folder, error) from None
    return folder


def _make(final: Path) -> Path:
    final = final.resolve()
    refuse_foreign(final)
    folder = final.with_name(final.name + PARTIAL)
    if folder.exists():
        raise RecordingFolderError(
            f"{folder} is there already: finish it with {_again(folder)}, or choose another name"
        )
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir()
    except OSError as error:
        raise _unwritable(folder, error) from None
    return folder


def _unwritable(folder: Path, error: Exception) -> RecordingFolderError:
    reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return RecordingFolderError(f"{folder} cannot be written: {reason}; make room, or choose another place")


def as_of_now(opened: OpenedSession, worker: WorkerStatus | None, bridge: BridgeStatus | None) -> OpenedSession:
    """With settings and pupil map as they are by now."""
    config = opened.config
    if worker is not None:
        config = replace(config, settings=worker.settings)
    if bridge is not None and bridge.pupil_map is not None:
        config = replace(config, eyes=replace(config.eyes, pupil_map=bridge.pupil_map))
    return dataclasses.replace(opened, config=config)


def keep_inputs(folder: Path, config: SessionConfig) -> Problem | None:
    """Copies what the session needs into its folder; what went wrong."""
    try:
        kept = session_file.keep_inputs(session_file.inputs_of(config), folder)
        replace(session_file.read(folder), inputs=kept).write(folder)
    except (OSError, session_file.SessionFileError) as error:
        what, remedy = f"Inputs were not copied into {folder}: {error}", "Make room, and keep them yourself"
        return problem("inputs not copied", "warning", what, remedy)
    large = ", ".join(one.path for one in kept if one.kept is None)
    what = f"Too large to be copied into {folder}: {large}"
    return problem("inputs not copied", "note", what, "Keep them where they are") if large else None


def note(
    folder: Path, start_ns: int, gaps: Sequence[Gap], *, interrupted: bool, problems: Sequence[Problem] = ()
) -> None:
    """Leaves what the host knows in a folder, for when that is finished. Raises OSError."""
    these = tuple(gap.since(start_ns) for gap in gaps if gap.to_ns is None or gap.to_ns > start_ns)
    write_json(folder / HOST, HostNotes(these, interrupted, tuple(problems)))


def note_meanwhile(folder: Path, start_ns: int, gaps: Sequence[Gap]) -> None:
    """The same while a recording runs: what is to be said if this host is ended by force. Raises OSError."""
    note(folder, start_ns, gaps, interrupted=True, problems=(CUT_OFF,))


def finish(folder: Path, *, replaces: bool = True) -> Path:
    """Joins films, writes the summary, gives the folder its final name, which it returns.

    Raises RecordingFolderError; then it can be done again.

    `replaces`: earlier results of that name go.
    """
    folder = folder.resolve()
    final = folder.with_name(folder.name.removesuffix(PARTIAL))
    if not replaces and final != folder and final.exists():
        raise RecordingFolderError(f"{final} is there already: move it away, then {_again(folder)}")
    try:
        session = session_file.read(folder)
        write_json(folder / SUMMARY, summary_of(session, notes_of(folder), finish_frames(folder)))
        with contextlib.suppress(FileNotFoundError):
            (folder / HOST).unlink()
        if final == folder:
            return folder
        refuse_foreign(final)
        keep(folder, final, REPORT)
    except OSError as error:
        raise RecordingFolderError(
            f"{folder} cannot be finished: {error.strerror or error}; make room, then {_again(folder)}"
        ) from None
    except (ResultsFolderError, session_file.SessionFileError) as error:
        raise RecordingFolderError(f"{error}; then {_again(folder)}") from None
    return final


def summary_of(session: session_file.SessionFile, notes: HostNotes, done: dict[str, Any]) -> dict[str, Any]:
    """All of a summary, live or not; `done` is what services.results.finish.finish says."""
    config = msgspec.to_builtins(session.config, order="deterministic")
    config["settings"] = done.pop("perception", config["settings"])
    return {
        "source": session.source,
        "scene": session.scene,
        "mode": session.mode,
        "config": config,
        "interrupted": notes.interrupted,
        "gaps": list(notes.gaps),
        "problems": msgspec.to_builtins(notes.problems),
        "notes": list(session.notes),
        **done,
        "bridge": done["bridge"] or {},
    }


def notes_of(folder: Path) -> HostNotes:
    """What its host said, or says; of a folder in which nothing is said, that."""
    with contextlib.suppress(OSError, msgspec.DecodeError, UnicodeDecodeError):
        return msgspec.json.decode((folder / HOST).read_bytes(), type=HostNotes)
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
        return msgspec.convert({name: summary[name] for name in ("gaps", "interrupted", "problems")}, HostNotes)
    return HostNotes(interrupted=True, problems=(CUT_OFF,))


def _again(folder: Path) -> str:
    return f"`entoptic report {folder}`"


def _free(root: Path, name: str) -> str:
    taken, k = name, 2
    while (root / taken).exists() or (root / (taken + PARTIAL)).exists():
        taken, k = f"{name}-{k}", k + 1
    return taken


def prepare_report() -> None:
    """Loads what draws reports, which takes a second that nobody has when a session ends."""
    import entoptic.services.report.page  # noqa: F401


def draw_report(folder: Path) -> Problem | None:
    """Draws the report of a finished session; what went wrong."""
    from entoptic.services.report import page as report

    try:
        report.write(folder)
    except report.ReportError as error:
        return problem("no report", "warning", f"No report in {folder}: {error}", f"Mend that, then {_again(folder)}")
    except OSError as error:
        what = f"No report in {folder}: {error.strerror or error}"
        return problem("no report", "warning", what, f"Make room, then {_again(folder)}")
    return None
