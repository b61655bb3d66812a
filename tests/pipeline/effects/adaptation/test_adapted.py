"""One eye from frame to frame."""

import math

import msgspec
import pytest

from entoptic.pipeline.effects.adaptation import (
    FLOOR_CD_M2,
    Adaptation,
    Adapted,
    Bleaching,
    Course,
    adapt_cd_m2,
    begin,
    exposure,
    overshoot_threshold_cd_m2,
    step,
)
from entoptic.pipeline.threshold import threshold_cd_m2

BLEACHED = [Adaptation(bleaching=kind) for kind in (Bleaching.PATTANAIK, Bleaching.RUSHTON)]
EVERY = [Adaptation(course=course, bleaching=kind) for course in Course for kind in Bleaching]


def run(how: Adaptation, start: Adapted, target: float, dt_s: float, frames: int) -> Adapted:
    for _ in range(frames):
        start = step(start, target, dt_s, how)
    return start


@pytest.mark.parametrize("how", EVERY, ids=str)
def test_before_an_unchanging_frame_nothing_changes(how: Adaptation) -> None:
    eye = begin(20.0, how)
    assert eye.luminance_cd_m2 == 20.0
    after = run(how, eye, 20.0, 1 / 90, 500)
    assert (after.luminance_cd_m2, after.fast_cd_m2) == (20.0, 20.0)
    assert (after.pigments.cones, after.pigments.rods) == pytest.approx((eye.pigments.cones, eye.pigments.rods), 1e-9)


@pytest.mark.parametrize("course", Course)
def test_without_bleaching_an_eye_is_its_course(course: Course) -> None:
    how = Adaptation(course=course)
    after = step(begin(0.3, how), 40.0, 0.05, how)
    assert after.luminance_cd_m2 == after.fast_cd_m2 == adapt_cd_m2(0.3, 40.0, 0.05, how)
    assert after.target_cd_m2 == 40.0


@pytest.mark.parametrize("how", BLEACHED, ids=str)
def test_after_sunlight_the_dark_stays_dark_for_minutes(how: Adaptation) -> None:
    plain = Adaptation()
    sunlit = begin(1e4, how)
    seconds = run(how, sunlit, 1e-4, 0.1, 100)
    assert run(plain, begin(1e4), 1e-4, 0.1, 100).luminance_cd_m2 < 1.1e-4
    assert seconds.luminance_cd_m2 > 0.05
    minutes = run(how, seconds, 1e-4, 60.0, 10)
    hour = run(how, minutes, 1e-4, 60.0, 60)
    assert seconds.luminance_cd_m2 > minutes.luminance_cd_m2 > 1.5e-4
    assert hour.luminance_cd_m2 == pytest.approx(1e-4, rel=1e-3)
    assert exposure(seconds.luminance_cd_m2) < exposure(minutes.luminance_cd_m2) < exposure(hour.luminance_cd_m2)


@pytest.mark.parametrize("how", BLEACHED, ids=str)
def test_back_in_the_light_bleaching_costs_no_time(how: Adaptation) -> None:
    bleached = run(how, begin(1e4, how), 1e-4, 0.1, 100)
    assert run(how, bleached, 1e4, 0.1, 20).luminance_cd_m2 == pytest.approx(1e4, rel=1e-3)


@pytest.mark.parametrize("how", EVERY, ids=str)
@pytest.mark.parametrize("dt_s", [0.0, 1e-9, 1e9, math.inf, -1.0, math.nan])
@pytest.mark.parametrize("target", [FLOOR_CD_M2, 1.6e9])
def test_any_step_of_time_is_a_finite_step(how: Adaptation, dt_s: float, target: float) -> None:
    eye = begin(0.5, how)
    after = step(eye, target, dt_s, how)
    assert min(0.5, target) <= after.luminance_cd_m2 <= max(0.5, target)
    assert 0 < exposure(after.luminance_cd_m2) < math.inf
    if not dt_s > 0 and how.course is not Course.INSTANT:
        assert after.luminance_cd_m2 == eye.luminance_cd_m2


def test_only_the_overshoot_sends_ward_to_the_target() -> None:
    for course in Course:
        how = Adaptation(course=course)
        eye = step(begin(1.0, how), 100.0, 0.02, how)
        if course is Course.OVERSHOOT:
            assert eye.tone_target_cd_m2(how) == 100.0
            assert eye.threshold_cd_m2(how) == overshoot_threshold_cd_m2(eye.luminance_cd_m2, 100.0)
            assert eye.threshold_cd_m2(how) > threshold_cd_m2(100.0)
        else:
            assert eye.tone_target_cd_m2(how) == eye.luminance_cd_m2
            assert eye.threshold_cd_m2(how) == threshold_cd_m2(eye.luminance_cd_m2)


@pytest.mark.parametrize(("adapted", "key"), [(0.001, 0.0302), (0.01, 0.0322), (0.1, 0.0503)])
def test_the_key(adapted: float, key: float) -> None:
    """Krawczyk's, with E2."""
    assert exposure(adapted) * adapted == pytest.approx(key, abs=5e-5)


def test_an_eye_adapted_to_nothing_is_adapted_to_starlight() -> None:
    assert exposure(0.0) == exposure(FLOOR_CD_M2)


@pytest.mark.parametrize(
    ("table", "path"),
    [
        ({"target": "fovea"}, r"\$\.target"),
        ({"gaze_sd_deg": 0.5}, r"\$\.gaze_sd_deg"),
        ({"left_after_1_s_to_light": 0.0}, r"\$\.left_after_1_s_to_light"),
        ({"speed": 2}, "speed"),
    ],
)
def test_settings_are_refused_by_name(table: dict[str, object], path: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=path):
        msgspec.convert(table, Adaptation)


def test_settings_are_read_by_name() -> None:
    table = {"target": "bar-view", "course": "overshoot", "robust": True, "bleaching": "rushton"}
    assert msgspec.convert(table, Adaptation).course is Course.OVERSHOOT
