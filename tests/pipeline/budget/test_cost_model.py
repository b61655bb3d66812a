"""Predicted times: fitted, kept, corrected."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.errors import OutputError
from entoptic.pipeline import EFFECTS
from entoptic.pipeline.budget import (
    SHIPPED,
    Choice,
    Cost,
    CostModel,
    Option,
    Timing,
    calibrate,
    corrected,
    costs_file,
    device_name,
    fitted,
    load,
    save,
    settle,
)
from entoptic.pipeline.budget.costs import CORRECTION, FORGETTING, OUTLIER, SLOWEST
from entoptic.pipeline.effects.glare import GlareLevel
from entoptic.pipeline.effects.night_colour import NightMethod
from entoptic.pipeline.effects.tone import Operator
from entoptic.pipeline.frame import FrameError

MODEL = CostModel(
    {
        "glare": {"veil": Cost(5.0, 10.0), "window": Cost(20.0, 30.0)},
        "tone": {"aces": Cost(0.0, 3.0)},
        "measure": {"whole": Cost(1.0, 6.0)},
        "encode": {"whole": Cost(0.0, 5.0)},
    }
)


def test_the_shipped_figures_are_those_of_the_performance_page() -> None:
    at_2_3 = {"eighth": 36.1, "quarter": 60.0, "half": 156.7, "full": 679.7}
    for level, milliseconds in at_2_3.items():
        assert SHIPPED.ms("glare", level, 1.44 * 1.6) == pytest.approx(milliseconds, rel=0.02)


def test_every_effect_and_each_of_its_levels_has_a_shipped_figure() -> None:
    assert {effect.name for effect in EFFECTS} <= set(SHIPPED.costs)
    enums = {"glare": GlareLevel, "tone": Operator, "night_colour": NightMethod}
    for effect, levels in enums.items():
        assert {level.value for level in levels} == set(SHIPPED.costs[effect])


def test_a_level_without_a_figure_costs_what_the_dearest_does() -> None:
    assert MODEL.ms("glare", "new", 2.0) == MODEL.ms("glare", "window", 2.0) == 80.0


def test_an_effect_without_any_figure_is_named() -> None:
    with pytest.raises(FrameError, match=r"halo costs is not known; measure it: entoptic cost --calibrate"):
        MODEL.ms("halo", "fine", 1.0)


class TestFitted:
    @given(st.floats(0, 100), st.floats(0.1, 100))
    def test_times_on_a_line_give_the_line(self, fixed_ms: float, slope_ms: float) -> None:
        timings = [Timing("a", "b", size, fixed_ms + slope_ms * size) for size in (0.2, 1.0, 4.0)]
        found = fitted(timings)["a"]["b"]
        assert found.fixed_ms == pytest.approx(fixed_ms, rel=1e-6, abs=1e-6)
        assert found.ms_per_megapixel == pytest.approx(slope_ms, rel=1e-6, abs=1e-6)

    def test_neither_part_is_negative(self) -> None:
        faster_when_larger = fitted([Timing("a", "b", 1.0, 5.0), Timing("a", "b", 2.0, 4.0)])["a"]["b"]
        assert faster_when_larger.ms_per_megapixel == 0
        assert 4 < faster_when_larger.fixed_ms < 5
        steeper_than_proportional = fitted([Timing("a", "b", 1.0, 1.0), Timing("a", "b", 2.0, 4.0)])["a"]["b"]
        assert steeper_than_proportional.fixed_ms == 0

    def test_one_slow_frame_of_many_does_not_count(self) -> None:
        timings = [Timing("a", "b", size, 10 * size) for size in (1.0, 2.0) for _ in range(5)]
        assert fitted([*timings, Timing("a", "b", 1.0, 1e4)])["a"]["b"].ms(1.0) == pytest.approx(10)

    def test_measured_at_one_size_it_grows_with_the_pixels(self) -> None:
        assert fitted([Timing("a", "b", 2.0, 10.0)])["a"]["b"] == Cost(0.0, 5.0)

    def test_a_time_of_0_says_nothing(self) -> None:
        assert fitted([Timing("a", "b", 2.0, 0.0), Timing("a", "b", 0.0, 3.0)]) == {}


def test_calibrating_takes_turns_and_leaves_the_first_round_out() -> None:
    told: list[str] = []

    def frame(name: str, megapixels: float) -> Callable[[], list[Timing]]:
        def run() -> list[Timing]:
            compiles = 1000.0 if name not in told else 0.0
            told.append(name)
            return [Timing("tone", "aces", megapixels, 2 * SHIPPED.ms("tone", "aces", megapixels) + compiles)]

        return run

    model = calibrate([frame("small", 0.5), frame("large", 2.0)], 3, lambda: told.append("done"))
    assert told == ["small", "done", "large", "done"] * 4
    assert model.ms("tone", "aces", 1.0) == pytest.approx(2 * SHIPPED.ms("tone", "aces", 1.0))
    # What was not measured is as much slower as what was.
    assert model.ms("glare", "window", 1.0) == pytest.approx(2 * SHIPPED.ms("glare", "window", 1.0))


class TestDevice:
    def test_what_is_kept_comes_back(self, tmp_path: Path) -> None:
        path = save(MODEL, tmp_path / "new", "Some Card (2)")
        assert path == costs_file(tmp_path / "new", "Some Card (2)")
        assert path.name == "costs-some-card-2.json"
        assert load(tmp_path / "new", "Some Card (2)").ms("glare", "window", 3.0) == MODEL.ms("glare", "window", 3.0)
        assert [each.name for each in (tmp_path / "new").iterdir()] == [path.name]

    def test_a_level_newer_than_the_file_has_its_shipped_figure(self, tmp_path: Path) -> None:
        save(MODEL, tmp_path, "d")
        loaded = load(tmp_path, "d")
        assert loaded.costs["glare"]["half"] == SHIPPED.costs["glare"]["half"]
        assert loaded.costs["acuity"] == SHIPPED.costs["acuity"]

    def test_another_device_has_its_own(self, tmp_path: Path) -> None:
        save(MODEL, tmp_path, "one")
        assert load(tmp_path, "other") == SHIPPED
        assert load(tmp_path) == SHIPPED
        assert device_name()

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("{", r"delete it, or run: entoptic cost --calibrate"),
            ('{"version": 1, "device": "d", "costs": {"a": {"b": {"fixed_ms": -1, "ms_per_megapixel": 0}}}}', r">= 0"),
            ('{"version": 9, "device": "d", "costs": {}}', r"of form 9, this program writes 1"),
            ('{"version": 1, "device": "d", "costs": {}, "more": 1}', r"more"),
        ],
    )
    def test_a_file_that_cannot_be_is_refused_by_name(self, tmp_path: Path, text: str, message: str) -> None:
        costs_file(tmp_path, "d").write_text(text, encoding="utf-8")
        with pytest.raises(FrameError, match=message) as caught:
            load(tmp_path, "d")
        assert "costs-d.json" in str(caught.value)
        assert "\n" not in str(caught.value)

    def test_a_folder_that_cannot_be_written_is_named(self, tmp_path: Path) -> None:
        (tmp_path / "file").write_text("", encoding="utf-8")
        with pytest.raises(OutputError, match=r"costs-d\.json cannot be written"):
            save(MODEL, tmp_path / "file", "d")


def ran(slower: float, **levels: float) -> list[Timing]:
    """A frame of a megapixel in which measuring, tone and encoding took so much longer, and glare as said."""
    parts = [Timing(effect, "whole", 1.0, slower * MODEL.ms(effect, "whole", 1.0)) for effect in ("measure", "encode")]
    parts.append(Timing("tone", "aces", 1.0, slower * 3.0))
    return [*parts, *(Timing("glare", level, 1.0, milliseconds) for level, milliseconds in levels.items())]


class TestCorrected:
    def test_a_slower_machine_is_followed_by_a_tenth_each_frame(self) -> None:
        """Closed form of the moving mean: after n frames at twice the time the model is off by 2^(0.9ⁿ)."""
        model = MODEL
        for _ in range(20):
            model = corrected(model, ran(2.0, window=100.0))
        assert model.ms("glare", "window", 1.0) == pytest.approx(100 / 2 ** ((1 - CORRECTION) ** 20), rel=1e-9)
        # A level that did not run follows the machine.
        assert model.ms("glare", "veil", 1.0) == pytest.approx(15 * model.pace)
        assert model.pace == pytest.approx(2 ** (1 - (1 - CORRECTION) ** 20))

    def test_a_level_that_is_dearer_than_predicted_is_no_slow_machine(self) -> None:
        model = MODEL
        for _ in range(100):
            model = corrected(model, ran(1.0, window=90.0))
        assert model.pace == 1.0
        assert model.ms("glare", "window", 1.0) == pytest.approx(90, rel=1e-3)
        assert model.ms("glare", "veil", 1.0) == 15.0

    def test_each_level_finds_its_own_time_on_any_machine(self) -> None:
        model = MODEL
        for _ in range(300):
            model = corrected(model, ran(3.0, window=60.0))
        assert model.ms("glare", "window", 1.0) == pytest.approx(60, rel=1e-3)
        assert model.ms("tone", "aces", 1.0) == pytest.approx(9, rel=1e-3)

    def test_what_does_not_run_forgets_what_was_its_own(self) -> None:
        model = CostModel(MODEL.costs, 1.0, {("glare", "window"): 3.0})
        for _ in range(1000):
            model = corrected(model, [Timing("tone", "aces", 1.0, 3.0)])
        assert model.own["glare", "window"] == pytest.approx(3 ** ((1 - FORGETTING) ** 1000))
        assert 2 < model.own["glare", "window"] < 2.6

    def test_a_frame_that_compiles_hardly_moves_it(self) -> None:
        model = corrected(MODEL, ran(1.0, window=6000.0))
        assert model.ms("glare", "window", 1.0) == pytest.approx(50 * OUTLIER**CORRECTION)
        assert model.pace == 1.0

    def test_right_times_change_nothing(self) -> None:
        model = corrected(MODEL, ran(1.0, veil=15.0))
        assert model.pace == pytest.approx(1)
        assert list(model.own.values()) == pytest.approx([1] * 4)

    def test_what_is_not_modelled_or_took_no_time_changes_nothing(self) -> None:
        assert corrected(MODEL, [Timing("kernel", "", 1.0, 300.0), Timing("tone", "aces", 1.0, 0.0)]) == MODEL
        assert corrected(MODEL, []) == MODEL

    @given(st.lists(st.tuples(st.sampled_from(["veil", "window"]), st.floats(1e-6, 1e9)), max_size=30))
    def test_whatever_is_measured_times_stay_finite_and_positive(self, seen: list[tuple[str, float]]) -> None:
        model = MODEL
        for level, milliseconds in seen:
            model = corrected(model, ran(milliseconds, **{level: milliseconds}))
        assert 0 < model.ms("glare", "veil", 1.0) < math.inf
        assert 1 / SLOWEST <= model.pace <= SLOWEST

    @pytest.mark.parametrize(
        ("machine", "window_ms", "fits"), [(1.0, 100.0, False), (1.0, 60.0, True), (2.0, 60.0, True)]
    )
    def test_in_the_loop_a_noisy_machine_settles(self, machine: float, window_ms: float, fits: bool) -> None:
        """Predicted 50 ms for the window, and 80 for glare: it stays if it truly fits, else it goes for long."""
        random = np.random.default_rng(3)
        model, levels = MODEL, []
        choices: dict[str, Choice] = {}
        true_ms = {"veil": 15.0 * machine, "window": window_ms}
        for _ in range(24 * 60):
            glare = tuple(
                Option(level, error, model.ms("glare", level, 1.0)) for level, error in (("veil", 9.0), ("window", 0.0))
            )
            choices = settle(choices, {"glare": glare}, 1 / 24, budget_ms=80.0)
            level = choices["glare"].level
            levels.append(level)
            noise = [float(factor) for factor in random.lognormal(0.0, 0.15, 4)]
            parts = ran(machine, **{level: true_ms[level]})
            model = corrected(
                model, [part._replace(milliseconds=part.milliseconds * f) for part, f in zip(parts, noise, strict=True)]
            )
        changes = sum(a != b for a, b in itertools.pairwise(levels))
        assert (levels.count("window") > 0.95 * len(levels)) is fits
        assert changes <= (0 if fits else 5)  # to the veil, and two trials
        assert fits or levels.count("window") < 0.05 * len(levels)
