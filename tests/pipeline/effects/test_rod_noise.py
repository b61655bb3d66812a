"""Rods' noise against Poisson's distribution, and what it must leave alone."""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.effects.rod_noise import (
    INTEGRATION_S,
    LARGEST,
    RODS_PER_DEG2,
    THERMAL_PER_S,
    RodNoise,
    add_noise,
    propagate,
    skip_bound,
)
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, FrameError
from entoptic.pipeline.mesopic import WHITE_RATIO
from entoptic.pipeline.ranges import Change, Range

PUPIL_MM = 7.0
GRAIN_PX = 4
PPD = GRAIN_PX / 0.3
NOISE = RodNoise(on=True)


def events(luminance_cd_m2: float) -> float:
    """Of white light and heat in a grain of 0.3° and 0.1 s, written out."""
    rods = 7000 * 0.3**2
    trolands = WHITE_RATIO * luminance_cd_m2 * math.pi / 4 * PUPIL_MM**2
    return rods * 0.1 * (8.6 * trolands + 1 / 160)


def noisy(frame: np.ndarray, elapsed_s: float = 0.0, noise: RodNoise = NOISE, ppd: float = PPD) -> np.ndarray:
    shown = add_noise(jnp.asarray(frame, jnp.float32), elapsed_s, [PUPIL_MM] * frame.shape[0], ppd, noise)
    assert shown.dtype == jnp.float32
    return np.asarray(shown, dtype=np.float64)


def grey(luminance_cd_m2: float, side: int = 400) -> np.ndarray:
    return np.full((1, 3, side, side), luminance_cd_m2, np.float32)


@pytest.mark.parametrize("luminance_cd_m2", [1e-6, 1e-5, 1e-4, 1e-3, 5e-3])
def test_the_mean_is_kept_and_the_scatter_is_that_of_counting(luminance_cd_m2: float) -> None:
    shown = np.stack([noisy(grey(luminance_cd_m2), 0.25 * k)[0, 1] for k in range(6)]) / luminance_cd_m2
    count = events(luminance_cd_m2)
    expected = (1 - luminance_cd_m2 / 0.01) / math.sqrt(count)
    grains = shown.size / GRAIN_PX**2
    assert abs(shown.mean() - 1) < 5 * expected / math.sqrt(grains)
    # The variance is N − 1/8 for normal noise, less for this, whose tails are short: felt where single events count.
    assert shown.std() == pytest.approx(expected * math.sqrt(1 - 0.125 / count), rel=0.05)
    assert shown.min() >= 0


def test_counts_are_spread_as_poissons() -> None:
    luminance_cd_m2 = 2e-4
    count = events(luminance_cd_m2)
    noise = RodNoise(on=True, below_cd_m2=1.0)
    shown = np.stack([noisy(grey(luminance_cd_m2), 0.25 * k, noise)[0, 1] for k in range(6)])
    counts = shown / luminance_cd_m2 * count
    for share in (0.02, 0.1, 0.25, 0.5, 0.75, 0.9, 0.98):
        assert abs(np.quantile(counts, share) - scipy.stats.poisson.ppf(share, count)) < 1
    assert scipy.stats.skew(counts.ravel()) == pytest.approx(1 / math.sqrt(count), rel=0.35)


def test_the_same_seed_time_and_eye_give_the_same_noise_and_others_another() -> None:
    frame = grey(1e-4, 200)
    first = noisy(frame, 0.37)
    np.testing.assert_array_equal(first, noisy(frame, 0.37))
    for other in (noisy(frame, 0.77), noisy(frame, 0.37, RodNoise(seed=1))):
        assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < 0.05
    both = noisy(np.repeat(frame, 2, axis=0), 0.37)
    assert abs(np.corrcoef(both[0].ravel(), both[1].ravel())[0, 1]) < 0.05
    np.testing.assert_array_equal(both[:1], first)


def test_noise_is_smooth_within_the_time_that_rods_integrate() -> None:
    frame = grey(1e-3, 200)
    start = noisy(frame, 0.31).ravel()
    assert np.corrcoef(start, noisy(frame, 0.321).ravel())[0, 1] > 0.9
    assert abs(np.corrcoef(start, noisy(frame, 0.31 + 2 * INTEGRATION_S).ravel())[0, 1]) < 0.05
    # At the border of two slots.
    before, after = noisy(frame, 0.4 - 1e-6), noisy(frame, 0.4 + 1e-6)
    np.testing.assert_allclose(before, after, rtol=1e-3)


def test_a_pixel_does_not_drift_over_ten_minutes() -> None:
    frame = grey(1e-4, 16)
    shown = np.stack([noisy(frame, 600 * k / 400)[0, 0] for k in range(400)]) / 1e-4
    spread = shown.std() / math.sqrt(400 * 16)
    assert abs(shown.mean() - 1) < 6 * spread
    assert abs(shown[200:].mean() - shown[:200].mean()) < 10 * spread


def test_bright_pixels_stay_as_they_are_and_colours_keep_their_chromaticity() -> None:
    rng = np.random.default_rng(3)
    frame = (10.0 ** rng.uniform(-6, 9, (1, 1, 60, 60)) * rng.random((1, 3, 60, 60))).astype(np.float32)
    shown = noisy(frame)
    y = np.tensordot(np.array(LUMINANCE_WEIGHTS), frame.astype(np.float64), (0, 1))[:, None]
    bright = np.broadcast_to(y > 0.0101, frame.shape)
    np.testing.assert_array_equal(shown[bright], frame[bright].astype(np.float64))
    ratio = shown / frame
    np.testing.assert_allclose(ratio, np.broadcast_to(ratio[:, 1:2], ratio.shape), rtol=1e-5)


def test_black_is_black_unless_the_retinas_own_light_is_seen() -> None:
    assert not noisy(grey(0.0)).any()
    own = np.stack([noisy(grey(0.0), 0.25 * k, RodNoise(own_light=True)) for k in range(8)])
    expected = 630 * 0.1 / 160 / (630 * 0.1 * 8.6 * math.pi / 4 * PUPIL_MM**2 * WHITE_RATIO)
    assert own.mean() == pytest.approx(expected, rel=0.05)
    assert own.min() >= 0


@pytest.mark.parametrize("ppd", [0.5, 9.8, 60.0])
@pytest.mark.parametrize("shape", [(1, 1), (3, 50), (17, 5)])
def test_any_size_and_any_light_give_finite_pixels(ppd: float, shape: tuple[int, int]) -> None:
    frame = np.zeros((2, 3, *shape), np.float32)
    frame[:, 0], frame[:, 1, ::2], frame[:, 2, :, ::2] = -1e-5, 1e9, 1e-40
    for elapsed_s in (-3.0, 0.0, 1e12):
        assert np.isfinite(noisy(frame, elapsed_s, RodNoise(own_light=True), ppd)).all()


def test_a_time_that_is_none_is_refused() -> None:
    with pytest.raises(FrameError, match="rod noise"):
        noisy(grey(1e-4, 8), math.nan)


SIDE, TILE_PX = 8, 4
NOISES = st.builds(
    RodNoise,
    seed=st.integers(0, 2**32 - 1),
    grain_deg=st.sampled_from([0.25, 0.3, 2.0]),
    below_cd_m2=st.sampled_from([1e-3, 0.01, 1.0]),
    own_light=st.booleans(),
)


def tiles(rgb: np.ndarray) -> np.ndarray:
    rgb = np.asarray(rgb, dtype=np.float64)[0]
    four = np.concatenate([rgb, np.tensordot(np.array(LUMINANCE_WEIGHTS), rgb, (0, 0))[None]])
    return four.reshape(4, SIDE // TILE_PX, TILE_PX, SIDE // TILE_PX, TILE_PX)


def range_of(rgb: np.ndarray) -> Range:
    return Range(tiles(rgb).min((2, 4)), tiles(rgb).max((2, 4)), TILE_PX)


def change_of(rgb: np.ndarray, other: np.ndarray) -> Change:
    return np.abs(tiles(rgb) - tiles(other)).max((2, 4))


def random_frame(seed: int, spread: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    level = 10.0 ** rng.uniform(-7, 0)
    return (level * rng.random((1, 3, 1, 1)) * 10.0 ** (spread * rng.uniform(-1, 1, (1, 3, SIDE, SIDE)))).astype(
        np.float32
    )


@given(st.integers(0, 2**31), st.sampled_from([0.0, 0.1, 1.5]), NOISES, st.floats(2, 8), st.floats(0, 1e5))
def test_no_pixel_changes_by_more_than_stated(
    seed: int, spread: float, noise: RodNoise, pupil_diameter_mm: float, elapsed_s: float
) -> None:
    frame = random_frame(seed, spread)
    shown = np.asarray(add_noise(jnp.asarray(frame), elapsed_s, [pupil_diameter_mm], 10.0, noise))
    bound = skip_bound(range_of(frame), pupil_diameter_mm, noise)
    assert (change_of(frame, shown) <= bound * (1 + 1e-5) + 1e-6 * frame.max()).all()


@given(
    st.integers(0, 2**31),
    st.sampled_from([0.0, 0.1, 1.5]),
    st.sampled_from([1e-3, 0.1, 2.0]),
    NOISES,
    st.floats(2, 8),
    st.floats(0, 1e5),
)
def test_no_change_grows_by_more_than_stated(
    seed: int, spread: float, size: float, noise: RodNoise, pupil_diameter_mm: float, elapsed_s: float
) -> None:
    frame = random_frame(seed, spread)
    rng = np.random.default_rng(seed + 1)
    other = (frame * np.clip(1 + size * rng.uniform(-1, 1, frame.shape), 0, None)).astype(np.float32)
    shown, other_shown = (
        np.asarray(add_noise(jnp.asarray(values), elapsed_s, [pupil_diameter_mm], 10.0, noise))
        for values in (frame, other)
    )
    bound = propagate(change_of(frame, other), range_of(frame), pupil_diameter_mm, noise)
    slack = 1e-5 * max(shown.max(), other_shown.max(), frame.max())
    assert (change_of(shown, other_shown) <= bound * (1 + 1e-5) + slack).all()


def test_bright_tiles_are_certain_to_stay() -> None:
    assert not skip_bound(range_of(np.full((1, 3, SIDE, SIDE), 0.02, np.float32)), PUPIL_MM, NOISE).any()
    dark = skip_bound(range_of(np.full((1, 3, SIDE, SIDE), 1e-4, np.float32)), PUPIL_MM, NOISE)
    # Seven standard deviations.
    assert 1e-4 * 0.43 < dark.max() < 1e-4 * 10


def test_the_bound_is_reached_by_the_largest_noise() -> None:
    for luminance_cd_m2 in (1e-6, 1e-4, 2e-3):
        count = events(luminance_cd_m2)
        largest = (LARGEST / 2 + math.sqrt(count - 0.25)) ** 2 / count - 1
        reached = luminance_cd_m2 * (1 - luminance_cd_m2 / 0.01) * largest
        bound = skip_bound(range_of(np.full((1, 3, SIDE, SIDE), luminance_cd_m2, np.float32)), PUPIL_MM, NOISE)
        assert reached <= bound.max() * (1 + 1e-5) < 1.3 * reached
    for seed in range(20):
        shown = noisy(grey(1e-4, 200), 0.05, RodNoise(seed=seed)) / 1e-4
        root = np.sqrt((shown - 1) / (1 - 0.01) * events(1e-4) + events(1e-4))
        assert (2 * (root - math.sqrt(events(1e-4) - 0.25))).max() < LARGEST


def test_every_grain_counts_a_quarter_event_of_heat_or_more() -> None:
    # Below it, the square root of a count would have no real value.
    assert RODS_PER_DEG2 * 0.25**2 * INTEGRATION_S * THERMAL_PER_S > 0.25
    assert np.isfinite(noisy(grey(0.0, 8), 0.0, RodNoise(grain_deg=0.25, own_light=True))).all()
