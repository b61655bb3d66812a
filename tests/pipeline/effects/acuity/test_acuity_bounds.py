"""Bounds hold whatever the frame, and are near to nothing where nothing happens."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.effects.acuity import (
    LIMIT_CD_M2,
    Acuity,
    AcuityMethod,
    dark_tiles,
    propagate,
    reduce_acuity,
    skip_bound,
)
from entoptic.pipeline.effects.acuity import bounds as acuity_bounds
from entoptic.pipeline.ranges import Range

HEIGHT, WIDTH = 24, 31
TILE_PX = 5
PPD = 9.82
Y = np.array([0.2126, 0.7152, 0.0722])
ACUITIES = [
    Acuity(),
    Acuity(reference=True),
    Acuity(AcuityMethod.KRAWCZYK),
    Acuity(AcuityMethod.KRAWCZYK, display_limit=False),
]

frames = st.builds(
    lambda seed, middle, spread, lamps, fine: random_frame(seed, middle, spread, lamps, fine),
    st.integers(0, 2**31),
    st.floats(-5, 0.5),
    st.floats(0, 1.5),
    st.sampled_from([0.0, 0.01, 0.1]),
    st.booleans(),
)


def random_frame(seed: int, log10_middle: float, spread: float, lamps: float, fine: bool) -> np.ndarray:
    rng = np.random.default_rng(seed)
    shape = (HEIGHT, WIDTH) if fine else (4, 5)
    log = np.kron(log10_middle + spread * rng.normal(size=shape), np.ones((1, 1) if fine else (6, 7)))[:HEIGHT, :WIDTH]
    y = np.where(rng.random((HEIGHT, WIDTH)) < lamps, 10 ** rng.uniform(0, 6), 10**log)
    return (y * rng.dirichlet((1, 1, 1), (HEIGHT, WIDTH)).transpose(2, 0, 1)).astype(np.float32)[None]


def channels(rgb: np.ndarray) -> np.ndarray:
    """(4, y, x): red, green, blue, luminance."""
    values = rgb[0].astype(np.float64)
    return np.concatenate([values, np.tensordot(Y, values, 1)[None]])


def over_tiles(values: np.ndarray, least: bool) -> np.ndarray:
    fill = np.inf if least else -np.inf
    padded = np.pad(values, ((0, 0), (0, -HEIGHT % TILE_PX), (0, -WIDTH % TILE_PX)), constant_values=fill)
    tiles = padded.reshape(4, padded.shape[1] // TILE_PX, TILE_PX, -1, TILE_PX)
    return tiles.min((2, 4)) if least else tiles.max((2, 4))


def range_of(rgb: np.ndarray) -> Range:
    return Range(over_tiles(channels(rgb), True), over_tiles(channels(rgb), False), TILE_PX)


def within(actual: np.ndarray, bound: np.ndarray, range_: Range) -> None:
    # What float32 rounds away of the values themselves.
    rounding = 3e-6 * range_.around(40).high + 1e-9
    worst = (actual - bound * (1 + 1e-5) - rounding).max()
    assert worst <= 0, f"{worst} over the bound"


@pytest.mark.parametrize("acuity", ACUITIES)
@given(rgb=frames)
def test_a_skip_changes_no_more_than_its_bound(acuity: Acuity, rgb: np.ndarray) -> None:
    after = np.asarray(reduce_acuity(jnp.asarray(rgb), PPD, acuity))
    change = over_tiles(np.abs(channels(after) - channels(rgb)), False)
    within(change, skip_bound(range_of(rgb), PPD, acuity), range_of(rgb))


@pytest.mark.parametrize("acuity", ACUITIES)
@given(rgb=frames, seed=st.integers(0, 999), log10_share=st.floats(-4, 0))
def test_a_change_before_becomes_no_more_than_its_bound(
    acuity: Acuity, rgb: np.ndarray, seed: int, log10_share: float
) -> None:
    rng = np.random.default_rng(seed)
    other = (rgb * (1 + 10**log10_share * rng.uniform(-1, 1, rgb.shape))).astype(np.float32)
    change = over_tiles(np.abs(channels(other) - channels(rgb)), False)
    after = [channels(np.asarray(reduce_acuity(jnp.asarray(frame), PPD, acuity))) for frame in (rgb, other)]
    became = over_tiles(np.abs(after[1] - after[0]), False)
    within(became, propagate(change, range_of(rgb), PPD, acuity), range_of(rgb))


@pytest.mark.parametrize("acuity", ACUITIES)
def test_bright_tiles_cost_nothing_and_pass_changes_on_as_they_are(acuity: Acuity) -> None:
    rgb = np.random.default_rng(1).uniform(5, 500, (1, 3, HEIGHT, WIDTH)).astype(np.float32)
    range_ = range_of(rgb)
    assert (skip_bound(range_, PPD, acuity) == 0).all()
    assert not dark_tiles(range_, PPD, acuity).any()
    change = np.random.default_rng(2).uniform(0, 0.1, range_.low.shape)
    assert (propagate(change, range_, PPD, acuity) == change).all()


@pytest.mark.parametrize("acuity", ACUITIES)
@pytest.mark.parametrize("value", [0.0, 1e-4, 0.05])
def test_even_tiles_change_by_nothing(acuity: Acuity, value: float) -> None:
    range_ = range_of(np.full((1, 3, HEIGHT, WIDTH), value, np.float32))
    assert skip_bound(range_, PPD, acuity).max() <= 1e-12


def test_a_dim_tile_is_bounded_by_its_contrast_alone() -> None:
    # 0.02 to 0.03 cd/m² everywhere: no blur takes more than the difference, and most of it is kept from it.
    y = np.random.default_rng(3).uniform(0.02, 0.03, (HEIGHT, WIDTH))
    range_ = range_of(np.broadcast_to(y, (1, 3, *y.shape)))
    assert 0.005 < skip_bound(range_, PPD, Acuity()).max() < 0.01
    change = np.full_like(range_.low, 1e-4)
    assert 1e-4 < propagate(change, range_, PPD, Acuity()).max() < 4e-4


def test_only_tiles_with_dark_pixels_are_dark() -> None:
    y = np.full((HEIGHT, WIDTH), 1.0)
    y[7, 22] = LIMIT_CD_M2 * 0.99
    marked = dark_tiles(range_of(np.broadcast_to(y, (1, 3, *y.shape))), PPD, Acuity())
    assert np.argwhere(marked).tolist() == [[1, 4]]


@pytest.mark.parametrize(("dimensions", "passes"), [(1, 2), (2, 1)])
def test_weights_change_no_faster_than_stated(dimensions: int, passes: int) -> None:
    steps = np.arange(-3, 4) if dimensions == 1 else np.arange(-4, 5)
    square = steps**2 if dimensions == 1 else (steps[:, None] ** 2 + steps**2).ravel()

    def weights(sigma: float) -> np.ndarray:
        taps = np.exp(-square / (2 * sigma**2))
        return np.asarray(taps / taps.sum())

    fastest = max(np.abs(weights(s + 1e-5) - weights(s - 1e-5)).sum() / 4e-5 for s in np.linspace(0.15, 1, 1000))
    assert fastest <= acuity_bounds.STEEPEST_FIT * (1 if passes == 2 else 2)
