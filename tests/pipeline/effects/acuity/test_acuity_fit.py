"""LUI's fast fit: against the same written plainly, and on dark tiles alone."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from entoptic.pipeline import FrameError
from entoptic.pipeline.effects.acuity import LIMIT_CD_M2, Acuity, dark_acuity, reduce_acuity
from entoptic.pipeline.oracles.acuity import lightness, luminance_of

Y = np.array([0.2126, 0.7152, 0.0722])


def plainly(rgb: np.ndarray) -> np.ndarray:
    """The equations pixel by pixel: LUI 5.16, 7 taps, rows, then columns by the σ of what the rows became."""
    rgb = rgb.astype(np.float64)
    result = rgb.copy()
    for image, into in zip(rgb, result, strict=True):
        y = np.tensordot(Y, image, 1)
        blurred = columns_blurred(columns_blurred(lightness(y).T).T)
        into += np.where(y < LIMIT_CD_M2, luminance_of(blurred) - y, 0)
    return np.maximum(result, 0)


def columns_blurred(values: np.ndarray) -> np.ndarray:
    result = values.copy()
    height, width = values.shape
    for row in range(height):
        for column in range(width):
            sigma = max(1 - values[row, column], 0)
            if sigma < 0.02:
                continue
            taps = [math.exp(-(k * k) / (2 * sigma * sigma)) for k in range(-3, 4)]
            around = [values[min(max(row + k, 0), height - 1), column] for k in range(-3, 4)]
            result[row, column] = np.dot(taps, around) / sum(taps)
    return result


def night(shape: tuple[int, ...], seed: int = 0) -> np.ndarray:
    """Luminances about the limit, some lamps, any colours, some pixels black."""
    rng = np.random.default_rng(seed)
    y = np.where(rng.random((shape[0], 1, *shape[2:])) < 0.02, 50, np.exp(rng.normal(-3.5, 1.5, shape)))
    return (y * rng.random(shape) * (rng.random((shape[0], 1, *shape[2:])) > 0.1)).astype(np.float32)


@pytest.mark.parametrize("shape", [(1, 3, 37, 41), (2, 3, 9, 14), (1, 3, 1, 1), (1, 3, 1, 8), (1, 3, 5, 2)])
def test_it_is_the_papers_formula(shape: tuple[int, ...]) -> None:
    rgb = night(shape)
    assert np.asarray(dark_acuity(jnp.asarray(rgb))) == pytest.approx(plainly(rgb), rel=3e-6, abs=3e-6)


def test_bright_pixels_stay_what_they_are_beside_dark_ones() -> None:
    rgb = night((1, 3, 60, 60), 1)
    bright = np.tensordot(Y, rgb[0], 1) >= LIMIT_CD_M2 * 1.000001
    after = np.asarray(dark_acuity(jnp.asarray(rgb)))
    assert (after[:, :, bright] == rgb[:, :, bright]).all()
    assert (after[:, :, ~bright] != rgb[:, :, ~bright]).mean() > 0.5


@pytest.mark.parametrize("value", [0.0, 1e-30, 1e-6, 0.01, 0.1, 3.0, 1e9])
def test_a_frame_of_one_value_stays_it(value: float) -> None:
    rgb = np.full((1, 3, 20, 21), value, np.float32)
    assert np.asarray(dark_acuity(jnp.asarray(rgb))) == pytest.approx(rgb, rel=1e-6, abs=1e-12)


def test_a_suns_neighbour_is_finite_and_what_is_out_of_reach_untouched() -> None:
    rgb = np.full((1, 3, 21, 21), 1e-6, np.float32)
    rgb[0, :, 10, 10] = 1.6e9
    after = np.asarray(dark_acuity(jnp.asarray(rgb)))
    assert np.isfinite(after).all()
    out_of_reach = np.maximum(*np.abs(np.mgrid[-10:11, -10:11])) > 3
    assert after[0, :, out_of_reach] == pytest.approx(1e-6, rel=1e-5)
    assert after[0, 0, 10, 10] == rgb[0, 0, 10, 10]


def test_colours_outside_the_display_are_kept_where_nothing_changes() -> None:
    rgb = np.full((1, 3, 9, 9), 5.0, np.float32)
    rgb[0, 0] = -0.3
    assert (np.asarray(dark_acuity(jnp.asarray(rgb))) == rgb).all()


@pytest.mark.parametrize("shape", [(1, 3, 260, 310), (2, 3, 230, 219), (1, 3, 40, 300)])
@pytest.mark.parametrize("tile_px", [3, 13, 26])
def test_dark_tiles_alone_give_the_whole_frames_result(shape: tuple[int, ...], tile_px: int) -> None:
    rgb = night(shape, 2) + np.float32(0.2)
    # Dark in two corners and in the middle.
    for rows, columns in ((slice(0, 30), slice(-40, None)), (slice(100, 120), slice(90, 95)), (slice(-9, None), 0)):
        rgb[:, :, rows, columns] = night(shape, 3)[:, :, rows, columns]
    y = np.tensordot(Y, rgb.min(0), 1)
    padded = np.pad(y, [(0, -size % tile_px) for size in y.shape], constant_values=1)
    tiles = padded.reshape(padded.shape[0] // tile_px, tile_px, -1, tile_px).min((1, 3)) < LIMIT_CD_M2 * 1.001
    # A luminance of the darkest channels: a tile may be marked in vain, never left out.
    assert 0 < tiles.mean() < 0.6
    whole = np.asarray(dark_acuity(jnp.asarray(rgb)))
    assert (whole != rgb).any()
    ours = np.asarray(reduce_acuity(jnp.asarray(rgb), 10.0, Acuity(), tiles, tile_px))
    assert np.abs(ours - whole).max() <= 1e-6


def test_no_dark_tile_is_the_frame_itself() -> None:
    rgb = jnp.ones((1, 3, 20, 20))
    assert reduce_acuity(rgb, 10.0, Acuity(), np.zeros((2, 2), bool), 10) is rgb


def test_tiles_of_another_frame_and_no_scale_are_refused() -> None:
    rgb = jnp.ones((1, 3, 20, 30))
    with pytest.raises(FrameError, match=r"\(3, 2\) tiles for a frame of 30×20: of 10 px it has \(2, 3\)"):
        reduce_acuity(rgb, 10.0, Acuity(), np.ones((3, 2), bool), 10)
    for ppd in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(FrameError, match="pixels per degree"):
            reduce_acuity(rgb, ppd)
