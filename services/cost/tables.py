"""What accuracy costs in time, as tables, plots and words in a folder."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from entoptic.pipeline.cost.errors import Errors
from entoptic.pipeline.cost.everything import RATES_FPS, Cost, Row
from entoptic.pipeline.cost.glare import GlareCost
from entoptic.pipeline.cost.sun_corner import SunCorner
from entoptic.pipeline.cost.whole_frame import Choice, Size, Whole, choose, in_words
from entoptic.pipeline.effects.effect import SKIPPED
from entoptic.services.cost import plots

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
COLUMNS = ("setting", "truth", "scene", *ERROR_COLUMNS, *TIME_COLUMNS)


def write_everything(folder: Path, cost: Cost, device: str) -> str:
    """Writes tables, plots and the advice, and gives the advice."""
    rows, wholes = cost.rows, cost.wholes
    _write_csv(folder / "cost.csv", ("effect", *COLUMNS), map(_cells, rows))
    sizes = list(wholes[0].milliseconds)
    header = (*(effect for effect, _ in wholes[0].combination), "scene", *ERROR_COLUMNS)
    lines = (
        [
            *(level for _, level in whole.combination),
            *(whole.scene, *error_cells(whole.errors)),
            *(f"{whole.milliseconds[size]:.2f}" for size in sizes),
        ]
        for whole in wholes
    )
    _write_csv(folder / "cost-frames.csv", (*header, *(f"ms_{w}x{h}" for w, h in sizes)), lines)
    for effect in dict.fromkeys(row.effect for row in rows):
        of_effect, name = [row for row in rows if row.effect == effect], effect.replace("_", "-")
        title = f"{effect.replace('_', ' ')}: error in the worst scene against the oracle, over time"
        plots.error_over_time(folder / f"cost-{name}.png", title, of_effect, lambda row: f"beside {row.of}")
    plots.whole_fronts(folder / "cost-whole-frame.png", wholes, sizes[0])
    text = f"{advice(wholes, device)}\n## Every effect and setting\n\n{tables(rows)}"
    (folder / "cost.md").write_text(text, encoding="utf-8")
    return text


def write_glare(folder: Path, cost: GlareCost, notes: Mapping[str, str]) -> str:
    """Writes tables and plots, and gives the tables as Markdown; `notes` says what is varied in each group."""
    rows, corner = cost.rows, cost.corner
    _write_csv(folder / "cost-glare.csv", ("group", *COLUMNS), map(_cells, rows))
    text = tables(rows, notes)
    (folder / "cost-glare.md").write_text(text, encoding="utf-8")
    for scene in dict.fromkeys(row.scene for row in rows):
        of_scene, title = [row for row in rows if row.scene == scene], f"Glare of one eye: error over time; {scene}"
        path = folder / f"cost-glare-{scene.replace(' ', '-')}.png"
        plots.error_over_time(path, title, of_scene, lambda row: row.effect)
    columns = (f"{name.replace(' ', '_')}_error_p95_cd_m2" for name in corner.error_cd_m2)
    _write_csv(folder / "sun-corner.csv", ("from_sun_deg", "truth_cd_m2", *columns), _corner_cells(corner))
    plots.sun_corner(folder / "sun-corner.png", corner)
    return text


def _write_csv(path: Path, header: Sequence[str], lines: Iterable[Sequence[object]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows([header, *lines])


def _cells(row: Row) -> list[object]:
    times: list[object] = ["", "0", "", "", 0]
    if row.times is not None:
        milliseconds = (row.times.first_ms, row.times.median_ms, *row.times.middle_half_ms)
        times = [*(f"{value:.3f}" for value in milliseconds), len(row.times.steady_ms)]
    return [row.effect, row.setting, row.of, row.scene, *error_cells(row.errors), *times]


def _corner_cells(corner: SunCorner) -> Iterable[list[str]]:
    for deg, truth, *errors in zip(corner.deg, corner.truth_cd_m2, *corner.error_cd_m2.values(), strict=True):
        yield [f"{deg:.2f}", *(f"{value:.4g}" for value in (truth, *errors))]


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


def advice(wholes: Sequence[Whole], device: str) -> str:
    """Which setting to take at which rate, in words, from what was measured."""
    sizes = list(wholes[0].milliseconds)
    lines = ["## Which setting to take", "", f"On {device}, for one eye; two eyes take twice as long."]
    for fps in RATES_FPS:
        lines += ["", f"**{fps:g} frames per second** ({1e3 / fps:.1f} ms):", ""]
        lines += [f"- {_choice_line(choose(wholes, fps, size))}" for size in sizes]
    largest = sizes[0]
    names = list(dict.fromkeys(whole.scene for whole in wholes))
    lines += [
        "",
        f"A scene alone often needs less. What to take at {_size(largest)}, scene by scene, and its ΔE ITP p95:",
        "",
        f"| scene | {' | '.join(f'{fps:g} fps' for fps in RATES_FPS)} |",
        f"|---|{'---|' * len(RATES_FPS)}",
    ]
    for name in names:
        of_scene = [whole for whole in wholes if whole.scene == name]
        cells = [_cell(choose(of_scene, fps, largest)) for fps in RATES_FPS]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join([*lines, ""])


def _choice_line(choice: Choice) -> str:
    if choice.combination is None:
        least = f"{choice.milliseconds:.1f} ms"
        return f"{_size(choice.size)}: nothing fits; with every optional effect left out a frame takes {least}."
    seen = (
        "no scene differs from the truth in any code value"
        if choice.share_changed == 0
        else f"worst scene {choice.worst_scene}, ΔE ITP p95 {choice.delta_e_p95:.2g}; at most "
        f"{choice.share_changed:.1%} of a scene's pixels change by a code value"
    )
    return f"{_size(choice.size)}: {in_words(choice.combination)}: {choice.milliseconds:.1f} ms; {seen}."


def _cell(choice: Choice) -> str:
    if choice.combination is None:
        return f"– ({choice.milliseconds:.0f} ms)"
    taken = " + ".join(level for _, level in choice.combination if level != SKIPPED)
    return f"{taken or 'nothing'}: {choice.milliseconds:.0f} ms, {choice.delta_e_p95:.2g}"


def _size(size: Size) -> str:
    return f"{size[0]}×{size[1]}"


def tables(rows: Sequence[Row], notes: Mapping[str, str] = {}) -> str:
    """A table of each effect, or of what is varied: each setting's worst scene, and the median of its times."""
    lines = ["Errors are those of the worst scene, times the median over scenes."]
    for effect in dict.fromkeys(row.effect for row in rows):
        lines += ["", f"### {effect.replace('_', ' ')}", ""]
        lines += [notes[effect], ""] if effect in notes else []
        lines += [
            "| setting | beside | relative L2 | worst cd/m² | ΔE ITP p95 | in scene | pixels changed | first ms "
            "| median ms |",
            "|---|---|---:|---:|---:|---|---:|---:|---:|",
        ]
        lines += map(_line, plots.by_setting([row for row in rows if row.effect == effect]))
    return "\n".join([*lines, ""])


def _line(of_setting: Sequence[Row]) -> str:
    worst = max(of_setting, key=lambda row: (row.errors.delta_e_p95, row.errors.share_changed))
    timed = [row.times.first_ms for row in of_setting if row.times is not None]
    first = f"{max(timed):.0f}" if timed else "–"
    return (
        f"| {worst.setting} | {worst.of} | {max(row.errors.relative_l2 for row in of_setting):.2g} "
        f"| {max((row.errors.worst_cd_m2 for row in of_setting), key=abs):.2g} | {worst.errors.delta_e_p95:.2g} "
        f"| {worst.scene if worst.errors.delta_e_p95 > 0 else '–'} "
        f"| {max(row.errors.share_changed for row in of_setting):.2%} | {first} | {_ms(plots.median_ms(of_setting))} |"
    )


def _ms(milliseconds: float) -> str:
    if milliseconds == 0:
        return "0"
    digits = max(0, 1 - math.floor(math.log10(milliseconds)))
    return f"{milliseconds:.{digits}f}"
