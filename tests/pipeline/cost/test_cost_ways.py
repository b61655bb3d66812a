"""Every way of every effect stands beside its truth; the whole frame's choice is the best that fits."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math

import numpy as np
import pytest

from entoptic.pipeline import EFFECTS as ALL
from entoptic.pipeline.cost import everything, scenes, whole_frame
from entoptic.pipeline.cost.errors import Errors
from entoptic.pipeline.cost.ways import EFFECTS, Row, Stage, measure_ways
from entoptic.pipeline.cost.ways.way import NO_ERRORS, SKIPPED, Way, Ways
from entoptic.pipeline.cost.whole_frame import ALWAYS, COMBINATIONS, Combination, Whole, choose, front, time_of

SIZE = (24, 26)


@functools.cache
def stage(name: str) -> Stage:
    return Stage(scenes.scene(name, *SIZE))


@functools.cache
def rows(effect: str, name: str) -> list[Row]:
    return measure_ways(effect, EFFECTS[effect](stage(name)), stage(name), 0)


def by_name(effect: str, name: str) -> dict[str, Row]:
    return {row.setting: row for row in rows(effect, name)}


class TestStage:
    def test_the_pupil_narrows_from_moonlight_to_noon(self) -> None:
        pupils = [stage(name).pose.pupil_mm for name in ("moonlight", "dusk", "sunny landscape")]
        assert pupils == sorted(pupils, reverse=True)
        assert pupils[0] > pupils[-1] + 2

    def test_what_follows_an_effect_is_done_to_its_image_and_what_came_before_is_not(self) -> None:
        at = stage("moonlight")
        last = at.on_display("night_colour", at.tinted.astype(np.float64))
        np.testing.assert_allclose(last, at.tinted * 100.0)
        whole = at.on_display("glare", at.glared.astype(np.float64))
        np.testing.assert_allclose(whole, last, atol=1e-4)


class TestWays:
    def test_all_effects_of_the_plan_are_there(self) -> None:
        assert [*EFFECTS] == [*(effect.name for effect in ALL if effect.name in EFFECTS), "encode"]
        assert {"adaptation", "glare", "acuity", "rod_noise", "tone", "night_colour", "afterimage"} <= {*EFFECTS}

    @pytest.mark.parametrize("effect", ["tone", "night_colour"])
    def test_what_is_computed_per_pixel_is_its_truth_but_for_rounding(self, effect: str) -> None:
        for row in rows(effect, "moonlight"):
            if row.setting != SKIPPED:
                assert row.errors.relative_l2 < 1e-3, row
                assert row.errors.share_changed < 0.02, row

    def test_leaving_the_night_out_is_seen(self) -> None:
        night = by_name("night_colour", "moonlight")
        assert night[SKIPPED].errors.delta_e_p95 > 5
        assert night[SKIPPED].times is None
        assert night[SKIPPED].median_ms == 0
        assert by_name("night_colour", "bright room")[SKIPPED].errors.share_changed < 0.05

    def test_better_levels_of_glare_are_nearer_to_the_reference(self) -> None:
        glare = by_name("glare", "candle room")
        errors = [glare[level].errors.relative_l2 for level in (SKIPPED, "veil", "frame", "reference")]
        assert errors == sorted(errors, reverse=True)
        assert errors[-1] == 0 < errors[-2] < 1e-4
        assert glare["reference"].median_ms > 0

    def test_acuity_is_nearer_to_the_true_filter_than_no_acuity(self) -> None:
        acuity = by_name("acuity", "moonlight")
        assert acuity["fit"].errors.relative_l2 < 0.2 * acuity[SKIPPED].errors.relative_l2
        assert acuity["fit, dark tiles"].errors.relative_l2 == pytest.approx(acuity["fit"].errors.relative_l2, rel=0.01)

    def test_tiles_adapt_as_pixels_do(self) -> None:
        adaptation = by_name("adaptation", "dusk")
        for target in ("lui", "bar-scene", "bar-view"):
            assert adaptation[target].errors.relative_l2 < 0.01

    def test_codes_are_decoded_to_the_light_they_stand_for(self) -> None:
        """8 bits: at most half of the encoding's largest step, 1/255 · 2.4/1.055."""
        encoded = by_name("encode", "dusk")
        assert encoded["linear"].errors.relative_l2 == 0
        assert abs(encoded["srgb"].errors.worst_cd_m2) < 100 * 0.5 / 255 * 2.4 / 1.055
        assert encoded["hdr10"].errors.relative_l2 < encoded["srgb"].errors.relative_l2 * 3

    def test_a_way_has_the_row_of_its_own_truth_alone(self) -> None:
        at = stage("moonlight")
        one, two = np.full((3, 26, 24), 0.2), np.full((3, 26, 24), 0.4)
        ways = Ways(
            [Way("a", lambda: one, "x", np.asarray), Way("b", lambda: one, "y", np.asarray)],
            {"x": lambda: one, "y": lambda: two},
            unit_cd_m2=100.0,
            timed_truth=("y",),
        )
        told: list[str] = []
        found = measure_ways("encode", ways, at, 1, told.append)
        assert [(row.setting, row.of) for row in found] == [("a", "x"), ("b", "y"), ("reference", "y")]
        assert found[0].errors == dataclasses.replace(NO_ERRORS)
        assert found[1].errors.relative_l2 == pytest.approx(0.5)
        assert found[1].errors.worst_cd_m2 == pytest.approx(-20.0)
        assert told == ["a", "b"] * 2 + ["encode truth"] * 2


def whole(combination: Combination, scene: str, delta_e: float, milliseconds: float) -> Whole:
    errors = Errors(delta_e, 0.0, 0, 0, delta_e, delta_e, min(delta_e, 1.0))
    return Whole(combination, scene, errors, {SIZE: milliseconds})


class TestWholeFrame:
    cheap, middle, best = COMBINATIONS[0], COMBINATIONS[5], COMBINATIONS[-1]

    def made_up(self) -> list[Whole]:
        figures = {self.cheap: (40.0, 5.0), self.middle: (4.0, 15.0), self.best: (0.5, 30.0)}
        return [
            whole(combination, scene, delta_e * harder, ms * harder)
            for (combination, (delta_e, ms)), (scene, harder) in itertools.product(
                figures.items(), (("easy", 1.0), ("hard", 2.0))
            )
        ]

    def test_the_best_that_fits_the_slowest_scene_is_taken(self) -> None:
        for fps, expected in ((90, self.cheap), (30, self.middle), (5, self.best)):
            taken = choose(self.made_up(), fps, SIZE)
            assert taken.combination == expected
            assert taken.milliseconds <= 1e3 / fps
            assert taken.worst_scene == "hard"

    def test_where_nothing_fits_it_says_so_with_the_least_time(self) -> None:
        taken = choose(self.made_up(), 1000, SIZE)
        assert taken.combination is None
        assert taken.milliseconds == 10
        assert math.isnan(taken.delta_e_p95)

    def test_of_equals_the_fastest(self) -> None:
        equal = [whole(self.best, "a", 0.001, 9.0), whole(self.middle, "a", 0.0009, 5.0)]
        equal = [dataclasses.replace(one, errors=dataclasses.replace(one.errors, share_changed=0.0)) for one in equal]
        assert choose(equal, 30, SIZE).combination == self.middle

    def test_the_front_goes_from_cheap_to_good(self) -> None:
        easy = [one for one in self.made_up() if one.scene == "easy"]
        dominated = whole(COMBINATIONS[1], "easy", 4.5, 16.0)
        assert [one.combination for one in front([dominated, *easy], SIZE)] == [self.cheap, self.middle, self.best]

    def test_a_frame_takes_the_sum_of_its_parts(self) -> None:
        parts = dict.fromkeys(ALWAYS, 1.0) | {"glare veil": 10.0, "acuity fit": 100.0, "night_colour lui": 1000.0}
        assert time_of(Combination(SKIPPED, SKIPPED, SKIPPED), parts) == len(ALWAYS)
        assert time_of(Combination("veil", SKIPPED, "lui"), parts) == len(ALWAYS) + 1010

    def test_everything_in_full_is_nearest_to_the_truth_and_parts_are_all_timed(self) -> None:
        errors = whole_frame.errors_of_combinations(stage("moonlight"))
        assert min(errors, key=lambda combination: errors[combination].delta_e_p95) == Combination(
            "frame", "fit", "lui"
        )
        parts = whole_frame.parts_ms(stage("moonlight"), 0)
        assert all(time_of(combination, parts) > 0 for combination in errors)
        assert len(parts) == everything.PARTS
