"""Levels from frame to frame."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.budget import Choice, Option, choose, settle
from entoptic.pipeline.budget.choose import Options
from entoptic.pipeline.budget.steady import CALM_S, FADE_S

FRAME_S = 1 / 24


def glare(veil: float, sources: float, window: float = 0.0) -> Options:
    """Glare's ladder with these errors."""
    return {"glare": (Option("veil", veil, 24.0), Option("sources", sources, 41.0), Option("window", window, 87.0))}


def one(before: Choice | None, options: Options, dt_s: float = FRAME_S, budget_ms: float = math.inf) -> Choice:
    return settle({} if before is None else {"glare": before}, options, dt_s, budget_ms=budget_ms)["glare"]


NIGHT, DAY = glare(12.0, 5.0), glare(0.1, 0.05)


class TestLevels:
    def test_the_first_frame_takes_its_level_without_a_fade(self) -> None:
        assert one(None, NIGHT) == Choice("window")
        assert one(None, DAY).weights == {"veil": 1.0}

    def test_it_goes_up_at_once(self) -> None:
        up = one(Choice("veil"), NIGHT)
        assert (up.level, up.fade_from) == ("window", "veil")

    def test_it_goes_down_after_half_a_second_of_calm(self) -> None:
        choice, frames = one(None, NIGHT), 0
        while choice.level == "window":
            choice, frames = one(choice, DAY), frames + 1
        assert choice.level == "veil"
        assert frames * FRAME_S == pytest.approx(0.5, abs=1.1 * FRAME_S)

    def test_one_frame_of_error_begins_the_wait_anew(self) -> None:
        choice = Choice("window", calm_s={"veil": CALM_S - 1e-3, "sources": CALM_S - 1e-3})
        choice = one(choice, glare(0.3, 0.1))
        assert choice.level == "sources"  # more than half the tolerance, though within it: veil has to wait
        assert one(Choice("window", calm_s={"veil": CALM_S - 1e-3}), glare(0.3, 0.3)).calm_s["veil"] == 0

    def test_within_the_tolerance_nothing_moves(self) -> None:
        choice = Choice("sources")
        for _ in range(100):
            choice = one(choice, glare(0.4, 0.45))
        assert (choice.level, choice.fade_from) == ("sources", None)

    def test_a_level_that_is_no_longer_offered_is_left_without_a_fade(self) -> None:
        assert one(Choice("gone"), NIGHT) == Choice("window")
        fading = one(Choice("window", "gone", 0.3), NIGHT)
        assert (fading.fade_from, fading.fade) == (None, 1.0)

    def test_an_effect_that_is_new_or_gone_leaves_the_others_alone(self) -> None:
        both = {**NIGHT, "tone": (Option("aces", 0.0, 7.0),)}
        before = {"glare": Choice("window"), "halo": Choice("fine")}
        assert set(settle(before, both, FRAME_S)) == {"glare", "tone"}
        assert settle(before, both, FRAME_S)["glare"].fade_from is None

    @pytest.mark.parametrize("seed", range(5))
    def test_errors_that_waver_about_the_tolerance_change_the_level_once(self, seed: int) -> None:
        random = np.random.default_rng(seed)
        choice, changes = one(None, glare(0.4, 0.3)), 0
        bare = []
        for _ in range(24 * 60):
            options = glare(*(float(error) for error in 0.5 * random.uniform(0.6, 1.6, 2)))
            later = one(choice, options)
            changes += later.level != choice.level
            choice = later
            bare.append(choose(options)["glare"])
        assert changes <= 2  # veil to sources to window
        assert sum(a != b for a, b in itertools.pairwise(bare)) > 400

    def test_a_cheaper_level_may_follow_at_once_if_it_is_far_better(self) -> None:
        def odd(cheap: float) -> Options:
            return {"glare": (Option("cheap", cheap, 10.0), Option("dear", 4.0, 20.0))}

        assert one(Choice("dear"), odd(1.9)).level == "cheap"
        assert one(Choice("dear"), odd(2.1)).level == "dear"


class TestBudget:
    def test_what_no_longer_fits_is_given_up_at_once(self) -> None:
        choice = one(Choice("window"), NIGHT, budget_ms=80.0)
        assert (choice.level, choice.fade_from) == ("sources", "window")

    def test_what_fits_is_taken_on_with_a_tenth_to_spare(self) -> None:
        assert one(Choice("sources"), NIGHT, budget_ms=90.0).level == "sources"
        assert one(Choice("sources"), NIGHT, budget_ms=97.0).level == "window"
        assert one(Choice("window"), NIGHT, budget_ms=90.0).level == "window"

    @pytest.mark.parametrize("seed", range(5))
    def test_times_that_waver_about_the_budget_change_the_level_once(self, seed: int) -> None:
        random = np.random.default_rng(seed)
        choice, changes = one(None, NIGHT, budget_ms=100.0), 0
        for _ in range(24 * 60):
            ladder = [
                option._replace(ms=option.ms * float(random.uniform(0.96, 1.04)) * 100 / 87)
                for option in NIGHT["glare"]
            ]
            later = one(choice, {"glare": ladder}, budget_ms=100.0)
            changes += later.level != choice.level
            choice = later
        assert changes <= 1

    def test_two_effects_that_are_as_good_as_each_other_do_not_take_turns(self) -> None:
        random = np.random.default_rng(0)
        choices: dict[str, Choice] = {}
        changes = 0
        for _ in range(24 * 60):
            options = {
                effect: (Option("skipped", float(random.uniform(4, 6)), 0.0), Option("on", 0.0, 40.0))
                for effect in ("a", "b")
            }
            later = settle(choices, options, FRAME_S, budget_ms=60.0)
            assert sum(choice.level == "on" for choice in later.values()) == 1
            changes += bool(choices) and [c.level for c in later.values()] != [c.level for c in choices.values()]
            choices = later
        assert changes == 0

    def test_a_trade_that_halves_the_error_is_made(self) -> None:
        options = {
            "a": (Option("skipped", 1.0, 0.0), Option("on", 0.0, 40.0)),
            "b": (Option("skipped", 9.0, 0.0), Option("on", 0.0, 40.0)),
        }
        later = settle({"a": Choice("on"), "b": Choice("skipped")}, options, FRAME_S, budget_ms=60.0)
        assert {effect: choice.level for effect, choice in later.items()} == {"a": "skipped", "b": "on"}

    def test_where_nothing_fits_the_cheapest_are_taken(self) -> None:
        assert one(Choice("window"), NIGHT, budget_ms=1.0).level == "veil"
        assert one(Choice("veil"), NIGHT, budget_ms=1.0).level == "veil"

    @given(
        st.lists(st.tuples(st.floats(0, 20), st.floats(0, 20), st.floats(0, 20)), min_size=1, max_size=20),
        st.floats(45, 200),
    )
    def test_what_is_aimed_at_fits_the_budget_wherever_something_does(
        self, errors: list[tuple[float, float, float]], budget_ms: float
    ) -> None:
        choices: dict[str, Choice] = {}
        for a, b, c in errors:
            options = {"x": glare(a, b, c)["glare"], "y": (Option("skipped", c, 0.0), Option("on", 0.0, 30.0))}
            choices = settle(choices, options, 1.0, budget_ms=budget_ms)
            spent = sum(o.ms for effect, of in options.items() for o in of if o.level == choices[effect].level)
            assert spent <= budget_ms

    def test_the_same_input_settles(self) -> None:
        random = np.random.default_rng(1)
        for _ in range(50):
            options = {
                str(k): tuple(
                    Option(str(j), float(error), float(milliseconds))
                    for j, (error, milliseconds) in enumerate(random.uniform(0, 10, (4, 2)))
                )
                for k in range(4)
            }
            budget_ms = float(random.uniform(5, 40))
            choices: dict[str, Choice] = {}
            seen = []
            for _ in range(40):
                choices = settle(choices, options, 0.3, budget_ms=budget_ms)
                seen.append(tuple(choice.level for choice in choices.values()))
            assert len(set(seen[-20:])) == 1


class TestFade:
    def test_the_weight_grows_evenly_over_a_fifth_of_a_second(self) -> None:
        choice = one(Choice("veil"), NIGHT, 0.05)
        for weight in (0.25, 0.5, 0.75):
            assert choice.weights == pytest.approx({"window": weight, "veil": 1 - weight})
            choice = one(choice, NIGHT, 0.05)
        assert choice.weights == {"window": 1.0}
        assert choice.fade_from is None

    @given(st.lists(st.floats(1e-6, 0.05), min_size=1, max_size=30))
    def test_steps_of_any_length_add_up(self, steps: list[float]) -> None:
        choice = one(Choice("veil"), NIGHT, 0.0)
        for step in steps:
            choice = one(choice, NIGHT, step)
        expected = min(sum(steps) / FADE_S, 1.0)
        assert choice.weights.get("window", 0.0) == pytest.approx(expected, rel=1e-9)

    def test_a_change_back_turns_it_round_where_it_stands(self) -> None:
        choice = one(Choice("sources"), NIGHT, 0.15)
        assert choice.weights == pytest.approx({"window": 0.75, "sources": 0.25})
        choice = one(choice, NIGHT, 0.0, budget_ms=80.0)
        assert (choice.level, choice.fade_from) == ("sources", "window")
        assert choice.weights == pytest.approx({"window": 0.75, "sources": 0.25})
        choice = one(choice, NIGHT, 0.1, budget_ms=80.0)
        assert choice.weights == pytest.approx({"window": 0.25, "sources": 0.75})

    def test_a_third_level_waits_for_its_end(self) -> None:
        choice = one(Choice("veil"), NIGHT, 0.1)
        for _ in range(3):
            choice = one(choice, NIGHT, 0.04, budget_ms=50.0)
        assert (choice.level, choice.fade_from) == ("window", None)
        choice = one(choice, NIGHT, 0.04, budget_ms=50.0)
        assert (choice.level, choice.fade_from) == ("sources", "window")

    @given(st.lists(st.tuples(st.sampled_from([NIGHT, DAY]), st.floats(20, 200), st.floats(0, 0.1)), max_size=40))
    def test_no_picture_jumps(self, frames: list[tuple[Options, float, float]]) -> None:
        """No level's weight changes by more in a frame than the time allows."""
        choice = one(None, NIGHT)
        for options, budget_ms, dt_s in frames:
            later = one(choice, options, dt_s, budget_ms)
            for level in ("veil", "sources", "window"):
                assert abs(later.weights.get(level, 0.0) - choice.weights.get(level, 0.0)) <= dt_s / FADE_S + 1e-9
            assert sum(later.weights.values()) == pytest.approx(1)
            choice = later

    @pytest.mark.parametrize("dt_s", [0.0, -5.0, math.nan])
    def test_no_time_at_all_changes_no_picture(self, dt_s: float) -> None:
        before = Choice("window", "veil", 0.4, {"veil": 0.2, "sources": 0.0, "window": 0.3})
        assert one(before, DAY, dt_s) == dataclasses.replace(before, calm_s={**before.calm_s})
        assert one(Choice("veil"), NIGHT, dt_s).weights == {"veil": 1.0}

    def test_a_long_pause_ends_a_fade(self) -> None:
        assert one(Choice("veil"), NIGHT, 1e9) == Choice("window")
