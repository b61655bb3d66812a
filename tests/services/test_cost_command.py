"""What accuracy costs in time, as files."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from typer.testing import CliRunner

from entoptic.pipeline import GlareLevel
from entoptic.pipeline.cost import glare
from entoptic.pipeline.cost.errors import Errors
from entoptic.pipeline.cost.everything import Row
from entoptic.pipeline.cost.sun_corner import SunCorner
from entoptic.pipeline.cost.timing import Times
from entoptic.services.commands.cost import cost as command
from entoptic.services.cost import plots, tables
from entoptic.services.results.folder import LIST

NOTES = glare.notes(glare.QUICK)
SCENES = ("night street",)
CORNER = SunCorner(np.array([1.5, 2.5]), np.array([10.0, 2.0]), {"plain": np.array([4.0, 4.0])}, 1e-3)


def row(group: str, label: str, scene: str, error: float, milliseconds: float) -> Row:
    errors = Errors(error, -2 * error, 3, 4, error / 2, error, error / 3)
    return Row(group, label, "truth", scene, errors, Times(9 * milliseconds, milliseconds * np.arange(1.0, 4.0)))


def made_up() -> list[Row]:
    labels = itertools.product(NOTES, ("some long name of a setting", "another", "a third one"), SCENES)
    random = np.random.default_rng(1)
    values = random.uniform(1, 1.3, (len(NOTES) * 3, 2)).tolist()
    return [
        row(group, f"{label}, {group}", scene, error * 1e-3, milliseconds * 100)
        for (group, label, scene), (error, milliseconds) in zip(labels, values, strict=True)
    ]


class TestFiles:
    def test_every_row_is_a_line_every_group_a_table_and_every_scene_a_small_picture(self, tmp_path: Path) -> None:
        rows = made_up()
        text = tables.write_glare(tmp_path, glare.GlareCost(rows, CORNER), NOTES)
        lines = list(csv.DictReader((tmp_path / "cost-glare.csv").open(encoding="utf-8")))
        assert [(line["group"], line["setting"], line["scene"]) for line in lines] == [
            (each.effect, each.setting, each.scene) for each in rows
        ]
        for line, each in zip(lines, rows, strict=True):
            assert float(line["relative_l2"]) == pytest.approx(each.errors.relative_l2, rel=1e-3)
            assert float(line["worst_cd_m2"]) == pytest.approx(each.errors.worst_cd_m2, rel=1e-3)
            assert (line["worst_x_px"], line["worst_y_px"], line["rounds"]) == ("3", "4", "3")
            assert float(line["first_ms"]) > float(line["upper_quartile_ms"]) > float(line["median_ms"])
            assert float(line["median_ms"]) > float(line["lower_quartile_ms"])
        assert text == (tmp_path / "cost-glare.md").read_text(encoding="utf-8")
        assert [line[4:] for line in text.splitlines() if line.startswith("### ")] == list(NOTES)
        assert sum(line.startswith("| ") for line in text.splitlines()) == len(rows) + len(NOTES)
        corner = list(csv.DictReader((tmp_path / "sun-corner.csv").open(encoding="utf-8")))
        assert [float(line["plain_error_p95_cd_m2"]) for line in corner] == [4, 4]

        drawn = sorted(path.name for path in tmp_path.glob("*.png"))
        assert drawn == ["cost-glare-night-street.png", "sun-corner.png"]
        assert all(2_000 < (tmp_path / name).stat().st_size < 300_000 for name in drawn)

    def test_an_error_of_0_can_be_drawn(self, tmp_path: Path) -> None:
        rows = [row("a", label, "s", 0.0, 5.0) for label in ("one", "two")]
        plots.error_over_time(tmp_path / "plot.png", "s", rows, lambda row: row.effect)
        assert (tmp_path / "plot.png").exists()

    def test_no_label_lies_on_another(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        figures: list[Figure] = []
        monkeypatch.setattr(Figure, "savefig", lambda figure, path, **_: figures.append(figure))
        plots.error_over_time(tmp_path / "plot.png", "s", made_up(), lambda row: row.effect)
        figures[0].draw_without_rendering()
        for axes in figures[0].axes:
            boxes = [Text.get_window_extent(text) for text in axes.texts]  # without their lines
            assert len(boxes) == 3 * len(NOTES)
            for one, other in itertools.combinations(boxes, 2):
                assert not one.shrunk(0.9, 0.7).overlaps(other.shrunk(0.9, 0.7))


def test_the_quick_command_measures_every_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []

    def run(effort: glare.Effort, rounds: int, done: Callable[[str], None]) -> glare.GlareCost:
        return measure(effort, rounds, lambda label: (told.append(label), done(label))[1])

    measure = glare.run
    monkeypatch.setattr(glare, "run", run)
    out = tmp_path / "out"
    result = CliRunner().invoke(command, ["glare", "--quick", "--rounds", "1", "--out", str(out)])
    assert result.exit_code == 0, result.output
    lines = list(csv.DictReader((out / "cost-glare.csv").open(encoding="utf-8")))
    assert {line["group"] for line in lines} == set(NOTES)
    assert {line["setting"] for line in lines if line["group"] == glare.LEVELS} == {level.value for level in GlareLevel}
    assert all(float(line["median_ms"]) > 0 and line["rounds"] == "1" for line in lines)
    errors = {line["setting"]: float(line["relative_l2"]) for line in lines}
    # Frames as small as these are hardly pooled at any level.
    assert errors["full"] <= errors["eighth"] < 0.25
    assert len(told) == glare.steps(glare.QUICK, 1)
    assert {path.name for path in out.iterdir()} - {LIST} == {
        *("cost-glare.csv", "cost-glare.md", "cost-glare-sun-over-dark.png", "sun-corner.csv", "sun-corner.png")
    }
