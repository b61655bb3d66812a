"""The offline form: against closed forms, its own symmetries, and what the Microsaccade Toolbox made of real eyes."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from entoptic.tracker_bridge.oracles.engbert_kliegl import (
    Movement,
    binocular,
    excess,
    movements,
    noise_deg_s,
    velocities_deg_s,
    without_overshoots,
)

RATE_HZ = 500.0


def gaze(seed: int, steps: int = 6, samples: int = 1500) -> np.ndarray:
    """Noise of 0.01° with quick steps of 0.3–1° in it."""
    rng = np.random.default_rng(seed)
    x = rng.normal(0.0, 0.01, (samples, 2))
    for at in np.linspace(100, samples - 100, steps).astype(int):
        angle, size = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 1.0)
        x[at:] += size * np.array([np.cos(angle), np.sin(angle)])
        x[at - 3 : at] += size * np.array([np.cos(angle), np.sin(angle)]) * np.array([[0.1], [0.4], [0.8]])
    return x


def test_the_velocity_of_a_line_is_its_slope_everywhere_but_at_the_ends() -> None:
    t = np.arange(50) / RATE_HZ
    v = velocities_deg_s(np.stack([3.0 * t, -7.0 * t + 2.0], axis=1), RATE_HZ)
    np.testing.assert_allclose(v[1:-1], np.tile([3.0, -7.0], (48, 1)), rtol=1e-9)
    assert not v[[0, -1]].any()


def test_the_velocity_of_a_parabola_is_that_at_its_middle() -> None:
    t = np.arange(50) / RATE_HZ
    v = velocities_deg_s(np.stack([40.0 * t**2, 1.0 - 9.0 * t**2], axis=1), RATE_HZ)
    np.testing.assert_allclose(v[1:-1, 0], 80.0 * t[1:-1], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(v[1:-1, 1], -18.0 * t[1:-1], rtol=1e-9, atol=1e-9)


def test_independent_noise_has_two_over_the_window_of_its_own_size_in_the_velocity() -> None:
    v = velocities_deg_s(np.random.default_rng(1).normal(0.0, 0.02, (200_000, 2)), RATE_HZ)
    # Four independent samples over six intervals; a median square of normal noise is 0.6745² of its mean square.
    np.testing.assert_allclose(noise_deg_s(v), 0.6745 * 0.02 * 2.0 * RATE_HZ / 6.0, rtol=0.01)


def test_an_eye_that_never_moves_has_no_movements() -> None:
    assert movements(np.zeros((100, 2)), RATE_HZ) == []


@settings(max_examples=15)
@given(
    seed=st.integers(0, 1000),
    shift=st.tuples(st.floats(-20, 20), st.floats(-20, 20)),
    scale=st.floats(0.01, 100.0),
)
def test_neither_the_place_nor_the_unit_matters(seed: int, shift: tuple[float, float], scale: float) -> None:
    x = gaze(seed)
    plain, moved = movements(x, RATE_HZ), movements(x * scale + np.array(shift) * scale, RATE_HZ)
    assert len(plain) >= 5
    assert [m[:2] for m in moved] == [m[:2] for m in plain]
    np.testing.assert_allclose(np.array([m[2:] for m in moved]), scale * np.array([m[2:] for m in plain]), rtol=1e-6)


@settings(max_examples=15)
@given(seed=st.integers(0, 1000), quarter_turns=st.integers(0, 3))
def test_a_quarter_turn_turns_the_movements(seed: int, quarter_turns: int) -> None:
    x = gaze(seed)
    turn = np.linalg.matrix_power(np.array([[0.0, 1.0], [-1.0, 0.0]]), quarter_turns)
    plain, turned = movements(x, RATE_HZ), movements(x @ turn, RATE_HZ)
    assert [m[:2] for m in turned] == [m[:2] for m in plain]
    ways = [np.array([[m.azimuth_deg, m.elevation_deg] for m in some]) for some in (plain, turned)]
    np.testing.assert_allclose(ways[1], ways[0] @ turn, atol=1e-12)


@settings(max_examples=15)
@given(seed=st.integers(0, 1000), angle=st.floats(0, 2 * np.pi))
def test_any_turn_leaves_movements_alone_where_both_axes_are_equally_noisy(seed: int, angle: float) -> None:
    x = gaze(seed)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    sigma = np.array([0.5, 0.5])
    plain, turned = (movements(y, RATE_HZ, sigma_deg_s=sigma) for y in (x, x @ turn))
    assert [m[:2] for m in turned] == [m[:2] for m in plain]


def test_what_follows_within_20_ms_is_overshoot() -> None:
    some = [Movement(a, b, 1.0, 0.1, 0.0, 0.1, 0.0) for a, b in ((10, 20), (25, 30), (35, 40), (50, 60), (90, 95))]
    assert [m.first for m in without_overshoots(some, RATE_HZ)] == [10, 50, 90]


def test_both_eyes_count_where_they_overlap_and_the_larger_of_several_stays() -> None:
    def move(first: int, last: int, extent: float) -> Movement:
        return Movement(first, last, 1.0, extent, 0.0, extent, 0.0)

    left = [move(10, 20, 0.5), move(40, 45, 0.5), move(70, 80, 0.2)]
    right = [move(15, 17, 0.1), move(19, 25, 0.3), move(46, 50, 0.4), move(82, 90, 0.2)]
    assert binocular(left, right) == [(left[0], right[1]), (left[1], right[2])]


@pytest.fixture
def engbert(shared: Callable[[str], Path]) -> Path:
    return shared("eye/engbert")


@pytest.mark.shared_data
def test_velocities_smoothing_and_threshold_are_the_toolboxs(engbert: Path) -> None:
    x = np.load(engbert / "xr.npy")
    v = velocities_deg_s(x, RATE_HZ)
    np.testing.assert_allclose(v, np.loadtxt(engbert / "xrs_vecvel.dat"), rtol=1e-12, atol=1e-12)
    criterion = np.loadtxt(engbert / "xrs_criterion.dat")
    np.testing.assert_allclose(excess(v, noise_deg_s(v), 5.0), criterion, rtol=1e-12, atol=1e-12)


@pytest.mark.shared_data
def test_binocular_microsaccades_are_the_toolboxs(engbert: Path) -> None:
    both = np.loadtxt(engbert / "f01.005.dat")[3000:4500]
    left, right = (movements(both[:, columns], RATE_HZ, factor=5.0, min_samples=3) for columns in ([1, 2], [3, 4]))
    found = np.array([[*of_left, *of_right] for of_left, of_right in binocular(left, right)])
    expected = np.loadtxt(engbert / "bino.dat")
    expected[:, [0, 1, 7, 8]] -= 1  # the toolbox counts from 1
    assert found.shape == (4, 14)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)
