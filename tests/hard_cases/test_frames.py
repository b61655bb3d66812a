"""Frames and eyes that break other programs."""

import math

import numpy as np
import pytest
from hard_frames import EVERYTHING, FOV_DEG, SMALL, grey, see

from entoptic.pipeline import EyePose, Frame, FrameError, RenderState, perceive
from entoptic.pipeline.effects import adaptation
from entoptic.pipeline.frame import clean


def test_all_black_frame_is_black() -> None:
    assert see(grey(0.0)).image.max() == 0


def test_one_white_pixel_stays_where_it_is() -> None:
    frame = grey(0.0)
    frame[30, 20] = 100.0
    image = see(frame).image[0].astype(int).sum(axis=2)
    assert np.unravel_index(image.argmax(), image.shape) == (30, 20)


def test_nan_pixel_is_contained() -> None:
    frame = grey(1.0)
    clear = see(frame).image
    frame[10, 10, 1] = math.nan
    image = see(frame).image
    far = np.ones(image.shape[1:3], bool)
    far[8:13, 8:13] = False
    assert np.abs(image[0][far].astype(int) - clear[0][far].astype(int)).max() <= 1


def test_infinite_pixel_becomes_the_largest_finite_one() -> None:
    frame = grey(1.0)
    frame[5, 5] = math.inf
    frame[6, 6] = 50.0
    values, cleaned = clean(frame)
    assert (cleaned.infinite, cleaned.nan, cleaned.negative) == (3, 0, 0)
    assert values[5, 5].tolist() == [50, 50, 50]


def test_a_frame_without_a_finite_pixel_is_refused_by_name() -> None:
    with pytest.raises(FrameError, match="no pixel"):
        see(grey(math.nan))


def test_starlight_and_the_sun_together() -> None:
    frame = grey(1e-6)
    frame[3, 3] = 1.6e9
    perceived = see(frame, EyePose(azimuth_deg=20, elevation_deg=-20, pupil_diameter_mm=7.0))
    # Not quite white: an eye adapted to starlight sees with rods, whose grey is tinted.
    assert perceived.image[0, 3, 3].min() >= 250
    assert np.isfinite(np.asarray(perceived.linear)).all()
    assert np.asarray(perceived.linear).min() >= 0


def test_denormals_are_darkness() -> None:
    assert see(grey(1e-42)).image.max() <= 1


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (7, 5), (129, 3)])
def test_tiny_and_odd_frames(size: tuple[int, int]) -> None:
    perceived = see(grey(0.05, *size))
    assert perceived.image.shape == (1, *size, 3)


@pytest.mark.parametrize("luminance", [0.01, 0.03, 0.0300001, 3.0, 1e-6, 1e9])
def test_a_frame_of_one_value_at_a_branch_point(luminance: float) -> None:
    perceived = see(grey(luminance), planning=EVERYTHING)
    assert np.ptp(perceived.image[0], axis=(0, 1)).max() <= 1


@pytest.mark.parametrize("dt_s", [0.0, 1e-9, 10.0, 1e9, -1.0])
def test_any_step_of_time_keeps_adaptation_between_start_and_target(dt_s: float) -> None:
    adapted = adaptation.adapt_cd_m2(0.01, 1000.0, dt_s)
    assert 0.01 <= adapted <= 1000.0
    if dt_s <= 0:
        assert adapted == 0.01


def test_a_step_from_night_to_day_does_not_oscillate() -> None:
    """A known player alternates between 0 and 0.3 for ever at 24 frames a second."""
    adapted, trace = 0.01, []
    for _ in range(48):
        adapted = adaptation.adapt_cd_m2(adapted, 1000.0, 1 / 24)
        trace.append(adapted)
    assert np.all(np.diff(trace) >= 0)
    assert trace[-1] == pytest.approx(1000.0, rel=1e-3)


def test_two_half_steps_of_time_are_one_step() -> None:
    half = adaptation.adapt_cd_m2(adaptation.adapt_cd_m2(0.2, 30.0, 0.05), 30.0, 0.05)
    assert half == pytest.approx(adaptation.adapt_cd_m2(0.2, 30.0, 0.1), rel=1e-12)


@pytest.mark.parametrize("pupil_diameter_mm", [0.0, -1.0, math.nan, math.inf, 13.0])
def test_an_impossible_pupil_is_refused_by_name(pupil_diameter_mm: float) -> None:
    with pytest.raises(FrameError, match="pupil"):
        EyePose(pupil_diameter_mm=pupil_diameter_mm)


@pytest.mark.parametrize("azimuth_deg", [math.nan, math.inf])
def test_a_gaze_that_is_no_number_is_refused_by_name(azimuth_deg: float) -> None:
    with pytest.raises(FrameError, match="gaze"):
        EyePose(azimuth_deg=azimuth_deg)


@pytest.mark.parametrize("azimuth_deg", [-179.0, -95.0, 60.0, 90.0, 180.0])
def test_a_gaze_outside_the_frame_is_legal(azimuth_deg: float) -> None:
    frame = grey(1.0)
    frame[20, 20] = 1e5
    assert see(frame, EyePose(azimuth_deg, 80.0, 3.0)).image.shape == (1, 60, 64, 3)


def test_a_change_of_resolution_in_mid_session_keeps_the_state() -> None:
    state = see(grey(5.0)).state
    again = perceive(
        Frame.from_rgb(grey(5.0, 33, 77), FOV_DEG), EyePose(pupil_diameter_mm=5.0), observer=SMALL, state=state
    )
    assert again.state.adapted_cd_m2 == pytest.approx(state.adapted_cd_m2)


def test_one_eye_for_two_images_of_state_is_refused() -> None:
    with pytest.raises(FrameError, match="give one for each"):
        see(grey(1.0), state=RenderState((1.0, 1.0)))
