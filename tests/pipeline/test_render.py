"""Perceiving whole frames: which effects run, in which order of magnitude, and the same twice."""

import numpy as np
import pytest

from pipeline import Display, Frame, GlareModel, Looking, Observer, Perceived, RenderState, as_displayed, perceive
from pipeline.plan import SKIPPED, Effect

OBSERVER = Observer()


def room(mean_cd_m2: float, *, lamp_cd_m2: float | None = None) -> Frame:
    """Textured walls, their darkest pixel a third of the mean; no lamp unless asked for."""
    random = np.random.default_rng(1)
    rgb = (mean_cd_m2 * random.uniform(0.35, 1.65, (200, 180, 3))).astype(np.float32)
    if lamp_cd_m2 is not None:
        rgb[100:103, 90:93] = lamp_cd_m2
    return Frame.from_rgb(rgb, 50.0)


def levels(perceived: Perceived) -> dict[str, str]:
    return {step.effect: step.level for step in perceived.plan}


def test_a_bright_room_skips_acuity_and_night_colour_with_reasons() -> None:
    perceived = perceive(room(120.0, lamp_cd_m2=1e4), observer=OBSERVER)
    assert levels(perceived)[Effect.ACUITY] == levels(perceived)[Effect.NIGHT_COLOUR] == SKIPPED
    assert levels(perceived)[Effect.GLARE] == GlareModel.WAVE
    reasons = {step.effect: step.reason for step in perceived.plan}
    assert "cd/m²" in reasons[Effect.ACUITY]
    assert "cones alone" in reasons[Effect.NIGHT_COLOUR]
    assert not {Effect.ACUITY, Effect.NIGHT_COLOUR} & set(perceived.milliseconds)


def test_a_dark_room_without_lights_skips_glare_and_runs_the_rest() -> None:
    perceived = perceive(room(0.005), observer=OBSERVER)
    assert levels(perceived)[Effect.GLARE] == SKIPPED
    assert levels(perceived)[Effect.ACUITY] != SKIPPED
    assert levels(perceived)[Effect.NIGHT_COLOUR] != SKIPPED


def test_the_same_dark_room_with_a_lamp_runs_glare() -> None:
    assert levels(perceive(room(0.005, lamp_cd_m2=100.0), observer=OBSERVER))[Effect.GLARE] == GlareModel.WAVE


def test_a_skipped_glare_changes_less_than_the_eye_can_see() -> None:
    from pipeline.effects import glare
    from pipeline.threshold import threshold_cd_m2

    frame = room(0.005)
    perceived = perceive(frame, Looking(pupil_mm=6.0), observer=OBSERVER)
    x, y = frame.view.pixel_of(0, 0)
    glared = np.asarray(glare.wave_glare(frame.rgb_cd_m2[0], frame.view, OBSERVER, 6.0, (x, y)))
    change = np.abs(glared - np.asarray(frame.rgb_cd_m2[0])).max()
    assert 0 < change <= threshold_cd_m2(perceived.state.adapted_cd_m2[0])


def test_night_is_bluer_darker_and_softer_than_it_is_displayed() -> None:
    frame = room(0.005)
    seen, displayed = perceive(frame, observer=OBSERVER).image[0].astype(float), as_displayed(frame)[0].astype(float)
    assert seen.mean() < displayed.mean()
    red, green, blue = seen.mean(axis=(0, 1))
    assert blue > red > green
    contrast = [image.std() / image.mean() for image in (seen[5:-5, 5:-5, 1], displayed[5:-5, 5:-5, 1])]
    assert contrast[0] < contrast[1]


def test_the_same_frame_twice_is_the_same_to_the_bit() -> None:
    frame = room(1.0, lamp_cd_m2=1e5)
    images = [perceive(frame, Looking(3.0, -2.0, 4.37), observer=OBSERVER).image for _ in range(2)]
    assert np.array_equal(*images)


def test_both_eyes_in_one_frame_are_each_eye_alone() -> None:
    one, two = room(2.0, lamp_cd_m2=1e4), room(0.3, lamp_cd_m2=3e3)
    both = Frame.from_rgb(np.concatenate([one.rgb_cd_m2, two.rgb_cd_m2]), 50.0)
    eyes = (Looking(1.0, 0.0, 3.1), Looking(-2.0, 4.0, 6.2))
    together = perceive(both, eyes, observer=OBSERVER)
    alone = [perceive(frame, eye, observer=OBSERVER) for frame, eye in zip((one, two), eyes, strict=True)]
    assert together.state.adapted_cd_m2 == pytest.approx([a.state.adapted_cd_m2[0] for a in alone], rel=1e-6)
    # The effects that only one eye calls for run on both, and change nothing of the other.
    for k, single in enumerate(alone):
        assert np.abs(together.image[k].astype(int) - single.image[0].astype(int)).max() <= 1


def test_adaptation_follows_the_gaze_and_time() -> None:
    rgb = np.full((200, 400, 3), 0.1, np.float32)
    rgb[:, 200:] = 1000.0
    frame = Frame.from_rgb(rgb, 100.0)
    dark, bright = (perceive(frame, Looking(azimuth, 0, 4.0), observer=OBSERVER) for azimuth in (-35.0, 35.0))
    assert dark.state.adapted_cd_m2[0] < 50 < bright.state.adapted_cd_m2[0]
    turned = perceive(frame, Looking(35.0, 0, 4.0), observer=OBSERVER, state=dark.state, dt_s=0.02)
    assert dark.state.adapted_cd_m2[0] < turned.state.adapted_cd_m2[0] < bright.state.adapted_cd_m2[0]


def test_without_a_measured_pupil_it_is_what_light_and_age_make_it() -> None:
    young, old = (perceive(room(1.0), observer=Observer(age_years=age)).pupil_mm[0] for age in (20, 80))
    assert 2 < old < young < 8
    assert perceive(room(1000.0), observer=OBSERVER).pupil_mm[0] < young


def test_a_wider_pupil_has_a_stronger_halo() -> None:
    """The lens fibres lie outside the middle 3 mm; their halo is 3° away."""
    frame = room(0.01, lamp_cd_m2=1e5)
    y, x = np.indices((200, 180))
    away_deg = np.hypot(x - 91, y - 101) / frame.view.ppd_centre
    ring = (away_deg > 2.5) & (away_deg < 3.5)
    narrow, wide = (
        np.asarray(perceive(frame, Looking(pupil_mm=mm), observer=OBSERVER, state=RenderState((1.0,))).linear)[0, 1]
        for mm in (2.5, 7.5)
    )
    assert wide[ring].mean() > 1.5 * narrow[ring].mean()


def test_a_brighter_display_shows_mid_tones_at_the_same_luminance() -> None:
    frame = room(50.0)
    shown = [
        np.asarray(perceive(frame, observer=OBSERVER, display=Display(peak_cd_m2=peak)).linear).min() * peak
        for peak in (100.0, 400.0)
    ]
    assert shown[1] == pytest.approx(shown[0], rel=0.6)
    assert shown[1] < 100


def test_the_analytic_model_glares_wherever_the_eye_looks() -> None:
    frame = room(0.1, lamp_cd_m2=1e5)
    perceived = perceive(frame, Looking(20.0, 15.0, 4.0), observer=OBSERVER, glare_model=GlareModel.ANALYTIC)
    assert levels(perceived)[Effect.GLARE] == GlareModel.ANALYTIC
    assert perceived.image[0, 100, 60].min() > 0
