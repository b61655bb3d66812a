"""report.html: what a person looks at after a session, made from the tables that the session left."""

from __future__ import annotations

import csv
import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from entoptic.atomic_file import write_bytes
from entoptic.pipeline import EFFECTS
from entoptic.pipeline.plan import OFF, SKIPPED
from entoptic.services.report.plots import PLOTS, Subject, Table, latencies, numbers, svg
from entoptic.services.results.appended import columns

MOST_PAIRS = MOST_STRETCHES = 12
"""Of pictures, and of stretches without eye states: on the page; all of them are in the folder."""
TABLES = ("states.csv", "events.csv", "plan.csv")
QUANTITIES = ("_s", "_ms", "_mm", "_px", "_deg", "_m2")
"""How columns of numbers end."""


class ReportError(Exception):
    """A report cannot be drawn: the message names the file, and in a table the cell."""


def write(folder: Path) -> None:
    """Writes report.html into a session's folder, from its summary and tables; it lacks what they lack.

    Raises ReportError for a file that is damaged, OSError where nothing can be read or written.
    """
    try:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    except ValueError as error:
        raise ReportError(f"summary.json is damaged: {error}") from None
    tables: dict[str, Table] = {}
    try:
        tables |= {name: columns(folder / name) for name in TABLES}
        page = _page(folder, summary, *tables.values())
    except (ValueError, KeyError, IndexError, TypeError, csv.Error) as error:
        raise ReportError(_damage(tables) or f"a table or summary.json is not whole: {error!r}") from None
    write_bytes(folder / "report.html", page.encode())


def _damage(tables: dict[str, Table]) -> str | None:
    """The first cell that should be a number and is none."""
    for name, table in tables.items():
        for column, cells in table.items():
            for k, cell in enumerate(cells if column.endswith(QUANTITIES) else ()):
                try:
                    float(cell or 0)
                except ValueError:
                    return f"{name}, row {k + 1}: {column} is {cell!r} and no number"
    return None


def _page(folder: Path, summary: dict[str, Any], states: Table, events: Table, plan: Table) -> str:
    worker = summary.get("worker") or {}
    gaps = [gap for gap in summary.get("gaps") or [] if gap["to_s"] is None or gap["to_s"] > 0]
    pairs = _pairs(folder)
    subject = Subject(states, plan, summary["config"]["view"], gaps)
    loader = jinja2.PackageLoader("entoptic.services.report", package_path="")
    environment = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    return environment.get_template("report.html.jinja").render(
        summary=summary,
        worker=worker,
        reception=worker.get("reception"),
        notes=[*summary.get("notes", ()), *summary.get("folder_notes", ())],
        changed_s=summary.get("settings_changed_s", ()),
        gaps=gaps,
        key_frames=pairs[:: max(math.ceil(len(pairs) / MOST_PAIRS), 1)],
        pairs=len(pairs),
        eyes=[eye for eye in ("left", "right") if f"{eye}_pupil_diameter_mm" in plan],
        effects=_effects(plan),
        events=Counter(events.get("event", ())).most_common(),
        latency=[(name, *np.percentile(times, (50, 95))) for name, times in latencies(plan).items()],
        plots=[(title, svg(draw(subject))) for title, draw, needs in PLOTS if subject.has(needs)],
        again=(folder / "render_log.msgpack").exists(),
        most_stretches=MOST_STRETCHES,
    )


def _pairs(folder: Path) -> list[dict[str, Any]]:
    """The picture pairs that are there."""
    try:
        listed = json.loads((folder / "key_frames" / "key_frames.json").read_bytes())
    except (OSError, ValueError):
        return []
    return [one for one in listed if (folder / "key_frames" / f"{one['frame']:06d}_perceived.png").exists()]


def _effects(plan: Table) -> list[dict[str, Any]]:
    """Of each effect: how often each level was taken, with the reason that was given first."""
    rows: list[dict[str, Any]] = []
    for effect in EFFECTS if plan else ():
        levels, reasons = np.array(plan[f"{effect.name}_level"]), plan[f"{effect.name}_reason"]
        milliseconds = numbers(plan[f"{effect.name}_ms"])
        for level, count in Counter(levels.tolist()).most_common():
            chosen, ran = levels == level, level not in (SKIPPED, OFF)
            rows.append(
                {
                    "effect": effect.name.replace("_", " "),
                    "level": level,
                    "ran": ran,
                    "share": count / len(levels),
                    "reason": reasons[chosen.argmax()],
                    "ms": float(np.median(milliseconds[chosen])) if ran else 0.0,
                }
            )
    return rows
