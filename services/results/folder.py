"""A folder of results, whole or not at all."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from entoptic.errors import EntopticError

LIST = ".entoptic"
"""Names what was written, so that only that is ever replaced; empty while a folder is being written."""
NEW = ".new"
"""Of a folder's name while it is being written. A live take has another one: it is never removed."""
BRIDGE: Final = "bridge.json"
"""A bridge's last word on a session; missing while it records one, and where it was ended by force."""
WORKER: Final = "worker.json"
"""A worker's."""


class ResultsFolderError(EntopticError):
    """Results cannot be written there: the message names the folder and the remedy."""


@contextlib.contextmanager
def results_folder(out: Path) -> Iterator[Path]:
    """A folder to write into that becomes `out` when all is well and vanishes when not.

    An `out` that holds nothing but what was written here before is replaced, and so is what a killed process left
    beside it. Raises ResultsFolderError if it holds anything else or cannot be written.
    """
    out = out.resolve()
    refuse_foreign(out)
    new = out.with_name(out.name + NEW)
    if new.exists() and not (new / LIST).exists():
        raise ResultsFolderError(f"{new} is in the way and was not written here: move it away, or choose another --out")
    shutil.rmtree(new, ignore_errors=True)
    try:
        new.mkdir(parents=True)
        (new / LIST).touch()
    except OSError as error:
        raise ResultsFolderError(f"cannot make {new}: {error.strerror}; choose another --out") from None
    try:
        yield new
        keep(new, out)
    except OSError as error:
        raise ResultsFolderError(f"{out} cannot be written: {error.strerror or error}; choose another --out") from None
    finally:
        shutil.rmtree(new, ignore_errors=True)


def refuse_foreign(out: Path) -> None:
    """Raises ResultsFolderError if a folder holds what was not written here."""
    if not out.name or out == Path.cwd() or (out.exists() and not _ours(out)):
        raise ResultsFolderError(
            f"{out} holds something that was not written by such a command: choose another --out, or move it away"
        )


def keep(written: Path, out: Path, *to_come: str) -> None:
    """Gives a folder its final name, in place of what had it; files `to_come` are ours too. Raises OSError."""
    names = sorted({path.name for path in written.iterdir()} - {LIST} | set(to_come))
    (written / LIST).write_text("\n".join(names), encoding="utf-8")
    if out.exists():
        shutil.rmtree(out)
    written.rename(out)


def _ours(out: Path) -> bool:
    if not out.is_dir():
        return False
    names = {path.name for path in out.iterdir()}
    if LIST not in names:
        return not names
    return names <= {LIST, *(out / LIST).read_text(encoding="utf-8").splitlines()}
