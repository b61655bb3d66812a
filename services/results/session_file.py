"""session.json: what a session was started with, and the copies of the files it needs, so that it can be run again."""

from __future__ import annotations

import contextlib
import hashlib
import shutil
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Final, Literal

import msgspec

from entoptic import __version__
from entoptic.atomic_file import write_json
from entoptic.errors import EntopticError
from entoptic.services.session_config import OpenedSession, SessionConfig
from entoptic.services.settings import files_of

FILE: Final = "session.json"
INPUTS: Final = "inputs"
MOST_BYTES: Final = 2_000_000_000
"""Of copies, for one session; of more than that their paths and hashes are kept. Engineering choice."""


class SessionFileError(EntopticError):
    """A session's folder cannot be used: the message names the file and the remedy."""


class Input(msgspec.Struct, frozen=True):
    """One file, or one folder of files, that a session needs."""

    what: str
    """scene, table map, head, pupil map, or what a setting's file is."""
    path: str
    """Where it was, in full."""
    kept: str | None
    """Its copy, from the session's folder; None where it is too large for one."""
    sha256: dict[str, str]
    """Of each file, by name."""


class SessionFile(msgspec.Struct, frozen=True):
    """All of session.json."""

    program: str
    """Version of this program."""
    mode: Literal["live", "offline"]
    began: str
    """ISO 8601, with the time zone."""
    config: SessionConfig
    """As it was started; its paths are those of `inputs`."""
    source: str
    """For a person."""
    scene: str
    """For a person."""
    notes: tuple[str, ...] = ()
    """What source and scene had to say."""
    inputs: tuple[Input, ...] = ()

    def write(self, folder: Path) -> None:
        """Into a session's folder; at any moment the old one or the new one is there. Raises OSError."""
        write_json(folder / FILE, self)

    def path_of(self, what: str, folder: Path) -> Path | None:
        """Where an input is to be read now: its copy, or the original if that is still the same.

        None for what is no file. Raises SessionFileError.
        """
        for one in self.inputs:
            if one.what == what:
                if one.kept is not None and (folder / one.kept).exists():
                    return folder / one.kept
                original = Path(one.path)
                if not original.exists():
                    raise SessionFileError(f"{folder}: its {what} was {original}, which is gone: put it back there")
                if _hashes(original, tuple(one.sha256)) != one.sha256:
                    raise SessionFileError(f"{folder}: its {what} {original} is another one now: put the old one back")
                return original
        return None


def now() -> str:
    """The time, as in `began`."""
    return datetime.now().astimezone().isoformat(timespec="seconds")


def read(folder: Path) -> SessionFile:
    """The session.json of a folder. Raises SessionFileError."""
    try:
        return msgspec.json.decode((folder / FILE).read_bytes(), type=SessionFile)
    except OSError as error:
        raise SessionFileError(f"{folder / FILE}: {error.strerror}; name the folder of a session") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise SessionFileError(f"{folder / FILE}: {error}; name the folder of a session of this program") from None


def keep_inputs(named: dict[str, Path], folder: Path) -> tuple[Input, ...]:
    """Copies files and folders, by what they are, into a session's `inputs`. Raises OSError."""
    sizes = {what: sum(file.stat().st_size for file in _files(path)) for what, path in named.items()}
    inputs, room = [], MOST_BYTES
    for what in sorted(named, key=lambda what: sizes[what]):
        path, copy = named[what].resolve(), None
        names = tuple(file.name for file in _files(path))
        if sizes[what] <= room:
            room -= sizes[what]
            copy = Path(INPUTS) / what.replace(" ", "-") / path.name
            (folder / copy if path.is_dir() else (folder / copy).parent).mkdir(parents=True, exist_ok=True)
            for file in _files(path):
                shutil.copyfile(file, folder / copy / file.name if path.is_dir() else folder / copy)
        hashes = _hashes(path if copy is None else folder / copy, names)
        inputs.append(Input(what, str(path), None if copy is None else copy.as_posix(), hashes))
    return tuple(sorted(inputs, key=lambda one: one.what))


def of_session(opened: OpenedSession, mode: Literal["live", "offline"]) -> SessionFile:
    """A session.json, still without its inputs."""
    return SessionFile(
        program=__version__,
        mode=mode,
        began=now(),
        config=opened.config,
        source=opened.source.info.name,
        scene=opened.scene.name,
        notes=opened.notes,
    )


def inputs_of(config: SessionConfig) -> dict[str, Path]:
    """The files that a session names, by what they are."""
    named = {
        "scene": config.view.scene,
        "table map": config.eyes.table_map,
        "head": config.view.head,
        "pupil map": config.eyes.pupil_map,
        **{what: file for what, (_, file) in files_of(config.settings).items()},
    }
    return {what: Path(name) for what, name in named.items() if name and Path(name).exists()}


def _files(path: Path) -> Iterator[Path]:
    """A file, or those that lie in a folder."""
    if path.is_dir():
        yield from sorted(one for one in path.iterdir() if one.is_file() and not one.name.startswith("."))
    else:
        yield path


def _hashes(path: Path, names: tuple[str, ...]) -> dict[str, str]:
    """Of a file or of those in a folder; a missing one has an empty hash."""
    found = dict.fromkeys(names, "")
    for name in names:
        with contextlib.suppress(OSError), (path / name if path.is_dir() else path).open("rb") as stream:
            found[name] = hashlib.file_digest(stream, "sha256").hexdigest()
    return found
