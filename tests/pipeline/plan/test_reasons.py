"""What a plan says of each real effect: figures that can be read off a small frame, in the words that say so."""

from __future__ import annotations

import re

import numpy as np
import pytest

from entoptic.pipeline import Effects, EyePose, Frame, Glare, GlareLevel, GlareModel, Observer, Planning, RenderState
from entoptic.pipeline import perceive as perceived_by
from entoptic.pipeline.effects import EFFECTS
from entoptic.pipeline.effects.afterimage import Afterimage
from entoptic.pipeline.effects.night_colour import NightColour
from entoptic.pipeline.effects.rod_noise import RodNoise
from entoptic.pipeline.plan import OFF, SKIPPED, Plan

EYE = Observer(particles=50, gratings=0, cornea_cells=0)
ALL_ON = Effects(
    glare=Glare(model=GlareModel.CIE, level=GlareLevel.QUARTER),
    rod_noise=RodNoise(on=True),
    afterimage=Afterimage(on=True),
)
PLANNING = Planning()
NUMBER = r"[0-9.e+-]+"
CODES = rf"a pixel changes by ({NUMBER}) code values at most"


def frame(*dark_cd_m2: float, rest_cd_m2: float) -> Frame:
    """64×60 pixels of one grey, a tenth of them of each of some darker ones."""
    grey = np.full(64 * 60, rest_cd_m2)
    for k, cd_m2 in enumerate(dark_cd_m2):
        grey[384 * k : 384 * (k + 1)] = cd_m2
    return Frame.from_rgb(np.repeat(grey.reshape(64, 60, 1), 3, axis=2), 40.0)


def plan_of(of: Frame, effects: Effects = ALL_ON, planning: Planning = PLANNING, adapted: float = 1.0) -> Plan:
    return perceived_by(
        of,
        EyePose(pupil_diameter_mm=5.0),
        observer=EYE,
        effects=effects,
        planning=planning,
        state=RenderState((adapted,)),
    ).plan


@pytest.fixture(scope="module")
def dark() -> Plan:
    return plan_of(frame(0.0004, 0.004, rest_cd_m2=0.05), adapted=0.01)


def test_rod_noise_says_how_dark_it_is(dark: Plan) -> None:
    step = dark["rod_noise"]
    said = re.fullmatch(
        rf"darkest pixel 0\.0004 cd/m², 20% of the frame below 0\.01 cd/m²: without it, {CODES}", step.reason
    )
    assert said, step.reason
    assert (step.level, float(said[1]) > 1) == ("on", True)
    only_the_darkest = plan_of(
        frame(0.0004, 0.004, rest_cd_m2=0.05), Effects(rod_noise=RodNoise(on=True, below_cd_m2=0.001)), adapted=0.01
    )["rod_noise"]
    assert only_the_darkest.reason.startswith("darkest pixel 0.0004 cd/m², 10% of the frame below 0.001 cd/m²: ")
    bright = plan_of(frame(rest_cd_m2=30.0))["rod_noise"]
    assert bright.level == SKIPPED
    assert bright.reason == (
        "darkest pixel 30 cd/m², 0% of the frame below 0.01 cd/m²: without it, a pixel changes by 0 code values at most"
    )


def test_afterimages_say_where_they_come_from() -> None:
    """An eye at rest sees none; one that has viewed a lamp for seconds sees its afterimage on a dark wall."""
    rest = plan_of(frame(rest_cd_m2=30.0))["afterimage"]
    assert rest.level == SKIPPED
    assert rest.reason == (
        "what the retina keeps of what was seen before: without it, a pixel changes by 0 code values at most"
    )
    lamp = Frame.from_rgb(np.where(np.arange(60)[None, :, None] < 20, 2e4, 1.0) * np.ones((64, 60, 3)), 40.0)
    more = {"observer": EYE, "effects": ALL_ON, "dt_s": 5.0}
    viewed = perceived_by(lamp, EyePose(pupil_diameter_mm=5.0), **more)
    viewed = perceived_by(lamp, EyePose(pupil_diameter_mm=5.0), state=viewed.state, **more)
    step = perceived_by(frame(rest_cd_m2=1.0), EyePose(pupil_diameter_mm=5.0), state=viewed.state, **more).plan[
        "afterimage"
    ]
    said = re.match(rf"what the retina keeps of what was seen before: without it, {CODES}", step.reason)
    assert said, step.reason
    assert (step.level, float(said[1]) > 1) == ("on", True)


def test_acuity_says_how_dark_it_is_and_what_an_eye_resolves(dark: Plan) -> None:
    step = dark["acuity"]
    assert re.fullmatch(
        rf"darkest pixel 0\.0004 cd/m², 20% of the frame below 0\.01 cd/m²: without it, {CODES}", step.reason
    ), step.reason
    assert step.level == "fit"
    bright = plan_of(frame(rest_cd_m2=30.0))["acuity"]
    said = re.match(
        rf"darkest pixel 30 cd/m², 0% of the frame below 0\.01 cd/m²; an eye resolves every pixel above ({NUMBER}): "
        "without it, a pixel changes by 0 code values at most",
        bright.reason,
    )
    assert said, bright.reason
    assert (bright.level, float(said[1]) < 30) == (SKIPPED, True)


def test_night_colour_says_what_rods_carry(dark: Plan) -> None:
    reason = dark["night_colour"].reason
    said = re.match(rf"adapted to 0\.01 cd/m², rods carry ({NUMBER}) of vision: without it, {CODES}", reason)
    assert said, reason
    assert 0.5 < float(said[1]) <= 1
    day = plan_of(frame(rest_cd_m2=300.0), adapted=300.0)["night_colour"]
    said = re.match(rf"adapted to 300 cd/m², rods carry ({NUMBER}) of vision: without it", day.reason)
    assert said, day.reason
    assert float(said[1]) < 0.001
    each = plan_of(frame(0.4, rest_cd_m2=5.0), Effects(night_colour=NightColour(per_pixel=True)))["night_colour"]
    assert each.reason.startswith(
        "darkest pixel 0.4 cd/m², 10% of the frame below 3 cd/m², and each has its own share of rods: without it"
    )


def test_glare_says_what_is_brightest(dark: Plan) -> None:
    said = re.fullmatch(
        rf"brightest pixel 0\.05 cd/m², no light stands out: without it, by ({NUMBER}) cd/m² at most, "
        rf"over the eye's threshold of ({NUMBER}); {CODES}",
        dark["glare"].reason,
    )
    assert said, dark["glare"].reason
    assert dark["glare"].level == "quarter"
    assert 0 < float(said[2]) <= float(said[1]) < 0.05
    wall = plan_of(frame(rest_cd_m2=300.0), Effects(), adapted=300.0)["glare"]
    assert wall.reason.startswith("brightest pixel 300 cd/m², no light stands out: ")


def test_what_every_frame_needs_says_so(dark: Plan) -> None:
    assert dark["adaptation"].reason == "adapted to 0.01 cd/m²"
    assert dark["tone"].reason == "every display needs it"


def test_what_is_switched_off_or_left_out_says_so() -> None:
    wall = frame(rest_cd_m2=0.001)
    optional = frozenset(effect.name for effect in EFFECTS if effect.optional)
    off = plan_of(wall, Effects())
    assert {step.effect: step.reason for step in off if step.level == OFF} == dict.fromkeys(
        ("rod_noise", "afterimage"), "switched off in the settings"
    )
    bare = plan_of(wall, planning=Planning(leave_out=optional))  # type: ignore[arg-type]
    assert {step.effect: step.reason for step in bare if step.level == SKIPPED} == dict.fromkeys(
        optional, "left out as asked"
    )
