"""What accuracy costs in time, as tables and plots in a folder."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

from entoptic.pipeline.cost.comparison import Row
from entoptic.pipeline.cost.errors import Errors
from entoptic.pipeline.cost.sun_corner import SunCorner
from entoptic.pipeline.cost.timing import Times
from entoptic.services.cost import glare_plots as cost_plots

TABLE, TEXT, CORNER_TABLE, CORNER_PLOT = "cost-glare.csv", "cost-glare.md", "sun-corner.csv", "sun-corner.png"
ERROR_COLUMNS = (
    "relative_l2",
    "worst_cd_m2",
    "worst_x_px",
    "worst_y_px",
    "delta_e_itp_mean",
    "delta_e_itp_p95",
    "share_changed",
)
TIME_COLUMNS = ("first_ms", "median_ms", "lower_quartile_ms", "upper_quartile_ms", "rounds")
COLUMNS = ("group", "setting", "scene", *ERROR_COLUMNS, *TIME_COLUMNS)


def write(folder: Path, rows: Sequence[Row], corner: SunCorner, notes: Mapping[str, str]) -> str:
    """Writes tables and plots, and gives the tables as Markdown; `notes` says what is varied in each group."""
    with (folder / TABLE).open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(_cells(row) for row in rows)
    text = "\n".join(
        _section(group, note, [row for row in rows if row.group == group]) for group, note in notes.items()
    )
    (folder / TEXT).write_text(text, encoding="utf-8")
    for scene in dict.fromkeys(row.scene for row in rows):
        name = f"cost-glare-{scene.replace(' ', '-')}.png"
        cost_plots.error_over_time(folder / name, [row for row in rows if row.scene == scene], scene)
    _write_corner(folder / CORNER_TABLE, corner)
    cost_plots.sun_corner(folder / CORNER_PLOT, corner)
    return text


def error_cells(errors: Errors) -> list[object]:
    """What stands under ERROR_COLUMNS."""
    return [
        f"{errors.relative_l2:.4g}",
        f"{errors.worst_cd_m2:.4g}",
        errors.worst_x_px,
        errors.worst_y_px,
        f"{errors.delta_e_mean:.4g}",
        f"{errors.delta_e_p95:.4g}",
        f"{errors.share_changed:.5f}",
    ]


def time_cells(times: Times) -> list[object]:
    """What stands under TIME_COLUMNS."""
    milliseconds = (times.first_ms, times.median_ms, *times.middle_half_ms)
    return [*(f"{value:.3f}" for value in milliseconds), len(times.steady_ms)]


def _cells(row: Row) -> list[object]:
    return [row.group, row.setting, row.scene, *error_cells(row.errors), *time_cells(row.times)]


def _section(group: str, note: str, rows: Sequence[Row]) -> str:
    lines = [
        f"### {group}",
        "",
        note,
        "",
        "| setting | scene | relative L2 | worst cd/m² (at x, y px) | ΔE ITP mean | 95 % below | first ms | median ms "
        "| middle half |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for row in rows:
        errors, times = row.errors, row.times
        low, high = times.middle_half_ms
        lines.append(
            f"| {row.setting} | {row.scene} | {errors.relative_l2:.2g} | {errors.worst_cd_m2:.2g} "
            f"({errors.worst_x_px}, {errors.worst_y_px}) | {errors.delta_e_mean:.2g} | {errors.delta_e_p95:.2g} "
            f"| {times.first_ms:.0f} | {times.median_ms:.1f} | {low:.1f}–{high:.1f} |"
        )
    return "\n".join([*lines, ""])


def _write_corner(path: Path, corner: SunCorner) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        ways = (f"{name.replace(' ', '_')}_error_p95_cd_m2" for name in corner.error_cd_m2)
        writer.writerow(["from_sun_deg", "truth_cd_m2", *ways])
        for deg, truth, *errors in zip(corner.deg, corner.truth_cd_m2, *corner.error_cd_m2.values(), strict=True):
            writer.writerow([f"{deg:.2f}", *(f"{value:.4g}" for value in (truth, *errors))])
