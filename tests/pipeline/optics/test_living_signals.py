"""Microfluctuations and hippus: their bands, their sizes, and that they are functions of time and seed alone."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.optics.microfluctuations import fluctuation_d, tones_d
from entoptic.pipeline.optics.ocular_dynamics import hippus_mm
from entoptic.pipeline.optics.value_noise import value_noise

T_S = np.arange(0.0, 800.0, 0.05)


def course_d(seed: int, pupil_diameter_mm: float) -> np.ndarray:
    tones = tones_d(seed, pupil_diameter_mm)
    return (np.exp(1j * T_S[:, None] * tones.omega_rad_s) @ tones.amplitude).real


def band_rms_d(course: np.ndarray, low_hz: float, high_hz: float) -> float:
    window = np.hanning(course.size)
    power = np.abs(np.fft.rfft(course * window)) ** 2
    hz = np.fft.rfftfreq(course.size, 0.05)
    inside = (hz >= low_hz) & (hz < high_hz)
    return float(np.sqrt(2 * power[inside].sum() / course.size / np.sum(window**2)))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_all_power_is_in_two_bands_and_the_low_one_grows_with_the_pupil(seed: int) -> None:
    narrow, wide = course_d(seed, 2.0), course_d(seed, 8.0)
    for course, low_d in ((narrow, 0.066), (wide, 0.264)):
        assert band_rms_d(course, 0.0, 0.605) == pytest.approx(low_d, rel=0.15)
        assert band_rms_d(course, 1.295, 2.105) == pytest.approx(0.08, rel=0.15)
        assert band_rms_d(course, 0.605, 1.295) < 1e-3
        assert band_rms_d(course, 2.105, 10.0) < 1e-3
        assert 0.09 < course.std() < 0.3
    assert np.abs(wide).max() < 1.5


@given(st.integers(0, 2**70), st.floats(0.0, 1e12), st.floats(2.0, 8.0))
def test_fluctuations_are_a_bounded_function_of_time_and_seed(seed: int, t_s: float, pupil_diameter_mm: float) -> None:
    once = fluctuation_d(seed, t_s, pupil_diameter_mm)
    assert once == fluctuation_d(seed, t_s, pupil_diameter_mm)
    assert abs(once) < 2.0


def test_another_seed_wavers_otherwise() -> None:
    assert abs(np.corrcoef(course_d(0, 4.0), course_d(1, 4.0))[0, 1]) < 0.3


@given(st.floats(-1e6, 1e6), st.integers(0, 2**70))
def test_value_noise_is_bounded_and_smooth(x: float, stream: int) -> None:
    here = value_noise(x, stream)
    assert -1.0 <= here <= 1.0
    # Each octave steps by 2 at most, with 3/2 of the mean slope, and is as much faster as it is weaker.
    assert abs(value_noise(x + 1e-4, stream) - here) <= 1e-4 * 3 * 3.0 / 1.75 + 1e-9


def test_value_noise_has_zero_mean_and_no_two_streams_alike() -> None:
    x = np.arange(0.0, 3000.0, 0.1)
    one, other = (np.array([value_noise(v, stream) for v in x.tolist()]) for stream in (1, 2))
    assert abs(one.mean()) < 0.03
    assert one.std() == pytest.approx(0.324, rel=0.05)
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.05


@given(st.floats(2.0, 8.0), st.floats(0.0, 1e9), st.integers(0, 99))
def test_hippus_has_the_size_that_rit_gives_it(mean_mm: float, beats: float, seed: int) -> None:
    got = hippus_mm(mean_mm, beats, seed)
    assert 2.0 <= got <= 8.0
    assert abs(got - mean_mm) <= 0.2 * (9.0 / mean_mm) * math.sqrt(1.0 - mean_mm / 9.0) + 1e-12


def test_bright_light_makes_the_pupil_waver_more() -> None:
    beats = np.arange(0.0, 1000.0, 0.2).tolist()
    three, six = (np.std([hippus_mm(mean_mm, beat, 7) for beat in beats]) for mean_mm in (3.0, 6.0))
    assert three == pytest.approx(0.16, rel=0.1)
    assert six == pytest.approx(0.056, rel=0.1)
