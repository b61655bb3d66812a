"""What an eye adapts to, against closed forms."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from entoptic.pipeline import Effects, EyePose, Observer, View, perceive
from entoptic.pipeline.effects.adaptation import FLOOR_CD_M2, Adaptation, Target, target_cd_m2
from entoptic.pipeline.effects.adaptation.targets import LIMIT
from entoptic.pipeline.frame import Frame
from entoptic.pipeline.measure import Measurement, measure
from entoptic.pipeline.scenes import Head
from entoptic.pipeline.scenes.discs import add_discs
from entoptic.pipeline.scenes.panorama import Panorama
from entoptic.tracker_bridge.wire import Eye

WINDOWED = (Target.LUI, Target.BAR_VIEW)


def measured(luminance: np.ndarray, fov_deg: float = 60.0) -> Measurement:
    return measure(Frame.from_rgb(np.repeat(luminance[:, :, None], 3, axis=2).astype(np.float32), fov_deg))[0]


def halves(left: float, right: float, edge_px: int, width_px: int = 400, height_px: int = 400) -> np.ndarray:
    return np.broadcast_to(np.where(np.arange(width_px) < edge_px, left, right), (height_px, width_px))


@pytest.mark.parametrize("target", Target)
@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("size", [(1, 1), (1, 2), (2, 2), (3, 129), (200, 131)])
def test_a_frame_of_one_value_is_its_own_target(target: Target, robust: bool, size: tuple[int, int]) -> None:
    how = Adaptation(target=target, robust=robust)
    for luminance in (0.01, 0.03, 7.0, 1e9):
        seen = target_cd_m2(measured(np.full(size, luminance)), 3.0, -2.0, how)
        assert seen == pytest.approx(luminance, rel=1e-6 if target is not Target.KRI else 2e-4)


@pytest.mark.parametrize("target", Target)
@pytest.mark.parametrize("robust", [False, True])
def test_before_a_black_frame_an_eye_is_adapted_to_starlight(target: Target, robust: bool) -> None:
    how = Adaptation(target=target, robust=robust)
    assert target_cd_m2(measured(np.zeros((40, 50))), 0.0, 0.0, how) == pytest.approx(FLOOR_CD_M2, rel=1e-12)


def test_the_gaussian_at_the_gaze_is_one() -> None:
    """An edge one tenth of a standard deviation and more off the gaze, by the normal distribution."""
    sd_px = 10 * measured(halves(0.0, 100.0, 200), 100.0).view.ppd_centre
    for edge_px in (160, 200, 204, 228, 260):
        seen = target_cd_m2(measured(halves(0.0, 100.0, edge_px), 100.0), 0.0, 0.0)
        assert seen == pytest.approx(100 * scipy.stats.norm.sf((edge_px - 200) / sd_px), abs=0.05)


def test_a_wider_gaussian_sees_farther() -> None:
    edge = measured(halves(0.0, 100.0, 260), 100.0)
    narrow, wide = (target_cd_m2(edge, 0.0, 0.0, Adaptation(gaze_sd_deg=sd)) for sd in (5.0, 20.0))
    assert narrow < 0.1 < 10 < wide


@pytest.mark.parametrize("target", Target)
def test_only_the_papers_gaze_window_follows_the_gaze(target: Target) -> None:
    edge = measured(halves(1.0, 100.0, 200))
    left, right = (target_cd_m2(edge, azimuth, 0.0, Adaptation(target=target)) for azimuth in (-15.0, 15.0))
    assert (right > 2 * left) if target is Target.LUI else (right == left)


def test_a_gaze_outside_the_frame_takes_its_edge() -> None:
    edge = measured(halves(1.0, 100.0, 200))
    seen = {target_cd_m2(edge, azimuth, 0.0) for azimuth in (31.0, 80.0, 179.0)}
    assert max(seen) == pytest.approx(min(seen), rel=1e-3)
    assert min(seen) > 99


def test_the_geometric_mean_is_that_of_every_pixel_of_a_small_frame() -> None:
    luminance = 10 ** np.random.default_rng(1).uniform(-5, 4, (60, 100))
    expected = math.exp(np.log(luminance.astype(np.float32).astype(float) + 1e-6).mean())
    assert target_cd_m2(measured(luminance), 0.0, 0.0, Adaptation(target=Target.KRI)) == pytest.approx(expected, 1e-5)


def test_the_mean_of_the_whole_frame_counts_every_pixel_once() -> None:
    """Also those of tiles that the frame's edge cuts."""
    luminance = np.random.default_rng(2).uniform(0, 5, (201, 390))
    seen = target_cd_m2(measured(luminance), 0.0, 0.0, Adaptation(target=Target.BAR_SCENE))
    assert seen == pytest.approx(luminance.mean(), rel=1e-6)


def test_of_a_panorama_the_scene_is_the_whole_sphere_wherever_the_head_turns() -> None:
    """A cap of 60° around the zenith covers (1 − cos 60°)/2 of it."""
    cap = np.zeros((3, 60, 120), np.float32)
    cap[:, :20] = 8.0
    panorama = Panorama(cap, "a bright sky")
    how = Effects(adaptation=Adaptation(target=Target.BAR_SCENE))
    for head in (Head(), Head(pitch_deg=80.0)):
        frame = panorama.frame(0.0, View(32, 32, 60.0), head, (Eye.LEFT,))
        seen = perceive(frame, EyePose(pupil_diameter_mm=3.0), observer=Observer(gratings=0, particles=0), effects=how)
        assert seen.state.adapted_cd_m2[0] == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize("size", [(256, 256), (200, 384)])
def test_weights_of_the_view_fall_by_the_paper(size: tuple[int, int]) -> None:
    """A luminance that is d²: ∫ d³(1 − 4d²) over ∫ d(1 − 4d²), from 0 to ½, is 1/12."""
    y, x = ((2 * np.arange(side) + 1) / side - 1 for side in size)
    squared = y[:, None] ** 2 + x[None, :] ** 2
    how = Adaptation(target=Target.BAR_VIEW)
    assert target_cd_m2(measured(squared), 0.0, 0.0, how) == pytest.approx(1 / 12, rel=2e-3)
    beyond = np.where(squared > 0.52**2, 1e6, squared)
    assert target_cd_m2(measured(beyond), 0.0, 0.0, how) == pytest.approx(1 / 12, rel=2e-3)


# Few sizes: measuring is compiled for each.
FRAMES = st.sampled_from([(1, 1), (5, 3), (9, 12)]).flatmap(
    lambda size: hnp.arrays(np.float32, size, elements=st.floats(0, 1e9, width=32))
)


@given(FRAMES, st.sampled_from(Target), st.booleans(), st.floats(-180, 180), st.floats(-90, 90))
def test_a_target_lies_within_the_frame(
    luminance: np.ndarray, target: Target, robust: bool, azimuth_deg: float, elevation_deg: float
) -> None:
    frame = measured(luminance)
    seen = target_cd_m2(frame, azimuth_deg, elevation_deg, Adaptation(target=target, robust=robust))
    assert frame.min_cd_m2 * (1 - 1e-5) <= seen <= max(frame.max_cd_m2 * (1 + 1e-5), 2 * FLOOR_CD_M2)
    assert seen <= 1.001 * target_cd_m2(frame, azimuth_deg, elevation_deg, Adaptation(target=target)) + FLOOR_CD_M2


@pytest.mark.parametrize("target", Target)
def test_where_nothing_stands_out_the_limit_changes_nothing(target: Target) -> None:
    luminance = np.random.default_rng(4).uniform(1.0, 25.0, (90, 80))
    plain, robust = (
        target_cd_m2(measured(luminance), 0.0, 0.0, Adaptation(target=target, robust=on)) for on in (False, True)
    )
    assert robust == plain


def test_a_small_light_counts_for_no_more_than_the_limit_however_bright() -> None:
    """One pixel of 64² under weights that are all alike: the geometric mean by hand."""
    frame = np.full((64, 64), 0.05)
    frame[30, 31] = 1.6e9
    seen = target_cd_m2(measured(frame), 0.0, 0.0, Adaptation(target=Target.BAR_SCENE, robust=True))
    geometric = math.exp((4095 * math.log(0.05) + math.log(1.6e9)) / 4096)
    assert seen == pytest.approx((4095 * 0.05 + LIMIT * geometric) / 4096, rel=1e-4)


@pytest.mark.parametrize("target", WINDOWED)
def test_a_lamp_that_grows_moves_a_robust_target_without_a_jump(target: Target) -> None:
    frame = np.full((64, 64), 0.05)
    seen = []
    for lamp in np.geomspace(0.05, 1e9, 200):
        frame[30, 31] = lamp
        seen.append(target_cd_m2(measured(frame), 0.0, 0.0, Adaptation(target=target, robust=True)))
    steps = np.diff(np.log(seen))
    # A lamp steps by 13 % from each to the next.
    assert (steps >= 0).all()
    assert steps.max() < 0.05
    assert seen[-1] < 0.06


@functools.cache
def crossing(*, blinks: bool) -> list[Measurement]:
    """A lamp of 0.3° and 3e4 cd/m² that crosses the view in a second, at 60 frames; blinking at 5 Hz or not."""
    dark = Frame.from_rgb(np.full((96, 96, 3), 0.05, np.float32), 60.0)
    radius_px = jnp.full(1, 0.15 * dark.view.ppd_centre)
    draw = jax.jit(
        lambda x_px, luminance: add_discs(
            dark.rgb_cd_m2[0], x_px[None], jnp.full(1, 47.2), radius_px, jnp.full((1, 3), luminance), 6
        )
    )
    lit = [not blinks or frame // 6 % 2 == 0 for frame in range(60)]
    images = [draw(x_px, 3e4 * on) for x_px, on in zip(np.linspace(10.3, 85.7, 60), lit, strict=True)]
    return [measure(Frame(image[None], dark.view))[0] for image in images]


@pytest.mark.parametrize("target", WINDOWED)
@pytest.mark.parametrize("blinks", [False, True])
def test_a_small_lamp_in_the_window_moves_a_robust_target_far_less(target: Target, blinks: bool) -> None:
    plain, robust = (
        np.ptp([math.log10(target_cd_m2(seen, 0.0, 0.0, how)) for seen in crossing(blinks=blinks)])
        for how in (Adaptation(target=target), Adaptation(target=target, robust=True))
    )
    assert plain > 1.2
    assert robust < plain / 5
