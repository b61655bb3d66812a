"""What night colour says it may change at most, against what it changes in random frames."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.effects.night_colour import NightColour, NightMethod, shift
from entoptic.pipeline.effects.night_colour.bounds import propagate, skip_bound
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, FrameError
from entoptic.pipeline.ranges import Change, Range

TILE_PX = 4
SIDE = 8

NIGHTS = st.one_of(
    st.builds(NightColour, st.sampled_from(NightMethod)),
    st.builds(NightColour, st.sampled_from(NightMethod), mesopic=st.just(True)),
    st.builds(NightColour, st.sampled_from(NightMethod), per_pixel=st.just(True)),
)
ADAPTED = st.floats(-6, 2).map(lambda log: 10**log)


def four(rgb: np.ndarray) -> np.ndarray:
    """R, G, B and Y of a frame of one eye, in float64."""
    rgb = np.asarray(rgb, dtype=np.float64)[0]
    return np.concatenate([rgb, np.tensordot(np.array(LUMINANCE_WEIGHTS), rgb, (0, 0))[None]])


def tiles(values: np.ndarray) -> np.ndarray:
    return values.reshape(4, SIDE // TILE_PX, TILE_PX, SIDE // TILE_PX, TILE_PX)


def range_of(rgb: np.ndarray) -> Range:
    values = tiles(four(rgb))
    return Range(values.min((2, 4)), values.max((2, 4)), TILE_PX)


def change_of(rgb: np.ndarray, other: np.ndarray) -> Change:
    return tiles(np.abs(four(rgb) - four(other))).max((2, 4))


def frame(seed: int, spread: float, top: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    grey = rng.random((1, 1, SIDE, SIDE)) ** 3
    colour = rng.random((1, 3, 1, 1))
    return (top * np.clip((1 - spread) * grey * colour + spread * rng.random((1, 3, SIDE, SIDE)), 0, 1)).astype(
        np.float32
    )


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.05, 1.0]), NIGHTS, ADAPTED)
def test_no_pixel_changes_by_more_than_stated(seed: int, spread: float, night: NightColour, adapted: float) -> None:
    displayed, scene = frame(seed, spread, 1.0), frame(seed + 1, spread, adapted * 10)
    shown = np.asarray(shift(jnp.asarray(displayed), [adapted], night, jnp.asarray(scene)))
    bound = skip_bound(range_of(displayed), adapted, night, range_of(scene))
    assert (change_of(displayed, shown) <= bound * (1 + 1e-5) + 1e-6).all()


@given(
    st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.05, 1.0]), st.sampled_from([1e-4, 0.02, 0.5]), NIGHTS, ADAPTED
)
def test_no_change_grows_by_more_than_stated(
    seed: int, spread: float, size: float, night: NightColour, adapted: float
) -> None:
    displayed, scene = frame(seed, spread, 1.0), frame(seed + 1, spread, adapted * 10)
    other = np.clip(displayed + size * (frame(seed + 2, 1.0, 2.0) - 1), 0, None).astype(np.float32)
    other_scene = np.clip(scene + adapted * size * (frame(seed + 3, 1.0, 2.0) - 1), 0, None).astype(np.float32)
    shown = np.asarray(shift(jnp.asarray(displayed), [adapted], night, jnp.asarray(scene)))
    other_shown = np.asarray(shift(jnp.asarray(other), [adapted], night, jnp.asarray(other_scene)))
    bound = propagate(
        change_of(displayed, other), range_of(displayed), adapted, night, range_of(scene), change_of(scene, other_scene)
    )
    assert (change_of(shown, other_shown) <= bound * (1 + 1e-5) + 1e-6).all()


@pytest.mark.parametrize("method", NightMethod)
def test_the_bound_of_one_colour_is_its_change(method: NightMethod) -> None:
    displayed = np.broadcast_to(np.array([0.2, 0.1, 0.6], np.float32)[:, None, None], (1, 3, SIDE, SIDE))
    shown = np.asarray(shift(jnp.asarray(displayed), [0.05], NightColour(method)))
    bound = skip_bound(range_of(displayed), 0.05, NightColour(method))
    np.testing.assert_allclose(change_of(displayed, shown), bound, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("method", NightMethod)
def test_black_tiles_and_mesopic_daylight_change_nothing(method: NightMethod) -> None:
    black = np.zeros((1, 3, SIDE, SIDE), np.float32)
    assert not skip_bound(range_of(black), 1e-3, NightColour(method)).any()
    assert not skip_bound(range_of(frame(0, 1.0, 1.0)), 6.0, NightColour(method, mesopic=True)).any()


def test_without_a_change_nothing_is_passed_on() -> None:
    displayed = range_of(frame(0, 1.0, 1.0))
    for method in NightMethod:
        assert not propagate(np.zeros_like(displayed.low), displayed, 0.01, NightColour(method)).any()


def test_per_pixel_asks_for_the_scene() -> None:
    displayed = range_of(frame(0, 1.0, 1.0))
    night = NightColour(per_pixel=True)
    with pytest.raises(FrameError, match="in cd/m²"):
        skip_bound(displayed, 0.01, night)
    with pytest.raises(FrameError, match="in cd/m²"):
        propagate(np.zeros_like(displayed.low), displayed, 0.01, night)
