"""What every effect costs, as files and as words."""

from __future__ import annotations

import csv
import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from entoptic.pipeline import EFFECTS
from entoptic.pipeline.budget import SHIPPED
from entoptic.pipeline.cost import calibration, everything
from entoptic.pipeline.cost.errors import Errors
from entoptic.pipeline.cost.everything import Cost, Effort, Row
from entoptic.pipeline.cost.scenes import scene
from entoptic.pipeline.cost.timing import Times
from entoptic.pipeline.cost.viewing import SceneViewing
from entoptic.pipeline.cost.whole_frame import COMBINATIONS, Whole, in_words
from entoptic.services.commands.cost import cost as command
from entoptic.services.cost import plots, tables
from entoptic.services.results.folder import LIST

SMALL, LARGE = (24, 26), (48, 52)
SCENES = ("moonlight", "bright room")


def errors(delta_e: float) -> Errors:
    return Errors(delta_e / 100, -delta_e, 3, 4, delta_e / 2, delta_e, min(delta_e / 10, 1.0))


def rows() -> list[Row]:
    found = []
    for effect, name_of_scene in itertools.product(("glare", "night_colour"), SCENES):
        for k, name in enumerate(("skipped", "a setting of some length", "another")):
            times = Times(9.0 * k, k * np.arange(1.0, 4.0)) if k else None
            found.append(Row(effect, name, "truth", name_of_scene, errors(10.0 ** (1 - 2 * k)), times))
    return found


def wholes() -> list[Whole]:
    """The dearer the better, in steps of 4 ms at the large size; the bright room needs nothing."""
    return [
        Whole(
            combination,
            name,
            errors(0.0 if name == "bright room" else 20.0 / (1 + k) ** 2),
            {LARGE: 8.0 + 4 * k, SMALL: 2.0 + k},
        )
        for k, combination in enumerate(COMBINATIONS)
        for name in SCENES
    ]


class TestFiles:
    def test_every_row_is_a_line_and_every_effect_a_plot(self, tmp_path: Path) -> None:
        text = tables.write_everything(tmp_path, Cost(rows(), wholes()[:8]), "a machine")
        lines = list(csv.DictReader((tmp_path / "cost.csv").open(encoding="utf-8")))
        assert [(line["effect"], line["setting"], line["scene"]) for line in lines] == [
            (row.effect, row.setting, row.scene) for row in rows()
        ]
        for line, row in zip(lines, rows(), strict=True):
            assert float(line["delta_e_itp_p95"]) == pytest.approx(row.errors.delta_e_p95)
            assert float(line["share_changed"]) == pytest.approx(row.errors.share_changed, abs=1e-5)
            assert float(line["median_ms"]) == pytest.approx(row.median_ms)
            assert (line["first_ms"] == "") is (row.times is None)
        frames = list(csv.DictReader((tmp_path / "cost-frames.csv").open(encoding="utf-8")))
        assert len(frames) == len(wholes()[:8])
        assert {"ms_24x26", "ms_48x52"} <= set(frames[0])
        assert text == (tmp_path / "cost.md").read_text(encoding="utf-8")
        drawn = {path.name for path in tmp_path.glob("*.png")}
        assert drawn == {"cost-glare.png", "cost-night-colour.png", "cost-whole-frame.png"}
        assert all(2_000 < (tmp_path / name).stat().st_size < 400_000 for name in drawn)

    def test_a_table_has_the_worst_scene_of_each_setting(self) -> None:
        given = [row for row in rows() if row.effect == "glare"]
        worse = [
            Row("glare", "another", "truth", "dusk", errors(7.0), Times(1.0, np.array([4.0]))),
            *given,
        ]
        text = tables.tables(worse)
        line = next(line for line in text.splitlines() if line.startswith("| another"))
        assert line == "| another | truth | 0.07 | -7 | 7 | dusk | 70.00% | 18 | 4.0 |"


class TestAdvice:
    text = tables.advice(wholes(), "a machine")

    def said(self, fps: int) -> list[str]:
        lines = self.text.splitlines()
        start = next(k for k, line in enumerate(lines) if line.startswith(f"**{fps} frames per second"))
        return lines[start + 2 : start + 4]

    def test_what_fits_is_named_with_its_time_and_its_error(self) -> None:
        """At 30 fps, 33.3 ms: the seventh, 32 ms, at the large size; at the small one the last, 21 ms."""
        large, small = self.said(30)
        assert large.startswith(
            f"- 48×52: {in_words(COMBINATIONS[6])}: 32.0 ms; worst scene moonlight, ΔE ITP p95 0.41;"
        )
        assert small.startswith(f"- 24×26: {in_words(COMBINATIONS[-1])}: 21.0 ms;")

    def test_at_the_fastest_rate_only_the_cheapest_fits(self) -> None:
        large, _ = self.said(90)
        assert large.startswith(f"- 48×52: {in_words(COMBINATIONS[0])}: 8.0 ms;")

    def test_where_nothing_fits_it_says_what_the_least_takes(self) -> None:
        slow = [
            Whole(whole.combination, whole.scene, whole.errors, {LARGE: 100.0 + whole.milliseconds[LARGE]})
            for whole in wholes()
        ]
        assert "48×52: nothing fits; with every optional effect left out a frame takes 108.0 ms." in tables.advice(
            slow, "a machine"
        )

    def test_a_bright_room_needs_nothing_at_any_rate(self) -> None:
        line = next(line for line in self.text.splitlines() if line.startswith("| bright room"))
        assert line.count("nothing: 8 ms, 0") == 4


def test_the_command_measures_and_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[Effort, int]] = []

    def run(effort: Effort, rounds: int, done: object) -> Cost:
        asked.append((effort, rounds))
        return Cost(rows(), wholes())

    monkeypatch.setattr(everything, "run", run)
    monkeypatch.setattr(plots, "error_over_time", lambda path, title, rows, kind: path.touch())
    monkeypatch.setattr(plots, "whole_fronts", lambda path, wholes, size: path.touch())
    out = tmp_path / "out"
    result = CliRunner().invoke(command, ["--quick", "--rounds", "2", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert asked == [(everything.QUICK, 2)]
    assert "## Which setting to take" in result.output
    assert {path.name for path in out.iterdir()} - {LIST} == {
        *("cost.csv", "cost-frames.csv", "cost.md"),
        *("cost-glare.png", "cost-night-colour.png", "cost-whole-frame.png"),
    }


def test_a_run_measures_every_effect_of_every_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    """How it goes together; effects, combinations and parts are tested by themselves."""
    only = {"tone": 1.0, "measure": 1.0}
    parts = only | {f"{effect} {level}": 4.0 for one in COMBINATIONS for effect, level in one}
    monkeypatch.setattr(everything, "EFFECTS", tuple(effect for effect in EFFECTS if effect.name == "tone"))
    monkeypatch.setattr(everything, "parts_ms", lambda viewing, rounds, done: parts)
    monkeypatch.setattr(
        everything, "errors_of_combinations", lambda viewing, done: {one: errors(1.0) for one in COMBINATIONS}
    )
    told: list[str] = []
    found = everything.run(Effort(("bright room", "candle room"), SMALL, (SMALL, LARGE), 1), 0, told.append)
    variants = list(everything.EFFECTS[0].variants())
    assert [(row.setting, row.scene) for row in found.rows] == [
        (name, scene) for scene in ("bright room", "candle room") for name in variants
    ]
    assert [whole.combination for whole in found.wholes] == list(COMBINATIONS) * 2
    assert found.wholes[0].milliseconds == {SMALL: 2.0, LARGE: 2.0}
    assert found.wholes[-1].milliseconds[LARGE] == 14.0
    assert len(told) == 2 * (len(variants) + 1)


def test_calibrating_keeps_a_figure_for_every_level(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(calibration, "SIZES", (SMALL,))
    monkeypatch.setattr(calibration, "SCENE", "bright room")
    monkeypatch.setattr("entoptic.services.commands.cost.cache_folder", lambda: tmp_path)
    result = CliRunner().invoke(command, ["--calibrate", "--quick"])
    assert result.exit_code == 0, result.output
    kept = json.loads(next(tmp_path.glob("costs-*.json")).read_text(encoding="utf-8"))["costs"]
    assert {(effect, *levels) for effect, levels in kept.items()} == {
        (effect, *levels) for effect, levels in SHIPPED.costs.items()
    }
    assert kept["tone"]["aces"]["ms_per_megapixel"] + kept["tone"]["aces"]["fixed_ms"] > 0
    assert "aces" in result.output


def test_every_level_of_the_cost_model_is_timed() -> None:
    """So that none keeps its shipped figure, but a person's own curve, and planning."""
    known = {(effect, level) for effect, levels in SHIPPED.costs.items() for level in levels}
    assert known - set(calibration.calls(SceneViewing(scene("bright room", *SMALL), exact=False))) == {
        ("tone", "curve"),
        ("plan", "whole"),
    }
