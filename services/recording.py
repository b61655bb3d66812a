"""A take's folder: made when it begins, finished when it ends, or afterwards where its host died.

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
from entoptic.services.ipc.status import Gap
from entoptic.services.results import session_file
from entoptic.services.results.finish import finish as finish_frames
from entoptic.services.results.folder import ResultsFolderError, keep, refuse_foreign
from entoptic.services.session_config import OpenedSession, SessionConfig
from entoptic.services.settings import Settings

PARTIAL: Final = ".partial"
SUMMARY: Final = "summary.json"
HOST: Final = "host.json"
"""What the host knows of a take, kept in its folder until that is finished: gaps and trouble."""
REPORT: Final = "report.html"
NO_LAST_WORD: Final = "its host left no last word: it was ended by force, or the power failed"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,63}")


class TakeError(EntopticError):
    """A take cannot be made or finished: the message names the folder and the remedy."""


class HostNotes(msgspec.Struct, frozen=True):
    """What the host adds to a take's summary."""

    gaps: tuple[dict[str, Any], ...] = ()
    interrupted: bool = False
    trouble: str | None = None


def name_of_now(root: Path) -> str:
    """A folder's name that is free."""
    return _free(root, f"{datetime.now():%Y-%m-%d_%H-%M-%S}")


def folder_for(root: Path, name: str) -> Path:
    """The final folder of a take to be made. Raises TakeError for a name that would lie elsewhere."""
    if name and (not _NAME.fullmatch(name) or name.endswith((".", " ", PARTIAL))):
        raise TakeError(f"{name!r} is no name for a folder: use up to 64 letters, digits, spaces, - and _")
    return root / (_free(root, name) if name else name_of_now(root))


def refuse(final: Path) -> None:
    """Raises what `make` would, before anything is started."""
    _make(final).rmdir()


def make(final: Path, opened: OpenedSession) -> Path:
    """Makes the folder of a take that begins; returns where it is to be written.

    Raises TakeError, and ResultsFolderError for a `final` that holds something else.
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
        raise TakeError(f"{folder} is there already: finish it with {_again(folder)}, or choose another name")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir()
    except OSError as error:
        raise _unwritable(folder, error) from None
    return folder


def _unwritable(folder: Path, error: Exception) -> TakeError:
    reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return TakeError(f"{folder} cannot be written: {reason}; make room, or choose another place")


def as_of_now(opened: OpenedSession, worker: dict[str, Any], bridge: dict[str, Any]) -> OpenedSession:
    """With settings and pupil map as they are by now; `worker` and `bridge` are what those say of themselves."""
    config = opened.config
    if worker.get("settings") is not None:
        with contextlib.suppress(msgspec.ValidationError):  # a worker of another version
            config = replace(config, settings=msgspec.convert(worker["settings"], Settings))
    if bridge.get("pupil_map") is not None:
        config = replace(config, eyes=replace(config.eyes, pupil_map=bridge["pupil_map"]))
    return dataclasses.replace(opened, config=config)


def keep_inputs(folder: Path, config: SessionConfig) -> str | None:
    """Copies what the session needs into its folder; what went wrong, for a person."""
    try:
        kept = session_file.keep_inputs(session_file.inputs_of(config), folder)
        replace(session_file.read(folder), inputs=kept).write(folder)
    except (OSError, session_file.SessionFileError) as error:
        return f"inputs were not copied into {folder}: {error}; make room, and keep them yourself"
    large = [one.path for one in kept if one.kept is None]
    return f"too large to be copied into {folder}: {', '.join(large)}; keep them where they are" if large else None


def note(folder: Path, start_ns: int, gaps: Sequence[Gap], *, interrupted: bool, trouble: str | None) -> None:
    """Leaves what the host knows in a folder, for when that is finished. Raises OSError."""
    told = tuple(gap.since(start_ns) for gap in gaps if gap.to_ns is None or gap.to_ns > start_ns)
    write_json(folder / HOST, HostNotes(told, interrupted, trouble))


def note_meanwhile(folder: Path, start_ns: int, gaps: Sequence[Gap]) -> None:
    """The same while a take runs: what is to be said if this host is ended by force. Raises OSError."""
    note(folder, start_ns, gaps, interrupted=True, trouble=NO_LAST_WORD)


@dataclasses.dataclass(frozen=True)
class Finished:
    """A take's folder, all done but what `trouble` says."""

    folder: Path
    trouble: str | None = None


def finish(folder: Path, *, replaces: bool = True) -> Finished:
    """Joins films, writes the summary, gives the folder its final name. Raises TakeError; then it can be done again.

    `replaces`: earlier results of that name go.
    """
    folder = folder.resolve()
    final = folder.with_name(folder.name.removesuffix(PARTIAL))
    if not replaces and final != folder and final.exists():
        raise TakeError(f"{final} is there already: move it away, then {_again(folder)}")
    try:
        session = session_file.read(folder)
        write_json(folder / SUMMARY, told(session, notes_of(folder), finish_frames(folder)))
        with contextlib.suppress(FileNotFoundError):
            (folder / HOST).unlink()
        if final == folder:
            return Finished(folder)
        refuse_foreign(final)
        keep(folder, final, REPORT)
    except OSError as error:
        raise TakeError(
            f"{folder} cannot be finished: {error.strerror or error}; make room, then {_again(folder)}"
        ) from None
    except (ResultsFolderError, session_file.SessionFileError) as error:
        raise TakeError(f"{error}; then {_again(folder)}") from None
    return Finished(final)


def told(session: session_file.SessionFile, notes: HostNotes, done: dict[str, Any]) -> dict[str, Any]:
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
        "trouble": notes.trouble,
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
        return HostNotes(tuple(summary["gaps"]), summary["interrupted"], summary["trouble"])
    return HostNotes(interrupted=True, trouble=NO_LAST_WORD)


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


def draw_report(folder: Path) -> str | None:
    """Draws the report of a finished session; what went wrong, for a person."""
    from entoptic.services.report import page as report

    try:
        report.write(folder)
    except report.ReportError as error:
        return f"no report in {folder}: {error}; mend that, then {_again(folder)}"
    except OSError as error:
        return f"no report in {folder}: {error.strerror or error}; make room, then {_again(folder)}"
    return None
