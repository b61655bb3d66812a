"""Skipping is safe: what was planned differs nowhere from everything in full by more than the plan says."""

import dataclasses
import math
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline import (
    Display,
    Effects,
    Encoding,
    EyePose,
    Frame,
    Glare,
    GlareLevel,
    GlareModel,
    Light,
    Observer,
    Perceived,
    Planning,
    RenderState,
    perceive,
)
from entoptic.pipeline.budget import Choice
from entoptic.pipeline.cost.scenes import SCENES, scene
from entoptic.pipeline.display_light import black_share
from entoptic.pipeline.effects.acuity import Acuity, AcuityMethod
from entoptic.pipeline.effects.adaptation import Adaptation, Bleaching, Course
from entoptic.pipeline.effects.afterimage import Afterimage
from entoptic.pipeline.effects.glare.settings import Edge
from entoptic.pipeline.effects.night_colour import NightColour, NightMethod
from entoptic.pipeline.effects.rod_noise import RodNoise
from entoptic.pipeline.effects.tone import Hue, Operator, Tone
from entoptic.pipeline.plan import OFF, SKIPPED
from entoptic.pipeline.scenes import open_scene
from entoptic.pipeline.scenes.scene import Head
from entoptic.tracker_bridge.wire import Eye

HDR = Path(__file__).resolve().parents[4] / "shared" / "data" / "hdr"
ROUNDING = 0.02
"""Code values: float32 on the way through five effects, most of it sRGB's steep beginning."""
LAST_PLACE = 1e-4
"""Code values: what XLA contracts in a pass depends on which effects are in it."""
SHOWN = Display()
WITHOUT_FILE = [operator for operator in Operator if operator is not Operator.CURVE]
EYE = Observer(particles=100, gratings=20, cornea_cells=300, vitreous_particles=20)


def code_values(perceived: Perceived, display: Display) -> np.ndarray:
    """sRGB before rounding, by its definition, for a display with a black of its own."""
    black = black_share(display)
    x = np.clip((np.asarray(perceived.linear, np.float64) - black) / (1 - black), 0, 1)
    return 255 * np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def differs(planned: Perceived, full: Perceived, display: Display = SHOWN) -> float:
    return float(np.abs(code_values(planned, display) - code_values(full, display)).max())


def planned_and_full(frame: Frame, eye: EyePose, **more: object) -> tuple[Perceived, Perceived]:
    return tuple(  # type: ignore[return-value]
        perceive(frame, eye, **{"observer": EYE, **more, "planning": planning})
        for planning in (Planning(), Planning(everything=True))
    )


def holds(frame: Frame, eye: EyePose, **more: object) -> Perceived:
    planned, full = planned_and_full(frame, eye, **more)
    assert all(step.level not in (SKIPPED,) for step in full.plan)
    assert full.plan.bound_code_values == 0
    difference = differs(planned, full, more.get("display", SHOWN))
    assert difference <= planned.plan.bound_code_values + ROUNDING, [
        (step.effect, step.level, step.bound_code_values) for step in planned.plan
    ]
    if all(step.level != SKIPPED for step in planned.plan) and planned.plan["glare"].level == "quarter":
        assert difference < LAST_PLACE
    return planned


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("pupil_diameter_mm", [2.0, 6.5])
def test_on_the_scenes_that_costs_are_measured_on(name: str, pupil_diameter_mm: float) -> None:
    made = scene(name, 180, 200)
    holds(made.frame, EyePose(3.0, -2.0, pupil_diameter_mm))


@pytest.mark.shared_data
@pytest.mark.parametrize("path", sorted(HDR.glob("*.hdr")) + sorted(HDR.glob("*.exr")), ids=lambda path: path.stem)
def test_on_real_frames_from_starlight_to_daylight(path: Path) -> None:
    for mean_cd_m2 in 10.0 ** np.arange(-3, 5, 2):
        opened = open_scene(str(path), mean_luminance_cd_m2=float(mean_cd_m2))
        frame = opened.frame(0.0, opened.view_for(180, None, 104.0), Head(), (Eye.LEFT,))
        holds(frame, EyePose(pupil_diameter_mm=4.0), effects=Effects(glare=Glare(GlareModel.CIE)))


@given(
    seed=st.integers(0, 2**32 - 1),
    grain=st.sampled_from([1, 3, 10, 80]),
    log_cd_m2=st.floats(-6, 5),
    decades=st.sampled_from([0.0, 0.01, 0.1, 1.0, 6.0]),
    log_adapted=st.floats(-6, 5),
    effects=st.builds(
        Effects,
        glare=st.builds(
            Glare,
            model=st.sampled_from([GlareModel.CIE, GlareModel.IJSPEERT]),
            level=st.sampled_from([GlareLevel.EIGHTH, GlareLevel.QUARTER, GlareLevel.HALF]),
            above_display=st.booleans(),
        ),
        adaptation=st.builds(
            Adaptation,
            course=st.sampled_from([Course.LUI, Course.OVERSHOOT]),
            robust=st.booleans(),
            bleaching=st.sampled_from([Bleaching.OFF, Bleaching.PATTANAIK]),
        ),
        acuity=st.builds(Acuity, method=st.sampled_from(AcuityMethod), display_limit=st.booleans()),
        rod_noise=st.builds(RodNoise, on=st.booleans()),
        tone=st.builds(Tone, operator=st.sampled_from(WITHOUT_FILE), hue=st.sampled_from(Hue)),
        night_colour=st.one_of(
            st.builds(NightColour, method=st.sampled_from(NightMethod), mesopic=st.booleans()),
            st.builds(NightColour, method=st.sampled_from(NightMethod), per_pixel=st.just(True)),
        ),
        afterimage=st.builds(Afterimage, on=st.booleans()),
    ),
    display=st.builds(
        Display,
        peak_cd_m2=st.sampled_from([80.0, 1000.0]),
        black_cd_m2=st.sampled_from([0.0, 0.5]),
        surround_cd_m2=st.sampled_from([0.0, 50.0]),
    ),
    dt_s=st.sampled_from([0.0, 0.1]),
)
def test_on_random_frames(
    seed: int,
    grain: int,
    log_cd_m2: float,
    decades: float,
    log_adapted: float,
    effects: Effects,
    display: Display,
    dt_s: float,
) -> None:
    random = np.random.default_rng(seed)
    coarse = 10 ** random.uniform(
        log_cd_m2 - decades / 2, log_cd_m2 + decades / 2, (-(-64 // grain), -(-60 // grain), 3)
    )
    frame = Frame.from_rgb(coarse.repeat(grain, 0).repeat(grain, 1)[:64, :60], 60.0)
    state = RenderState((10**log_adapted,))
    holds(frame, EyePose(2.0, 1.0, 4.0), state=state, dt_s=dt_s, effects=effects, display=display)


def test_in_a_bright_room_nothing_is_called_for_unless_its_edges_are_dark() -> None:
    frame, eye = scene("bright room", 360, 400).frame, EyePose(pupil_diameter_mm=3.0)
    planned = holds(frame, eye)
    assert all(planned.plan[effect].level == SKIPPED for effect in ("glare", "acuity", "night_colour"))
    assert planned.plan.bound_code_values < 5
    in_the_dark = holds(frame, eye, effects=Effects(glare=Glare(edge=Edge.DARK)))
    assert in_the_dark.plan["glare"].level != SKIPPED


def test_what_is_switched_off_is_no_skip() -> None:
    plan = perceive(scene("dusk", 90, 100).frame, EyePose(pupil_diameter_mm=3.0), observer=EYE).plan
    assert plan["rod_noise"].level == plan["afterimage"].level == OFF


@pytest.mark.parametrize("effect", ["glare", "acuity", "night_colour"])
def test_what_is_left_out_as_asked_says_what_that_hides(effect: str) -> None:
    frame = scene("night street", 180, 200).frame
    full = perceive(frame, EyePose(pupil_diameter_mm=5.0), observer=EYE, planning=Planning(everything=True))
    bare = perceive(
        frame,
        EyePose(pupil_diameter_mm=5.0),
        observer=EYE,
        planning=Planning(everything=True, leave_out=frozenset({effect})),
    )
    assert bare.plan[effect].level == SKIPPED
    assert 0 < differs(bare, full) <= bare.plan.bound_code_values + ROUNDING
    assert bare.plan[effect].bound_code_values == bare.plan.bound_code_values


def test_a_display_in_hdr_plans_in_its_own_codes() -> None:
    frame = scene("bright room", 180, 200).frame
    hdr = Display(peak_cd_m2=1000.0, encoding=Encoding.HDR10)
    planned, full = planned_and_full(frame, EyePose(pupil_diameter_mm=3.0), display=hdr)
    assert planned.image.dtype == np.uint16
    off = np.abs(planned.image.astype(int) - full.image.astype(int)).max()
    assert off <= planned.plan.bound_code_values + 1


def test_beside_lights_of_their_own_nothing_is_left_out() -> None:
    """They are in no pixel, so no range knows of them."""
    frame = Frame.from_rgb(np.full((64, 64, 3), 0.3), 60.0)
    lit = dataclasses.replace(frame, lights=(Light(3.0, 2.0, 5.0, 0.3, "LED-B3"),))
    planned, full = planned_and_full(lit, EyePose(pupil_diameter_mm=4.0), state=RenderState((3.0,)))
    assert differs(planned, full) < LAST_PLACE
    assert planned.plan.bound_code_values == 0
    bare = perceive(lit, observer=EYE, planning=Planning(leave_out=frozenset({"glare"})))
    assert bare.plan["glare"].reason == "left out as asked"
    assert bare.plan.bound_code_values == math.inf


def test_of_two_eyes_the_bounds_are_those_of_the_worse() -> None:
    one = scene("bright room", 180, 200).frame
    both = dataclasses.replace(one, rgb_cd_m2=jnp.concatenate([one.rgb_cd_m2, 0.05 * one.rgb_cd_m2]))
    plan = holds(both, EyePose(pupil_diameter_mm=3.0)).plan
    alone = [
        perceive(
            dataclasses.replace(one, rgb_cd_m2=k * one.rgb_cd_m2), EyePose(pupil_diameter_mm=3.0), observer=EYE
        ).plan
        for k in (1.0, 0.05)
    ]
    if plan["glare"].level == SKIPPED:
        assert plan["glare"].bound_code_values >= max(of["glare"].bound_code_values for of in alone) * 0.999


@pytest.mark.parametrize("name", ["bright room", "moonlight", "night street"])
@pytest.mark.parametrize("fade", [0.2, 0.7])
def test_between_two_levels_the_bound_holds_too(name: str, fade: float) -> None:
    frame = scene(name, 90, 100).frame
    choices = {
        "glare": Choice("quarter", "eighth", fade),
        "acuity": Choice("fit", SKIPPED, fade),
        "night_colour": Choice("lui", SKIPPED, fade),
    }
    full = perceive(frame, EyePose(pupil_diameter_mm=4.0), observer=EYE, planning=Planning(everything=True))
    before = dataclasses.replace(full.state, choices=choices, reusable={})
    passing = perceive(frame, EyePose(pupil_diameter_mm=4.0), observer=EYE, state=before)
    assert any(step.fading_from for step in passing.plan)
    again = perceive(
        frame, EyePose(pupil_diameter_mm=4.0), observer=EYE, state=before, planning=Planning(everything=True)
    )
    assert differs(passing, again) <= passing.plan.bound_code_values + ROUNDING


@pytest.mark.parametrize("budget_ms", [0.5, 3.0, 20.0])
def test_within_a_budget_what_is_paid_is_said(budget_ms: float) -> None:
    frame = scene("night street", 180, 200).frame
    full = perceive(frame, EyePose(pupil_diameter_mm=5.0), observer=EYE, planning=Planning(everything=True))
    planned = perceive(frame, EyePose(pupil_diameter_mm=5.0), observer=EYE, planning=Planning(budget_ms=budget_ms))
    assert differs(planned, full) <= planned.plan.bound_code_values + ROUNDING
