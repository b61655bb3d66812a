"""Every variant of every effect stands beside its oracle; the whole frame's choice is the best that fits."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math

import numpy as np
import pytest

from entoptic.pipeline import EFFECTS
from entoptic.pipeline.cost import scenes, whole_frame
from entoptic.pipeline.cost.errors import Errors
from entoptic.pipeline.cost.everything import Row, measure_effect
from entoptic.pipeline.cost.viewing import SceneViewing
from entoptic.pipeline.cost.whole_frame import COMBINATIONS, Combination, Whole, choose, front, time_of
from entoptic.pipeline.plan import SKIPPED

SIZE = (24, 26)
BY_NAME = {effect.name: effect for effect in EFFECTS}


@functools.cache
def viewing(name: str) -> SceneViewing:
    return SceneViewing(scenes.scene(name, *SIZE))


@functools.cache
def rows(effect: str, name: str) -> dict[str, Row]:
    return {row.setting: row for row in measure_effect(BY_NAME[effect], viewing(name), 0)}


class TestViewing:
    def test_the_pupil_narrows_from_moonlight_to_noon(self) -> None:
        pupils = [viewing(name).pupil_diameter_mm for name in ("moonlight", "dusk", "sunny landscape")]
        assert pupils == sorted(pupils, reverse=True)
        assert pupils[0] > pupils[-1] + 2

    def test_what_follows_an_effect_is_done_to_its_image_and_what_came_before_is_not(self) -> None:
        at = viewing("moonlight")
        acuity, tone = BY_NAME["acuity"], BY_NAME["tone"]
        shown = at.on_display(acuity, np.asarray(at.before(tone).image[0], np.float64))
        last = np.asarray(at.before(EFFECTS[-1]).image[0], np.float64)
        np.testing.assert_allclose(shown, np.clip(last, 0, 1) * 100.0, atol=1e-4)


class TestEffects:
    @pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
    def test_there_is_a_row_of_each_variant_and_of_leaving_it_out(self, effect) -> None:  # type: ignore[no-untyped-def]
        found = rows(effect.name, "moonlight")
        assert [*found] == [*([SKIPPED] if effect.optional else []), *effect.variants()]
        assert all((row.times is None) == (name == SKIPPED) for name, row in found.items())
        assert {row.effect for row in found.values()} == {effect.name}

    @pytest.mark.parametrize("effect", ["tone", "night_colour"])
    def test_what_is_computed_per_pixel_is_its_truth_but_for_rounding(self, effect: str) -> None:
        for name, row in rows(effect, "moonlight").items():
            if name != SKIPPED:
                assert row.errors.relative_l2 < 1e-5, row
                assert row.errors.share_changed < 0.02, row

    def test_leaving_the_night_out_is_seen(self) -> None:
        skipped = rows("night_colour", "moonlight")[SKIPPED]
        assert skipped.errors.delta_e_p95 > 5
        assert skipped.median_ms == 0
        assert rows("night_colour", "bright room")[SKIPPED].errors.share_changed < 0.05

    def test_better_levels_of_glare_are_nearer_to_the_oracle(self) -> None:
        glare = rows("glare", "candle room")
        errors = [glare[level].errors.relative_l2 for level in (SKIPPED, "quarter", "full")]
        assert errors == sorted(errors, reverse=True)
        assert 0 < errors[-1] < 0.05
        assert {glare[level].of for level in ("eighth", "quarter", "half", "full")} == {"quarter"}
        assert glare["cie"].of == "cie"

    def test_acuity_is_nearer_to_the_true_filter_than_no_acuity(self) -> None:
        acuity = rows("acuity", "moonlight")
        assert acuity["fit"].errors.relative_l2 < 0.2 * acuity[SKIPPED].errors.relative_l2

    def test_tiles_adapt_as_pixels_do(self) -> None:
        for target in ("lui", "bar-scene", "bar-view"):
            assert rows("adaptation", "dusk")[target].errors.relative_l2 < 0.01


def whole(combination: Combination, scene: str, delta_e: float, milliseconds: float) -> Whole:
    errors = Errors(delta_e, 0.0, 0, 0, delta_e, delta_e, min(delta_e, 1.0))
    return Whole(combination, scene, errors, {SIZE: milliseconds})


class TestWholeFrame:
    worst, middle, best = COMBINATIONS[0], COMBINATIONS[5], COMBINATIONS[-1]

    def made_up(self) -> list[Whole]:
        figures = {self.worst: (40.0, 5.0), self.middle: (4.0, 15.0), self.best: (0.5, 30.0)}
        return [
            whole(combination, scene, delta_e * harder, ms * harder)
            for (combination, (delta_e, ms)), (scene, harder) in itertools.product(
                figures.items(), (("easy", 1.0), ("hard", 2.0))
            )
        ]

    def test_the_best_that_fits_the_slowest_scene_is_taken(self) -> None:
        for fps, expected in ((90, self.worst), (30, self.middle), (5, self.best)):
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
        assert [one.combination for one in front([dominated, *easy], SIZE)] == [self.worst, self.middle, self.best]

    def test_a_frame_takes_the_sum_of_its_parts(self) -> None:
        parts = {"measure": 1.0, "tone": 1.0, "glare veil": 10.0, "acuity fit": 100.0, "night_colour lui": 1000.0}
        nothing = (("glare", SKIPPED), ("acuity", SKIPPED), ("night_colour", SKIPPED))
        assert time_of(nothing, parts) == 2
        assert time_of((("glare", "veil"), ("acuity", SKIPPED), ("night_colour", "lui")), parts) == 1012

    def test_everything_in_full_is_nearest_to_the_truth_and_parts_are_all_timed(self) -> None:
        errors = whole_frame.errors_of_combinations(viewing("moonlight"))
        best = min(errors, key=lambda combination: errors[combination].delta_e_p95)
        glare = dict(best).pop("glare")
        assert dict(best) == {"glare": glare, "acuity": "fit", "night_colour": "lui"}
        assert glare != SKIPPED
        parts = whole_frame.parts_ms(SceneViewing(scenes.scene("moonlight", *SIZE), exact=False), 0)
        assert all(time_of(combination, parts) > 0 for combination in errors)
        assert len(parts) == whole_frame.PARTS
