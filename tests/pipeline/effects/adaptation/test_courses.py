"""How fast an eye adapts, against closed forms, and that no step of time breaks it."""

import math

import numpy as np
import pytest

from entoptic.pipeline.effects.adaptation import (
    Adaptation,
    Course,
    adapt_cd_m2,
    overshoot_threshold_cd_m2,
    rod_sensitivity,
)
from entoptic.pipeline.threshold import cone_threshold_cd_m2, threshold_cd_m2

GRADUAL = tuple(course for course in Course if course is not Course.INSTANT)
EVERY = [Adaptation(course=course) for course in Course]
NAMES = [course.value for course in Course]


def trace(start: float, target: float, dt_s: float, frames: int, how: Adaptation) -> np.ndarray:
    seen = [start]
    for _ in range(frames):
        seen.append(adapt_cd_m2(seen[-1], target, dt_s, how))
    return np.array(seen)


@pytest.mark.parametrize(("target", "tau_s"), [(1e9, 0.1), (1e-6, 0.4), (0.04, 0.25)])
def test_rods_and_cones_each_leave_an_eth_of_the_way_in_their_time(target: float, tau_s: float) -> None:
    assert (adapt_cd_m2(5.0, target, tau_s) - target) / (5.0 - target) == pytest.approx(math.exp(-1), rel=1e-4)


def test_rods_and_cones_share_vision_at_the_papers_luminance() -> None:
    assert rod_sensitivity(0.04) == 0.5
    assert rod_sensitivity(0.0) == 1


@pytest.mark.parametrize("course", [Course.BAR, Course.OVERSHOOT])
def test_a_second_leaves_the_papers_share(course: Course) -> None:
    how = Adaptation(course=course)
    assert adapt_cd_m2(1.0, 101.0, 1.0, how) == pytest.approx(101 - 0.1 * 100)
    assert adapt_cd_m2(101.0, 1.0, 1.0, how) == pytest.approx(1 + 0.5 * 100)
    slower = Adaptation(course=course, left_after_1_s_to_light=0.9, left_after_1_s_to_dark=0.2)
    assert adapt_cd_m2(1.0, 101.0, 2.0, slower) == pytest.approx(101 - 0.81 * 100)
    assert adapt_cd_m2(101.0, 1.0, 0.5, slower) == pytest.approx(1 + math.sqrt(0.2) * 100)


def test_an_instant_course_is_there_at_once() -> None:
    assert [adapt_cd_m2(0.3, 70.0, dt_s, Adaptation(course=Course.INSTANT)) for dt_s in (0.0, 1.0)] == [70.0, 70.0]


@pytest.mark.parametrize("course", GRADUAL)
@pytest.mark.parametrize("dt_s", [0.0, -0.0, -1.0, -1e9, -math.inf, math.nan])
def test_time_that_does_not_go_on_leaves_an_eye_as_it_is(course: Course, dt_s: float) -> None:
    assert adapt_cd_m2(0.01, 1000.0, dt_s, Adaptation(course=course)) == 0.01


@pytest.mark.parametrize("course", GRADUAL)
@pytest.mark.parametrize(("start", "target"), [(1.6e9, 1e-6), (1e-6, 1.6e9), (1e12, 1e-6)])
def test_from_the_sun_to_starlight_and_back_an_eye_arrives_exactly(course: Course, start: float, target: float) -> None:
    how = Adaptation(course=course)
    assert {adapt_cd_m2(start, target, dt_s, how) for dt_s in (1e9, math.inf)} == {target}
    little = adapt_cd_m2(start, target, 1e-9, how)
    assert little == pytest.approx(start, rel=1e-6) or abs(little - start) < 1e-7 * abs(target)
    assert min(start, target) <= little <= max(start, target)


@pytest.mark.parametrize("how", EVERY, ids=NAMES)
@pytest.mark.parametrize(("start", "target"), [(0.01, 1000.0), (1000.0, 0.01)])
@pytest.mark.parametrize("rate_hz", [1, 24, 1000])
def test_a_step_between_night_and_day_does_not_oscillate(
    how: Adaptation, start: float, target: float, rate_hz: int
) -> None:
    """A known player alternates between 0 and 0.3 for ever at 24 frames a second."""
    seen = trace(start, target, 1 / rate_hz, 60 * rate_hz, how)
    ahead = np.diff(seen) * np.sign(target - start)
    assert (ahead >= 0).all()
    assert seen[-1] == pytest.approx(target, rel=1e-9)


@pytest.mark.parametrize("course", GRADUAL)
@pytest.mark.parametrize(("start", "target"), [(0.2, 30.0), (30.0, 0.2)])
def test_half_steps_are_a_step(course: Course, start: float, target: float) -> None:
    how = Adaptation(course=course)
    half = adapt_cd_m2(adapt_cd_m2(start, target, 0.05, how), target, 0.05, how)
    assert half == pytest.approx(adapt_cd_m2(start, target, 0.1, how), rel=1e-12)


@pytest.mark.parametrize("how", EVERY, ids=NAMES)
def test_ten_thousand_frames_do_not_drift(how: Adaptation) -> None:
    assert set(trace(0.1, 0.1, 1 / 90, 10_000, how)) == {0.1}
    small = trace(30.0, 0.2, 1e-4, 10_000, how)[-1]
    assert small == pytest.approx(adapt_cd_m2(30.0, 0.2, 1.0, how), rel=1e-9)


@pytest.mark.parametrize("course", GRADUAL)
@pytest.mark.parametrize("frames_per_half", [1, 3, 20])
def test_a_light_that_blinks_five_times_a_second_settles_between_its_two_levels(
    course: Course, frames_per_half: int
) -> None:
    """On for 0.1 s, off for 0.1 s: the two ends of each half follow from what a half leaves of the way."""
    how, off, on = Adaptation(course=course), 0.01, 1000.0
    to_on = 1 - (adapt_cd_m2(off, on, 0.1, how) - off) / (on - off)
    to_off = (adapt_cd_m2(on, off, 0.1, how) - off) / (on - off)
    top = (on * (1 - to_on) + off * (1 - to_off) * to_on) / (1 - to_on * to_off)
    bottom = off * (1 - to_off) + to_off * top
    adapted, ends = off, []
    for half in range(200):
        for _ in range(frames_per_half):
            adapted = adapt_cd_m2(adapted, on if half % 2 == 0 else off, 0.1 / frames_per_half, how)
        ends.append(adapted)
    assert ends[-2:] == pytest.approx([top, bottom], rel=1e-9)


def test_the_overshoot_of_the_threshold() -> None:
    """BAR 8 by hand: at 100 cd/m² cones alone see, t_m = t_p = 5.5590; t_m(1) = 0.39514."""
    assert overshoot_threshold_cd_m2(1.0, 100.0) == pytest.approx(5.5590**2 / 0.39514, rel=1e-4)
    assert cone_threshold_cd_m2(100.0) == pytest.approx(5.5590, rel=1e-5)


def test_the_overshoot_falls_to_the_threshold_of_the_target_and_is_none_on_the_way_to_the_dark() -> None:
    seen = [overshoot_threshold_cd_m2(adapted, 1000.0) for adapted in trace(1.0, 1000.0, 0.05, 400, EVERY[-1])]
    assert (np.diff(seen) <= 0).all()
    assert seen[0] > 10 * seen[-1]
    assert seen[-1] == pytest.approx(threshold_cd_m2(1000.0), rel=1e-6)
    assert overshoot_threshold_cd_m2(50.0, 0.2) == threshold_cd_m2(50.0)


@pytest.mark.parametrize("luminance", [1e-6, 0.02, 0.5, 7.0, 1e4])
def test_the_overshoot_begins_without_a_jump(luminance: float) -> None:
    below, above = (overshoot_threshold_cd_m2(luminance, luminance * factor) for factor in (1 - 1e-9, 1 + 1e-9))
    assert below == pytest.approx(above, rel=1e-7)
