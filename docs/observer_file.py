"""Writes the tables of observer-file.md from the settings' own records: `python docs/observer_file.py`."""

from __future__ import annotations

import enum
from pathlib import Path

from entoptic.services.records import Leaf, leaves, options_of
from entoptic.services.settings import Settings

PAGE = Path(__file__).with_name("observer-file.md")
BEGIN, END = "<!-- tables: written by observer_file.py -->\n", "<!-- end of tables -->\n"


def page() -> str:
    """What the page has to say now."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    return before + BEGIN + tables() + END + rest.partition(END)[2]


def tables() -> str:
    """One table for each table of a settings file, those of the person first; keys as in the records."""
    by_table: dict[str, list[Leaf]] = {"observer": [], "observer.ocular_dynamics": [], "display": [], "plan": []}
    for leaf in leaves(Settings):
        by_table.setdefault(leaf.path.rpartition(".")[0], []).append(leaf)
    return "\n".join(f"### [{name}]\n{_table(of_table)}" for name, of_table in by_table.items())


def _table(of_table: list[Leaf]) -> str:
    rows = ["| key | may be | default | meaning |", "|---|---|---|---|"]
    for leaf in of_table:
        cells = (f"`{leaf.name}`", _range(leaf), _value(leaf.default), _meaning(leaf))
        rows.append("| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |")
    return "\n".join(rows) + "\n"


def _range(leaf: Leaf) -> str:
    if leaf.kind is bool:
        return "true, false"
    if issubclass(leaf.kind, enum.Enum):
        return ("any of " if leaf.many else "") + ", ".join(f'"{value}"' for value, _ in options_of(leaf.kind))
    if leaf.kind is str:
        return "text"
    low = f"above {leaf.low:.9g}" if leaf.low_open else f"{leaf.low:.9g}"
    numbers = f"{low} or more" if leaf.high is None else f"{low} to {leaf.high:.9g}"
    return f"{numbers}, whole" if leaf.kind is int else numbers


def _value(default: object) -> str:
    if default is None:
        return "none"
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, str):
        return f'"{default}"'
    return f"{default:.9g}" if isinstance(default, float) else str(default)


def _meaning(leaf: Leaf) -> str:
    options = options_of(leaf.kind) if issubclass(leaf.kind, enum.Enum) else ()
    choices = [f"`{value}`: {sentence}" for value, sentence in options if sentence]
    return "<br>".join((leaf.description, *choices))


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
