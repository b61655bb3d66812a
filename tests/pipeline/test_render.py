"""Perceiving whole frames: which effects run, in which order of magnitude, and the same twice."""

import numpy as np
import pytest

from entoptic.pipeline import (
    Display,
    Effects,
    EyePose,
    Frame,
    Glare,
    GlareLevel,
    GlareModel,
    Observer,
    Perceived,
    Planning,
    RenderState,
    as_displayed,
    perceive,
)
from entoptic.pipeline.effects import adaptation, tone
from entoptic.pipeline.effects.glare.settings import Edge
from entoptic.pipeline.plan import SKIPPED

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
    perceived = perceive(room(120.0), observer=OBSERVER)
    assert levels(perceived)["acuity"] == levels(perceived)["night_colour"] == SKIPPED
    assert levels(perceived)["glare"] == "quarter"
    reasons = {step.effect: step.reason for step in perceived.plan}
    assert "cd/m²" in reasons["acuity"]
    assert "rods carry 0.0003" in reasons["night_colour"]
    assert not {"acuity", "night_colour"} & set(perceived.milliseconds)


def test_a_dark_room_without_lights_skips_glare_and_runs_the_rest() -> None:
    perceived = perceive(room(0.005), observer=OBSERVER)
    assert levels(perceived)["glare"] == SKIPPED
    assert levels(perceived)["acuity"] != SKIPPED
    assert levels(perceived)["night_colour"] != SKIPPED


def test_the_same_dark_room_with_a_lamp_runs_glare() -> None:
    assert levels(perceive(room(0.005, lamp_cd_m2=100.0), observer=OBSERVER))["glare"] == "quarter"


def glare_reason(perceived: Perceived) -> str:
    return next(step.reason for step in perceived.plan if step.effect == "glare")


@pytest.mark.parametrize(("edge", "level"), [(Edge.AVERAGE, "skipped"), (Edge.DARK, "quarter")])
def test_a_plain_bright_wall_calls_for_glare_only_where_it_is_dark_beyond_its_edges(edge: Edge, level: str) -> None:
    """There a pixel loses a tenth of its light, and a cone tells 5.6 % apart."""
    wall = np.full((200, 180, 3), 100.0, np.float32)
    perceived = perceive(Frame.from_rgb(wall, 50.0), observer=OBSERVER, effects=Effects(glare=Glare(edge=edge)))
    assert levels(perceived)["glare"] == level
    assert f"{'below' if level == 'skipped' else 'over'} the eye's threshold" in glare_reason(perceived)


def test_the_reason_for_glare_counts_the_lights() -> None:
    rgb = np.full((200, 180, 3), 0.01, np.float32)
    assert "no light stands out" in glare_reason(perceive(Frame.from_rgb(rgb, 50.0), observer=OBSERVER))
    rgb[40:60, 100:130] = 50.0  # one light, though many tiles
    assert "pixel 50 cd/m², 1 light stands out" in glare_reason(perceive(Frame.from_rgb(rgb, 50.0), observer=OBSERVER))
    rgb[150, 20] = rgb[5, 5] = 40.0
    assert ", 3 lights stand out" in glare_reason(perceive(Frame.from_rgb(rgb, 50.0), observer=OBSERVER))
    rgb[::20, ::20] = 45.0
    assert ", 16 or more lights" in glare_reason(perceive(Frame.from_rgb(rgb, 50.0), observer=OBSERVER))


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
    images = [perceive(frame, EyePose(3.0, -2.0, 4.37), observer=OBSERVER).image for _ in range(2)]
    assert np.array_equal(*images)


def test_both_eyes_in_one_frame_are_each_eye_alone() -> None:
    one, two = room(2.0, lamp_cd_m2=1e4), room(0.3, lamp_cd_m2=3e3)
    both = Frame.from_rgb(np.concatenate([one.rgb_cd_m2, two.rgb_cd_m2]), 50.0)
    eyes = (EyePose(1.0, 0.0, 3.1), EyePose(-2.0, 4.0, 6.2))
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
    dark, bright = (perceive(frame, EyePose(azimuth, 0, 4.0), observer=OBSERVER) for azimuth in (-35.0, 35.0))
    assert dark.state.adapted_cd_m2[0] < 50 < bright.state.adapted_cd_m2[0]
    turned = perceive(frame, EyePose(35.0, 0, 4.0), observer=OBSERVER, state=dark.state, dt_s=0.02)
    assert dark.state.adapted_cd_m2[0] < turned.state.adapted_cd_m2[0] < bright.state.adapted_cd_m2[0]


def test_without_a_measured_pupil_it_is_what_light_and_age_make_it() -> None:
    young, old = (perceive(room(1.0), observer=Observer(age_years=age)).pupil_diameter_mm[0] for age in (20, 80))
    assert 2 < old < young < 8
    assert perceive(room(1000.0), observer=OBSERVER).pupil_diameter_mm[0] < young


def test_a_wider_pupil_has_a_stronger_halo() -> None:
    """The lens fibres lie outside the middle 3 mm; their halo is 3° away."""
    frame = room(0.01, lamp_cd_m2=1e4)
    y, x = np.indices((200, 180))
    away_deg = np.hypot(x - 91, y - 101) / frame.view.ppd_centre
    ring = (away_deg > 2.5) & (away_deg < 3.5)
    narrow, wide = (
        np.asarray(perceive(frame, EyePose(pupil_diameter_mm=mm), observer=OBSERVER, state=RenderState((1.0,))).linear)[
            0, 1
        ]
        for mm in (2.5, 7.5)
    )
    assert wide[ring].mean() > 1.5 * narrow[ring].mean()


@pytest.mark.parametrize("peak_cd_m2", [100.0, 250.0, 400.0, 1000.0, 20000.0])
def test_a_brighter_display_shows_middle_grey_at_the_same_luminance(peak_cd_m2: float) -> None:
    # ACES of 0.18, by hand.
    expected = 100 * 0.18 * (2.51 * 0.18 + 0.03) / (0.18 * (2.43 * 0.18 + 0.59) + 0.14)
    grey = np.full((1, 3, 1, 1), 3.6, np.float32)
    assert np.asarray(tone.aces(grey, np.array([0.05]), peak_cd_m2)) * peak_cd_m2 == pytest.approx(expected, rel=1e-6)
    # And through the whole pipeline: what an adapted eye's exposure brings to 0.18.
    adapted = 100.0
    frame = Frame.from_rgb(np.full((64, 60, 3), 0.18 / adaptation.exposure(adapted), np.float32), 20.0)
    state, display = RenderState((adapted,)), Display(peak_cd_m2=peak_cd_m2)
    bare = Planning(leave_out=frozenset({"glare"}))
    seen = perceive(
        frame, EyePose(pupil_diameter_mm=2.0), observer=OBSERVER, display=display, state=state, planning=bare
    )
    assert np.asarray(seen.linear) * peak_cd_m2 == pytest.approx(expected, rel=1e-6)


def test_a_brighter_display_has_more_room_above_middle_grey_and_a_dimmer_one_shows_the_same_darker() -> None:
    exposed = np.array([0.05, 0.18, 0.5, 2.0, 8.0], np.float32)
    frame = np.broadcast_to(exposed, (1, 3, 1, 5))
    dim, reference, bright = (np.asarray(tone.aces(frame, np.ones(1), peak))[0, 0, 0] for peak in (50.0, 100.0, 400.0))
    np.testing.assert_array_equal(dim, reference)
    assert (400 * bright > 100 * reference)[2:].all()
    assert 400 * bright[0] < 100 * reference[0]


def test_the_analytic_model_glares_wherever_the_eye_looks() -> None:
    frame = room(0.1, lamp_cd_m2=1e5)
    glare = Glare(GlareModel.SPE, GlareLevel.HALF)
    perceived = perceive(frame, EyePose(20.0, 15.0, 4.0), observer=OBSERVER, effects=Effects(glare=glare))
    assert levels(perceived)["glare"] == "half"
    assert perceived.image[0, 100, 60].min() > 0
