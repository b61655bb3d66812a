"""A file that grows by whole records, and is readable at every moment, whatever becomes of its writer."""

from __future__ import annotations

import contextlib
import csv
import io
import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType


class Appended:
    """A context; opened again it goes on at its end. Raises OSError where it cannot be written.

    Each record is one write that nothing buffers, so that a process that is killed loses none. One that does not fit
    on the disk is taken back.
    """

    def __init__(self, path: Path, whole_bytes: int | None = None) -> None:
        """What a killed writer left behind after `whole_bytes` is cut off; all of a file is whole unless given."""
        self._path = path
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o666)
        self._size = os.fstat(self._file).st_size
        if whole_bytes is not None and whole_bytes < self._size:
            os.ftruncate(self._file, whole_bytes)
            self._size = whole_bytes

    @property
    def size(self) -> int:
        """Bytes so far."""
        return self._size

    def write(self, record: bytes) -> None:
        """Adds one record, or nothing."""
        try:
            left = memoryview(record)
            while left:
                left = left[os.pwrite(self._file, left, self._size + len(record) - len(left)) :]
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._size)
            raise
        self._size += len(record)

    def check(self) -> None:
        """Raises FileNotFoundError where somebody deleted the file: writing would go on into nowhere."""
        if os.fstat(self._file).st_nlink == 0 or not self._path.exists():
            raise FileNotFoundError(2, "it was deleted or moved away", str(self._path))

    def close(self) -> None:
        """Nothing is left to be written."""
        os.close(self._file)

    def __enter__(self) -> Appended:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def row(cells: Sequence[object]) -> bytes:
    """A table's row, as one record."""
    text = io.StringIO(newline="")
    csv.writer(text).writerow(cells)
    return text.getvalue().encode()


def columns(path: Path) -> dict[str, list[str]]:
    """A table; without rows that a killed process left unfinished, empty where there is none. Raises csv.Error."""
    try:
        with path.open(newline="", encoding="utf-8", errors="replace") as file:
            header, *rows = list(csv.reader(file)) or [[]]
    except OSError:
        return {}
    whole = [row for row in rows if len(row) == len(header)]
    return {name: [row[k] for row in whole] for k, name in enumerate(header)}


def whole_rows(path: Path) -> int:
    """Bytes of a table up to the end of its last whole row; 0 where there is none."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            reach = min(size, 65_536)  # no row is nearly as long
            file.seek(size - reach)
            return size - reach + file.read(reach).rfind(b"\n") + 1
    except FileNotFoundError:
        return 0
