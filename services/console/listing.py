"""What is there to choose from: observers, pupil maps, scenes, eye data, sessions."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from urllib.parse import quote

from entoptic.pipeline.scenes import NIGHT_STREET
from entoptic.services.console.protocol import Listed
from entoptic.services.recording import PARTIAL
from entoptic.services.results import session_file
from entoptic.services.settings import Settings, load

SESSIONS = "sessions"
MOST = 500
"""Of each list."""
PUPIL_MAPS = "pupil-maps"
"""Beside the observers."""
_PICTURES = (".hdr", ".exr")
_TABLES = (".csv", ".tsv", ".txt")
_PUPIL_FILES = ("pupil.pldata", "pupil_positions.csv")
"""Of a recording by Pupil Capture, and of an export of Pupil Player."""


def listed(what: str, *, root: Path, observers: Path, inputs: Path | None) -> list[Listed]:
    """One of the lists of requests.List."""
    kinds = {
        "observers": lambda: _tomls(observers),
        "pupil maps": lambda: _tomls(observers / PUPIL_MAPS, full=True),
        "scenes": lambda: _scenes(inputs),
        "sources": lambda: _sources(inputs, root),
        "sessions": lambda: _sessions(root),
    }
    return list(itertools.islice(kinds[what](), MOST))


def path_of(observers: Path, name: str) -> Path:
    """Of an observer; its name is one that requests.ObserverName lets through."""
    return observers / f"{name}.toml"


def load_observer(observers: Path, name: str) -> Settings:
    """Raises SettingsError."""
    return load(path_of(observers, name))


def _tomls(folder: Path, *, full: bool = False) -> Iterator[Listed]:
    for path in _in(folder):
        if path.suffix == ".toml" and path.is_file():
            yield Listed(str(path.resolve()) if full else path.stem, path.stem, _when(path))


def _scenes(inputs: Path | None) -> Iterator[Listed]:
    yield Listed(NIGHT_STREET, "Street at night")
    for label, path in _below(inputs):
        has_pictures = path.is_dir() and any(one.suffix.lower() in _PICTURES for one in _in(path))
        if has_pictures or path.suffix.lower() in _PICTURES:
            yield Listed(str(path), label, _when(path))


def _sources(inputs: Path | None, root: Path) -> Iterator[Listed]:
    yield Listed("simulated", "Simulated eyes")
    yield Listed("capture", "Pupil Capture")
    yield Listed("usb", "USB eye tracker")
    yield Listed("usb-simulated:simulated", "Simulated USB eye tracker")
    for label, path in _below(inputs):
        if _is_recording(path) or (path.is_file() and path.suffix.lower() in _TABLES):
            yield Listed(str(path), label, _when(path))
    for session in sorted(_in(root), reverse=True):
        if _is_recording(session / "eyes"):
            yield Listed(str((session / "eyes").resolve()), f"Eyes of session {session.name}", _when(session))


def _sessions(root: Path) -> Iterator[Listed]:
    folders = [path for path in _in(root) if path.is_dir() and (path / session_file.FILE).exists()]
    for path in sorted(folders, key=lambda path: path.stat().st_mtime, reverse=True):
        url = f"/{SESSIONS}/{quote(path.name)}/"
        yield Listed(
            path.name,
            path.name.removesuffix(PARTIAL),
            _when(path),
            report_url=url + "report.html" if (path / "report.html").exists() else None,
            film_url=url + "perceived.mp4" if (path / "perceived.mp4").exists() else None,
            running=path.name.endswith(PARTIAL),
        )


def _is_recording(path: Path) -> bool:
    return path.is_dir() and any((path / name).exists() for name in _PUPIL_FILES)


def _below(folder: Path | None) -> Iterator[tuple[str, Path]]:
    """All that lies in a folder or in its folders, each with its name below it; what a link leads out to is not."""
    if folder is None:
        return
    inside = folder.resolve()
    for path in (one for each in _in(folder) for one in (each, *(_in(each) if each.is_dir() else ()))):
        try:
            real = path.resolve()
        except (OSError, RuntimeError):  # a link that leads to itself
            continue
        if real.is_relative_to(inside) and _is_text(real):
            yield str(path.relative_to(folder)), real


def _in(folder: Path) -> list[Path]:
    try:
        return sorted(path for path in folder.iterdir() if not path.name.startswith(".") and _is_text(path))
    except OSError:
        return []


def _is_text(path: Path) -> bool:
    """Whether a name is text: a file system takes any bytes."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def _when(path: Path) -> str | None:
    try:
        return datetime.fromtimestamp(path.stat().st_mtime).astimezone().isoformat(timespec="seconds")
    except OSError:
        return None
