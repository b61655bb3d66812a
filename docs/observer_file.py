"""Writes the tables of observer-file.md from the settings' own records: `python docs/observer_file.py`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from entoptic.services.console.fields import fields
from entoptic.services.console.protocol import Field
from entoptic.services.settings import Settings

PAGE = Path(__file__).with_name("observer-file.md")
BEGIN, END = "<!-- tables: written by observer_file.py -->\n", "<!-- end of tables -->\n"


def page() -> str:
    """What the page has to say now."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    return before + BEGIN + tables() + END + rest.partition(END)[2]


def tables() -> str:
    """One table for each table of a settings file, those of the person first; keys as in the records."""
    known = {field.path: field for field in fields()}
    by_table: dict[str, list[Field]] = {"observer": [], "observer.ocular_dynamics": [], "display": [], "plan": []}
    for path in _paths(msgspec.to_builtins(Settings()), ""):
        table = path.rpartition(".")[0]
        by_table.setdefault(table, []).append(known[path])
    return "\n".join(f"### [{name}]\n{_table(of_table)}" for name, of_table in by_table.items())


def _paths(values: dict[str, Any], table: str) -> Iterator[str]:
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _paths(value, f"{table}{key}.")
        else:
            yield table + key


def _table(of_table: list[Field]) -> str:
    rows = ["| key | may be | default | meaning |", "|---|---|---|---|"]
    for field in of_table:
        cells = (f"`{field.path.rpartition('.')[2]}`", _range(field), _value(field.default), _meaning(field))
        rows.append("| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |")
    return "\n".join(rows) + "\n"


def _range(field: Field) -> str:
    if field.kind == "bool":
        return "true, false"
    if field.kind in ("choice", "choices"):
        return ("any of " if field.kind == "choices" else "") + ", ".join(f'"{value}"' for value, _ in field.options)
    if field.kind == "text":
        return "text"
    low = f"above {field.low:.9g}" if field.low_open else f"{field.low:.9g}"
    numbers = f"{low} or more" if field.high is None else f"{low} to {field.high:.9g}"
    return f"{numbers}, whole" if field.kind == "int" else numbers


def _value(default: object) -> str:
    if default is None:
        return "none"
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, str):
        return f'"{default}"'
    return f"{default:.9g}" if isinstance(default, float) else str(default)


def _meaning(field: Field) -> str:
    choices = [f"`{value}`: {sentence}" for value, sentence in field.options if sentence]
    return "<br>".join(part for part in (field.help, *choices) if part)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
