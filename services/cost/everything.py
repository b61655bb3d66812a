"""What every effect costs, as tables, plots and words in a folder."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

from entoptic.pipeline.cost.everything import RATES_FPS, Row
from entoptic.pipeline.cost.whole_frame import Choice, Size, Whole, choose, in_words
from entoptic.pipeline.effects.effect import SKIPPED
from entoptic.services.cost import everything_plots as plots
from entoptic.services.cost.glare import ERROR_COLUMNS, TIME_COLUMNS, error_cells, time_cells

TABLE, FRAMES, TEXT, WHOLE_PLOT = "cost.csv", "cost-frames.csv", "cost.md", "cost-whole-frame.png"
COLUMNS = ("effect", "setting", "truth", "scene", *ERROR_COLUMNS, *TIME_COLUMNS)


def write(folder: Path, rows: Sequence[Row], wholes: Sequence[Whole], device: str) -> str:
    """Writes tables, plots and the advice, and gives the advice."""
    with (folder / TABLE).open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(_cells(row) for row in rows)
    sizes = list(wholes[0].milliseconds)
    with (folder / FRAMES).open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(
            [
                *(effect for effect, _ in wholes[0].combination),
                *("scene", *ERROR_COLUMNS, *(f"ms_{w}x{h}" for w, h in sizes)),
            ]
        )
        writer.writerows(_frame_cells(whole, sizes) for whole in wholes)
    for effect in dict.fromkeys(row.effect for row in rows):
        of_effect = [row for row in rows if row.effect == effect]
        plots.effect_front(folder / f"cost-{effect.replace('_', '-')}.png", effect, of_effect)
    plots.whole_fronts(folder / WHOLE_PLOT, wholes, sizes[0])
    text = "\n".join([advice(wholes, device), tables(rows)])
    (folder / TEXT).write_text(text, encoding="utf-8")
    return text


def _cells(row: Row) -> list[object]:
    times = ["", "0", "", "", 0] if row.times is None else time_cells(row.times)
    return [row.effect, row.setting, row.of, row.scene, *error_cells(row.errors), *times]


def _frame_cells(whole: Whole, sizes: Sequence[Size]) -> list[object]:
    times = [f"{whole.milliseconds[size]:.2f}" for size in sizes]
    return [*(level for _, level in whole.combination), whole.scene, *error_cells(whole.errors), *times]


def advice(wholes: Sequence[Whole], device: str) -> str:
    """Which setting to take at which rate, in words, from what was measured."""
    sizes = list(wholes[0].milliseconds)
    lines = ["## Which setting to take", "", f"On {device}, for one eye; two eyes take twice as long."]
    for fps in RATES_FPS:
        lines += ["", f"**{fps:g} frames per second** ({1e3 / fps:.1f} ms):", ""]
        lines += [f"- {_said(choose(wholes, fps, size))}" for size in sizes]
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


def _said(choice: Choice) -> str:
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


def tables(rows: Sequence[Row]) -> str:
    """A table of each effect: every setting, the worst of its scenes, the median of their times."""
    lines = ["## Every effect and setting", "", "Errors are those of the worst scene, times the median over scenes."]
    for effect in dict.fromkeys(row.effect for row in rows):
        lines += [
            "",
            f"### {effect.replace('_', ' ')}",
            "",
            "| setting | beside | relative L2 | worst cd/m² | ΔE ITP p95 | in scene | pixels changed | first ms "
            "| median ms |",
            "|---|---|---:|---:|---:|---|---:|---:|---:|",
        ]
        lines += [_line(of_setting) for of_setting in plots.by_setting(rows, effect)]
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
