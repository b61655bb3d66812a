"""Plans of effects whose bounds and times are known: every level, bound and reason follows by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from made_up_effects import SCATTER, TINT, TONE, MadeUp, MadeUpEye, planned, settings, use

from entoptic.pipeline.budget import Choice
from entoptic.pipeline.plan import OFF, SKIPPED, Plan, Planning, Step


@pytest.fixture(autouse=True)
def _made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    use(monkeypatch)


def skipping(code_values: float, **more: float) -> MadeUp:
    return MadeUp({SKIPPED: code_values}, **more)  # type: ignore[arg-type]


NEEDED = settings(
    glare=MadeUp({SKIPPED: 8.0, "coarse": 1.5}), acuity=skipping(3.0), night_colour=skipping(2.0)
)  # fmt: skip


def levels(eyes: object, planning: Planning = Planning(), **more: object) -> dict[str, str]:
    return {step.effect: step.level for step in planned(eyes, planning, **more).plan}  # type: ignore[arg-type]


@pytest.mark.parametrize(("code_values", "level"), [(0.0, SKIPPED), (0.5, SKIPPED), (0.501, "best")])
def test_what_changes_no_more_than_half_a_code_value_is_left_out(code_values: float, level: str) -> None:
    made = planned(MadeUpEye(settings(acuity=skipping(code_values))))
    assert made.plan["acuity"].level == level
    assert made.plan["acuity"].bound_code_values == made.plan.bound_code_values == (code_values < 0.501) * code_values
    assert made.plan["acuity"].runs is (level == "best")


def test_the_tolerance_is_the_settings() -> None:
    eye = MadeUpEye(settings(acuity=skipping(3.0)))
    assert levels(eye, Planning(tolerance_code_values=3.0))["acuity"] == SKIPPED
    assert levels(eye, Planning(tolerance_code_values=2.9))["acuity"] == "best"


def test_the_cheapest_level_that_is_good_enough_runs() -> None:
    step = planned(MadeUpEye(settings(glare=MadeUp({SKIPPED: 8.0, "coarse": 0.4})))).plan["glare"]
    assert (step.level, step.bound_code_values) == ("coarse", 0.4)
    assert step.reason == "glare of one: with no more than coarse, by 0.4 cd/m² at most, over the eye's threshold of 0.25; a pixel changes by 0.4 code values at most"  # fmt: skip  # noqa: E501
    assert levels(MadeUpEye(settings(glare=MadeUp({SKIPPED: 0.1, "coarse": 0.0}))))["glare"] == SKIPPED


@pytest.mark.parametrize(("change_cd_m2", "level"), [(0.25, SKIPPED), (0.26, "best")])
def test_what_stays_below_an_eyes_threshold_is_left_out_whatever_the_codes(change_cd_m2: float, level: str) -> None:
    eye = MadeUpEye(settings(glare=MadeUp({SKIPPED: 8.0}, luminance=change_cd_m2)))
    step = planned(eye).plan["glare"]
    assert (step.level, step.bound_code_values) == (level, 8.0 if level == SKIPPED else 0.0)
    beside = "below" if level == SKIPPED else "over"
    assert step.reason == (
        f"glare of one: without it, by {change_cd_m2} cd/m² at most, {beside} the eye's threshold of 0.25; "
        "a pixel changes by 8 code values at most"
    )


def test_no_threshold_decides_an_effect_that_is_not_seen_by_it() -> None:
    eye = MadeUpEye(settings(acuity=skipping(8.0, luminance=0.0)))
    assert planned(eye).plan["acuity"].reason == ("acuity of one: without it, a pixel changes by 8 code values at most")
    assert levels(eye)["acuity"] == "best"


def test_of_two_eyes_the_worse_decides_and_gives_the_reason() -> None:
    all_of_them = settings(acuity=skipping(0.1), glare=skipping(0.1))
    worse = {"acuity": skipping(0.4), "glare": skipping(9.0, luminance=0.2)}
    for pair in (("one", "two"), ("two", "one")):
        eyes = [MadeUpEye(all_of_them, name, bounds=worse if name == "two" else {}) for name in pair]
        plan = planned(eyes).plan
        assert {step.level for step in plan if step.effect != "tone"} == {SKIPPED}
        assert (plan["acuity"].bound_code_values, plan["glare"].bound_code_values) == (0.4, 9.0)
        assert plan.bound_code_values == 9.4
        assert plan["acuity"].reason == "acuity of two: without it, a pixel changes by 0.4 code values at most"
        assert "glare of two: without it, by 0.2 cd/m² at most" in plan["glare"].reason


def test_a_change_grows_on_its_way_to_the_display() -> None:
    eye = MadeUpEye(
        settings(
            acuity=skipping(0.2), tone=MadeUp(grows=2.0), night_colour=MadeUp({SKIPPED: 0.5}, per_light=0.5, grows=3.0)
        )
    )
    plan = planned(eye).plan
    # The blur's 0.2 twice by tone mapping and three times by the tint; the tint's 0.5 and 0.5 for each of 2.4.
    assert (plan["night_colour"].level, plan["acuity"].level) == ("best", "best")
    assert "by 1.2 code values" in plan["acuity"].reason
    assert "by 1.7 code values" in plan["night_colour"].reason
    plan = planned(eye, Planning(tolerance_code_values=1.75)).plan
    assert (plan["night_colour"].level, plan["acuity"].level) == (SKIPPED, SKIPPED)
    # Without the tint nothing makes the blur's 0.4 larger, but there is as much more light that it would have changed.
    assert plan.bound_code_values == pytest.approx(0.4 + 0.5 + 0.5 * 2.8)
    TINT.asked.clear()
    planned(eye)
    changes, ranges = TINT.asked[-1]
    assert changes.image.max() == pytest.approx(0.4)
    assert changes.scene.max() == pytest.approx(0.2)  # as it was before tone mapping
    assert (ranges.scene.high.max(), ranges.image.high.max()) == (pytest.approx(1.2), pytest.approx(2.4))


def test_lights_of_their_own_are_in_no_range_so_nothing_is_left_out_beside_them() -> None:
    eye = MadeUpEye(settings(), lights=("a star",))
    made = planned(eye)
    assert {step.level for step in made.plan} == {"best"}
    assert made.plan["acuity"].reason == "beside lights of their own nothing is left out"
    assert made.plan.bound_code_values == 0
    asked = planned(eye, Planning(leave_out=frozenset({"acuity"}))).plan  # type: ignore[arg-type]
    assert asked["acuity"].level == SKIPPED
    assert asked.bound_code_values == asked["acuity"].bound_code_values == math.inf
    assert asked["glare"].bound_code_values == 0


def test_what_is_asked_for_is_done_and_said() -> None:
    eye = MadeUpEye(NEEDED)
    made = planned(eye, Planning(everything=True))
    assert {step.level for step in made.plan} == {"best"}
    assert [step.reason for step in made.plan] == [
        "everything was asked for", "everything was asked for", "always", "everything was asked for"
    ]  # fmt: skip
    assert (made.plan.bound_code_values, made.tiles) == (0, {})
    bare = planned(eye, Planning(everything=True, leave_out=frozenset({"acuity"}))).plan  # type: ignore[arg-type]
    assert (bare["acuity"].level, bare["acuity"].reason) == (SKIPPED, "left out as asked")
    assert bare["acuity"].bound_code_values == bare.bound_code_values == 3.0
    assert bare["glare"].level == "best"
    assert levels(eye, Planning(leave_out=frozenset({"acuity"})))["glare"] == "best"  # type: ignore[arg-type]


def test_what_is_switched_off_is_in_no_plan() -> None:
    made = planned(MadeUpEye(settings(acuity=MadeUp({SKIPPED: 9.0}, on=False))))
    assert (made.plan["acuity"].level, made.plan["acuity"].reason) == (OFF, "switched off in the settings")
    assert not made.plan["acuity"].runs
    assert (made.plan.bound_code_values, set(made.choices)) == (0, {"glare", "night_colour"})
    off = settings(glare=skipping(0.25), acuity=MadeUp({SKIPPED: 9.0}, grows=9.0, on=False))
    assert planned(MadeUpEye(off)).plan.bound_code_values == 0.25


class TestBudget:
    """Fixed parts take 5 ms; 0.87 of the budget is planned with, and a tenth of the rest is left free at first."""

    @pytest.mark.parametrize(
        ("budget_ms", "running"),
        [
            (1000.0, {"glare": "best", "acuity": "best", "night_colour": "best"}),
            (82.5, {"glare": "best", "acuity": "best", "night_colour": "best"}),  # (82.5 · 0.87 − 5) · 0.9 = 60.1
            (82.0, {"glare": "coarse", "acuity": "best", "night_colour": "best"}),  # 59.7
            (74.8, {"glare": "coarse", "acuity": "best", "night_colour": "best"}),  # 54.1
            (74.6, {"glare": "best", "acuity": "best", "night_colour": SKIPPED}),  # 53.9
            (44.2, {"glare": "best", "acuity": "best", "night_colour": SKIPPED}),  # 30.1
            (44.0, {"glare": "coarse", "acuity": "best", "night_colour": SKIPPED}),  # 29.9
            (10.5, {"glare": SKIPPED, "acuity": SKIPPED, "night_colour": SKIPPED}),  # 3.7
        ],
    )
    def test_the_least_error_that_fits_with_some_to_spare(self, budget_ms: float, running: dict[str, str]) -> None:
        found = levels(MadeUpEye(NEEDED), Planning(budget_ms=budget_ms))
        assert {name: level for name, level in found.items() if name != "tone"} == running

    def test_errors_are_those_of_tiles_as_they_are_on_average_and_bounds_stay_bounds(self) -> None:
        bright = settings(acuity=skipping(3.0), night_colour=skipping(9.0, typical=0.1))
        plan = planned(MadeUpEye(bright), Planning(budget_ms=55.0)).plan
        assert (plan["acuity"].level, plan["night_colour"].level) == ("best", SKIPPED)
        assert plan["night_colour"].bound_code_values == plan.bound_code_values == 9.0
        plan = planned(MadeUpEye(NEEDED), Planning(budget_ms=44.2)).plan
        assert plan["night_colour"].bound_code_values == 2.0
        assert plan["night_colour"].reason == (
            "night_colour of one: without it, a pixel changes by 2 code values at most; more does not fit 44.2 ms"
        )
        fits = planned(MadeUpEye(settings(acuity=skipping(0.1))), Planning(budget_ms=44.2)).plan["acuity"]
        assert fits.reason == "acuity of one: without it, a pixel changes by 0.1 code values at most"

    def test_where_nothing_fits_nothing_is_weighed(self) -> None:
        # The cheapest level that runs takes 4 ms: (10.34 · 0.87 − 5) = 3.996, (10.35 · 0.87 − 5) = 4.004.
        plan = planned(MadeUpEye(NEEDED), Planning(budget_ms=10.34)).plan
        assert plan["glare"].reason == "nothing more fits 10.34 ms"
        assert plan["glare"].bound_code_values == 8.0
        assert "more does not fit" in planned(MadeUpEye(NEEDED), Planning(budget_ms=10.35)).plan["glare"].reason
        running = {name: Choice("best") for name in ("glare", "acuity", "night_colour")}
        fading = planned(MadeUpEye(NEEDED), Planning(budget_ms=10.34), before=running, dt_s=0.1)
        assert fading.plan["acuity"].weights == {SKIPPED: 0.5, "best": 0.5}
        still = planned(MadeUpEye(NEEDED), Planning(budget_ms=10.34), before={"acuity": Choice(SKIPPED)}, dt_s=0.1)
        assert still.plan["acuity"].reason == "nothing more fits 10.34 ms"

    def test_making_the_scene_counts_and_is_named_where_it_takes_much(self) -> None:
        assert levels(MadeUpEye(NEEDED), Planning(budget_ms=82.5 + 20 / 0.87), scene_ms=20.0)["glare"] == "best"
        assert levels(MadeUpEye(NEEDED), Planning(budget_ms=82.0 + 20 / 0.87), scene_ms=20.0)["glare"] == "coarse"
        slow = planned(MadeUpEye(NEEDED), Planning(budget_ms=67.2), scene_ms=20.0).plan
        assert slow["night_colour"].reason.endswith("more does not fit 67.2 ms, of which the scene takes 20")
        alone = planned(MadeUpEye(NEEDED), Planning(budget_ms=33.0), scene_ms=50.0).plan
        assert alone["glare"].reason == "nothing more fits 33 ms, of which the scene takes 50"
        quick = planned(MadeUpEye(NEEDED), Planning(budget_ms=46.4), scene_ms=2.0).plan
        assert quick["night_colour"].reason.endswith("more does not fit 46.4 ms")

    def test_larger_frames_take_longer(self) -> None:
        class Two(MadeUpEye):
            @property
            def frame(self) -> object:
                return type("Frame", (), {"rgb_cd_m2": np.zeros((2, 3, 1000, 1000))})

        # Twice the pixels: 3 + 3 fixed, 120 for all effects.
        assert levels(Two(NEEDED), Planning(budget_ms=(120 / 0.9 + 6) / 0.87 + 0.1))["glare"] == "best"
        assert levels(Two(NEEDED), Planning(budget_ms=(120 / 0.9 + 6) / 0.87 - 0.1))["glare"] == "coarse"


class TestFromFrameToFrame:
    def test_a_better_level_is_faded_in_and_a_cheaper_one_waits(self) -> None:
        eye = MadeUpEye(settings(acuity=skipping(4.0)))
        first = planned(eye, before={"acuity": Choice(SKIPPED)}, dt_s=0.05)
        step = first.plan["acuity"]
        assert (step.level, step.fading_from, step.fade, step.runs) == ("best", SKIPPED, 0.25, True)
        assert step.reason.endswith("; 25% of the way from skipped")
        assert step.bound_code_values == 4.0
        assert first.plan.bound_code_values == 0.75 * 4.0
        calm = planned(MadeUpEye(settings()), before={"acuity": Choice("best")}, dt_s=0.1).plan["acuity"]
        assert (calm.level, calm.fading_from) == ("best", None)
        assert calm.reason.endswith("0 code values at most; it stays until that has lasted 0.5 s")

    def test_all_levels_are_weighed_while_one_fades(self) -> None:
        """Of three levels the picture passes from the middle one, which a better one makes unnecessary."""
        eye = MadeUpEye(settings(glare=MadeUp({SKIPPED: 0.1, "coarse": 0.05})))
        step = planned(eye, before={"glare": Choice("best", "coarse", 0.5)}, dt_s=0.02).plan["glare"]
        assert step.weights == {"best": 0.6, "coarse": pytest.approx(0.4)}
        assert step.bound_code_values == 0.05


class TestReview:
    """What is called for is looked at again every 0.1 s; what is left out is proven for each frame."""

    def again(self, changed: MadeUp, time_s: float, dt_s: float, before: str = "best") -> Planned:
        """Planned in a frame that calls for acuity, and once more after that changed."""
        first = planned(MadeUpEye(settings(acuity=skipping(8.0)), time_s=time_s - dt_s))
        eye = MadeUpEye(settings(acuity=changed), time_s=time_s)
        return planned(eye, before={"acuity": Choice(before)}, found=first.found, dt_s=dt_s)

    @pytest.mark.parametrize(
        ("time_s", "dt_s", "figure"), [(0.05, 0.01, 8.0), (0.105, 0.01, 4.0), (0.05, 0.0, 4.0), (0.35, 0.3, 4.0)]
    )
    def test_what_was_found_serves_until_the_next_tenth_of_a_second(
        self, time_s: float, dt_s: float, figure: float
    ) -> None:
        step = self.again(skipping(4.0), time_s, dt_s).plan["acuity"]
        assert (step.level, step.fading_from) == ("best", None)
        assert f"by {figure:g} code values at most" in step.reason

    def test_no_bound_is_worked_out_meanwhile(self) -> None:
        TINT.asked.clear()
        self.again(skipping(4.0), 0.05, 0.01)
        once = len(TINT.asked)
        TINT.asked.clear()
        planned(MadeUpEye(settings(acuity=skipping(8.0))))
        assert len(TINT.asked) == once

    def test_what_was_skipped_comes_back_at_once(self) -> None:
        step = self.again(skipping(4.0), 0.05, 0.01, before=SKIPPED).plan["acuity"]
        assert (step.level, step.fading_from) == ("best", SKIPPED)
        assert "by 4 code values at most" in step.reason

    def test_what_is_about_to_be_skipped_is_proven_each_frame(self) -> None:
        first = planned(MadeUpEye(settings()))
        back = planned(
            MadeUpEye(settings(acuity=skipping(4.0)), time_s=0.05),
            before={"acuity": Choice("best")},
            found=first.found,
            dt_s=0.01,
        )
        assert "by 4 code values at most" in back.plan["acuity"].reason


def test_tiles_that_any_eye_may_change_are_worked_on() -> None:
    one, two = np.array([[True, False, False]]), np.array([[False, False, True]])
    eyes = [MadeUpEye(NEEDED, dark=dark) for dark in (one, two)]
    found = planned(eyes).tiles
    np.testing.assert_array_equal(found["acuity"], [[True, False, True]])
    assert found["glare"] is None
    assert planned([MadeUpEye(NEEDED, dark=one), MadeUpEye(NEEDED)]).tiles["acuity"] is None


def test_ranges_before_an_effect_hold_what_those_before_it_leave_or_hide() -> None:
    TONE.asked.clear()
    planned(MadeUpEye(settings(glare=skipping(2.0), acuity=skipping(0.0))))
    _, ranges = TONE.asked[-1]
    assert ranges.image.high.max() == 3.0
    assert ranges.image.low.min() == 0.0
    SCATTER.asked.clear()
    planned(MadeUpEye(settings(glare=skipping(2.0))))
    assert SCATTER.asked == []  # nothing comes before it


def test_a_step_that_hides_nothing_and_fades_from_nothing_is_all_at_its_level() -> None:
    step = Step("acuity", "best", "why")
    assert (step.weights, step.bound_code_values, step.fade) == ({"best": 1.0}, 0.0, 1.0)
    assert Plan((step,)).bound_code_values == 0.0
    assert planned(MadeUpEye(NEEDED)).plan["acuity"].weights == {"best": 1.0}


def test_an_effect_that_has_no_lesser_levels_says_that_it_was_asked_for() -> None:
    step = planned(MadeUpEye(settings(acuity=MadeUp(reducible=False)))).plan["acuity"]
    assert (step.level, step.reason) == ("best", "it was asked for")
