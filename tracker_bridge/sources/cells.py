"""Text tables: a header and lines of cells, read so that every error names its file, line and column."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

from entoptic.tracker_bridge.source import SourceError

MISSING = ("", "NaN", "nan", "NA")
"""Cells that mean "no value", unless a table's map says otherwise."""

_LARGEST = 1e30
"""No measurement is larger; it also keeps whatever is computed from a cell finite."""


class Table:
    """A whole table in memory."""

    def __init__(self, path: Path, header: tuple[str, ...], decimal: str, missing: Iterable[str]) -> None:
        self.path = path
        self.header = header
        self.decimal = decimal
        self.missing = frozenset(missing)
        self.index = {column: at for at, column in enumerate(header)}
        self.rows: list[Row] = []

    def need(self, columns: Iterable[str]) -> None:
        """Raises SourceError unless the table has all of these columns."""
        absent = [column for column in columns if column not in self.index]
        if absent:
            raise SourceError(
                f"{self.path} has no column {_quoted(absent)}. Its columns are {_quoted(self.header)}: "
                "name another file, or correct the column names in the table's map"
            )


class Row:
    """One line of a table."""

    __slots__ = ("_cells", "_table", "line")

    def __init__(self, table: Table, line: int, cells: list[str]) -> None:
        self._table = table
        self._cells = cells
        self.line = line

    def text(self, column: str) -> str:
        """A cell as it stands, without blanks around it."""
        return self._cells[self._table.index[column]].strip()

    def number(self, column: str) -> float | None:
        """A cell's number, None where the cell says that there is none. Raises SourceError for any other text."""
        text = self.text(column)
        if text in self._table.missing:
            return None
        # Python reads 1_000 as a number and 1.000 as one even where the point separates thousands; nobody means that.
        decimal = self._table.decimal
        if "_" not in text and (decimal != "," or "." not in text):
            try:
                value = float(text if decimal == "." else text.replace(",", "."))
            except ValueError:
                pass
            else:
                if abs(value) < _LARGEST:
                    return value
        raise self.wrong(column, "is no number" if decimal == "either" else f"is no number with a decimal '{decimal}'")

    def required(self, column: str) -> float:
        """A cell's number. Raises SourceError also where there is none."""
        value = self.number(column)
        if value is None:
            raise self.wrong(column, "is empty, and the line cannot be used without it")
        return value

    def wrong(self, column: str, why: str) -> SourceError:
        """The error that says why a cell cannot be used."""
        return SourceError(
            f"{self._table.path}, line {self.line}, column '{column}': {self.text(column)!r} {why}. "
            "Correct the cell or delete the line"
        )


def read_header(path: Path, delimiter: str) -> tuple[str, ...]:
    """The names of a table's columns. Raises SourceError where there are none."""
    return _read(path, delimiter, ".", (), header_only=True).header


def read_table(path: Path, delimiter: str, decimal: str = ".", missing: Iterable[str] = MISSING) -> Table:
    """A table of UTF-8 text. Empty lines are skipped.

    Raises SourceError where the file is missing, empty, no text, or where a line has more or fewer cells than the
    header.
    """
    return _read(path, delimiter, decimal, missing, header_only=False)


def _read(path: Path, delimiter: str, decimal: str, missing: Iterable[str], *, header_only: bool) -> Table:
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.reader(stream, delimiter=delimiter)
            header = tuple(name.strip() for name in next(reader, ()))
            if not any(header):
                raise SourceError(f"{path} is empty, or its first line names no columns: choose another table")
            table = Table(path, header, decimal, missing)
            if header_only:
                return table
            for cells in reader:
                if len(cells) == len(header):
                    table.rows.append(Row(table, reader.line_num, cells))
                elif cells:
                    raise SourceError(
                        f"{path}, line {reader.line_num}: its cells number {len(cells)}, the header's {len(header)}. "
                        "Correct the line, or the delimiter in the table's map"
                    )
            return table
    except OSError as error:
        raise SourceError(f"{path} cannot be read: {error.strerror}. Check its name and permissions") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise SourceError(f"{path} is no table of UTF-8 text: {error}. Export it again as UTF-8") from None


def _quoted(columns: Iterable[str]) -> str:
    return ", ".join(f"'{column}'" for column in columns)
