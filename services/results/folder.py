"""A folder of results, whole or not at all."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path

LIST = ".entoptic"
"""Names what was written, so that only that is ever replaced."""


class ResultsFolderError(Exception):
    """Results cannot be written there: the message names the folder and the remedy."""


@contextlib.contextmanager
def results_folder(out: Path) -> Iterator[Path]:
    """A folder to write into that becomes `out` when all is well and vanishes when not.

    An `out` that holds nothing but what was written here before is replaced. Raises ResultsFolderError if it holds
    anything else or cannot be written.
    """
    out = out.resolve()
    refuse_foreign(out)
    partial = out.with_name(out.name + ".partial")
    shutil.rmtree(partial, ignore_errors=True)
    try:
        partial.mkdir(parents=True)
    except OSError as error:
        raise ResultsFolderError(f"cannot make {partial}: {error.strerror}; choose another --out") from None
    try:
        yield partial
        keep(partial, out)
    except OSError as error:
        raise ResultsFolderError(f"{out} cannot be written: {error.strerror or error}; choose another --out") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def refuse_foreign(out: Path) -> None:
    """Raises ResultsFolderError if a folder holds what was not written here."""
    if not out.name or out == Path.cwd() or (out.exists() and not _ours(out)):
        raise ResultsFolderError(
            f"{out} holds something that was not written by such a command: choose another --out, or move it away"
        )


def keep(partial: Path, out: Path) -> None:
    """Gives a folder its final name, in place of what had it. Raises OSError."""
    names = sorted({path.name for path in partial.iterdir()} - {LIST})
    (partial / LIST).write_text("\n".join(names), encoding="utf-8")
    if out.exists():
        shutil.rmtree(out)
    partial.rename(out)


def _ours(out: Path) -> bool:
    if not out.is_dir():
        return False
    names = {path.name for path in out.iterdir()}
    if LIST not in names:
        return not names
    return names <= {LIST, *(out / LIST).read_text(encoding="utf-8").splitlines()}
