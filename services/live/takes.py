"""A take's folder: made when it begins, finished when it ends, or afterwards where its host died.

While it grows it is called NAME.partial, and all in it is readable at every moment; the finished one is called NAME.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import msgspec

from services.live.checked import Checked
from services.live.supervision import Gap
from services.psf import observer_file
from services.results import session_file
from services.results.finish import finish as finish_frames
from services.results.folder import ResultsFolderError, keep, refuse_foreign

PARTIAL: Final = ".partial"
SUMMARY: Final = "summary.json"
HOST: Final = "host.json"
"""What the host knows of a take, kept in its folder until that is finished: gaps and trouble."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,63}")


class TakeError(Exception):
    """A take cannot be made or finished: the message names the folder and the remedy."""


class HostNotes(msgspec.Struct, frozen=True):
    """What the host adds to a take's summary."""

    start_ns: int
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


def make(final: Path, checked: Checked) -> Path:
    """Makes the folder of a take that begins; returns where it is to be written.

    Raises TakeError, and ResultsFolderError for a `final` that holds something else.
    """
    final = final.resolve()
    refuse_foreign(final)
    folder = final.with_name(final.name + PARTIAL)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir()
        observer_file.write(folder / "settings.toml", checked.settings)
        of_session(checked, "live").write(folder)
    except FileExistsError:
        raise TakeError(
            f"{folder} is there already: finish it with `entoptic report {folder}`, or choose another name"
        ) from None
    except OSError as error:
        raise TakeError(f"{folder} cannot be written: {error.strerror}; make room, or choose another place") from None
    return folder


def of_session(checked: Checked, mode: Any) -> session_file.SessionFile:
    """A session.json, still without its inputs."""
    return session_file.SessionFile(
        program=session_file.version(),
        mode=mode,
        began=session_file.now(),
        choice=checked.choice,
        width_px=checked.view.width_px,
        height_px=checked.view.height_px,
        fov_deg=checked.view.fov_deg,
        source=checked.source.info.name,
        scene=checked.scene.name,
        notes=checked.notes,
    )


def keep_inputs(folder: Path, checked: Checked) -> str | None:
    """Copies what the session needs into its folder; what went wrong, for a person."""
    named = session_file.inputs_of(checked.choice, checked.settings.tone.curve)
    try:
        kept = session_file.keep_inputs(named, folder)
        msgspec.structs.replace(session_file.read(folder), inputs=kept).write(folder)
    except (OSError, session_file.SessionFileError) as error:
        return f"inputs were not copied into {folder}: {error}; make room, and keep them yourself"
    large = [one.path for one in kept if one.kept is None]
    return f"too large to be copied into {folder}: {', '.join(large)}; keep them where they are" if large else None


def note(folder: Path, start_ns: int, gaps: Sequence[Gap], *, interrupted: bool, trouble: str | None) -> None:
    """Leaves what the host knows in a folder that is to be finished. Raises OSError."""
    told = tuple(gap.since(start_ns) for gap in gaps if gap.to_ns is None or gap.to_ns > start_ns)
    notes = HostNotes(start_ns, told, interrupted, trouble)
    (folder / HOST).write_bytes(msgspec.json.encode(notes))


@dataclasses.dataclass(frozen=True)
class Finished:
    """A take's folder, all done but what `trouble` says."""

    folder: Path
    trouble: str | None = None


def finish(folder: Path) -> Finished:
    """Joins films, writes the summary, gives the folder its final name. Raises TakeError; then it can be done again."""
    folder = folder.resolve()
    try:
        session = session_file.read(folder)
        summary = told(session, _notes_of(folder), finish_frames(folder))
        (folder / SUMMARY).write_bytes(msgspec.json.format(msgspec.json.encode(summary), indent=2))
        with contextlib.suppress(FileNotFoundError):
            (folder / HOST).unlink()
        if not folder.name.endswith(PARTIAL):
            return Finished(folder)
        final = folder.with_name(folder.name.removesuffix(PARTIAL))
        refuse_foreign(final)
        keep(folder, final)
    except OSError as error:
        raise TakeError(
            f"{folder} cannot be finished: {error.strerror or error}; make room, then {_again(folder)}"
        ) from None
    except (ResultsFolderError, session_file.SessionFileError) as error:
        raise TakeError(f"{error}; then {_again(folder)}") from None
    return Finished(final)


def told(session: session_file.SessionFile, notes: HostNotes, done: dict[str, Any]) -> dict[str, Any]:
    """All of a summary, live or not; `done` is what services.results.finish.finish says."""
    choice = session.choice
    return {
        "recording": session.source,
        "scene": session.scene,
        "view": {"width_px": session.width_px, "height_px": session.height_px, "fov_deg": session.fov_deg},
        "fps": choice.fps,
        "eyes": choice.eyes.value,
        "mode": session.mode,
        "seed": choice.seed,
        "perception": choice.settings,
        "interrupted": notes.interrupted,
        "gaps": list(notes.gaps),
        "trouble": notes.trouble,
        "notes": list(session.notes),
        **done,
        "bridge": done["bridge"] or {},
    }


def _notes_of(folder: Path) -> HostNotes:
    """Of a take whose host left none it is said that the host died, unless it was finished before."""
    with contextlib.suppress(OSError, msgspec.DecodeError):
        return msgspec.json.decode((folder / HOST).read_bytes(), type=HostNotes)
    with contextlib.suppress(OSError, ValueError):
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
        return HostNotes(0, tuple(summary["gaps"]), summary["interrupted"], summary["trouble"])
    return HostNotes(0, interrupted=True, trouble="the host that ran this session was ended by force")


def _again(folder: Path) -> str:
    return f"`entoptic report {folder}`"


def _free(root: Path, name: str) -> str:
    taken, k = name, 2
    while (root / taken).exists() or (root / (taken + PARTIAL)).exists():
        taken, k = f"{name}-{k}", k + 1
    return taken


def prepare_report() -> None:
    """Loads what draws reports, which takes a second that nobody has when a session ends."""
    import services.report.page  # noqa: F401


def draw_report(folder: Path) -> str | None:
    """Draws the report of a finished take; what went wrong, for a person."""
    from services.report import page as report

    try:
        report.write(folder)
    except OSError as error:
        return f"no report in {folder}: {error.strerror or error}; make room, then {_again(folder)}"
    return None
