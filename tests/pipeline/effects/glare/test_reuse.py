"""A static scene before a static eye costs nothing per frame: the same result serves while nothing changes."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from entoptic.pipeline import (
    Effects,
    EyePose,
    Frame,
    Glare,
    GlareLevel,
    Light,
    Observer,
    OcularDynamics,
    Perceived,
    Planning,
    RenderState,
    perceive,
)

EYE = Observer(gratings=20)


def lamp() -> Frame:
    rgb = np.full((60, 64, 3), 0.01, np.float32)
    rgb[30, 32] = 1e4
    return Frame.from_rgb(rgb, 40.0)


FRAME = lamp()
RESTING = EyePose(pupil_diameter_mm=5.0)


def seen(frame: Frame = FRAME, eye: EyePose = RESTING, **more: object) -> Perceived:
    return perceive(frame, eye, **{"observer": EYE, "state": RenderState((1.0,)), **more})


def again(before: Perceived, frame: Frame = FRAME, eye: EyePose = RESTING, **more: object) -> bool:
    """Whether the next frame has the same glare, not computed again."""
    after = perceive(frame, eye, **{"observer": EYE, "state": before.state, "dt_s": 1 / 60, **more})
    assert (after.state.reusable["glare"] is before.state.reusable["glare"]) == ("glare" in after.reused)
    return "glare" in after.reused


def test_nothing_changed_is_not_computed_again() -> None:
    assert again(seen())


@pytest.mark.parametrize(
    "change",
    [
        {"eye": EyePose(pupil_diameter_mm=5.1)},
        {"effects": Effects(glare=Glare(level=GlareLevel.HALF))},
        {"observer": Observer(gratings=21)},
        {"frame": lamp()},
        {"frame": dataclasses.replace(FRAME, lights=(Light(0, 0, 1.0),))},
    ],
    ids=["pupil", "level", "observer", "another frame", "lights"],
)
def test_what_changes_glare_is_computed(change: dict[str, object]) -> None:
    assert not again(seen(), **change)


def test_a_gaze_changes_nothing() -> None:
    assert again(seen(), eye=EyePose(azimuth_deg=3.0, pupil_diameter_mm=5.0))


def test_lids_that_touch_no_light_change_nothing_and_those_that_do_do() -> None:
    blinking = Observer(gratings=20, ocular_dynamics=OcularDynamics(lids=True))
    before = seen(observer=blinking)
    assert again(before, eye=EyePose(pupil_diameter_mm=5.0, openness=0.95), observer=blinking)
    assert not again(before, eye=EyePose(pupil_diameter_mm=5.0, openness=0.5), observer=blinking)


def test_a_lens_in_motion_is_computed_each_time() -> None:
    moving = Observer(gratings=0, particles=50, ocular_dynamics=OcularDynamics(microfluctuations=True, lens=True))
    assert not again(seen(observer=moving, dt_s=0.1), observer=moving)


@pytest.mark.parametrize("level", GlareLevel)
def test_only_what_the_display_cannot_show_scatters_if_asked(level: GlareLevel) -> None:
    dim = np.full((60, 64, 3), 2.0, np.float32)
    dim[30, 32] = 12.0  # a display of 100 cd/m² shows up to 45 to an eye adapted to 1
    asked = {
        "effects": Effects(glare=Glare(level=level, above_display=True)),
        "planning": Planning(everything=True),
    }
    below = seen(Frame.from_rgb(dim, 40.0), **asked).state.reusable["glare"]
    assert below.result.dtype == jnp.float32
    np.testing.assert_allclose(below.result, dim.transpose(2, 0, 1)[None], rtol=1e-6)
    above = seen(**asked).state.reusable["glare"]
    assert above.result.dtype == jnp.float32
    assert float(above.result[0, 1, 30, 32]) < 1e4
