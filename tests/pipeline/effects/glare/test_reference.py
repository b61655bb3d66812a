"""The reference against sums written out in full, and that its shortcuts change nothing."""

import time

import numpy as np
import pytest

from entoptic.pipeline.effects.glare.kernel import Veil, component
from entoptic.pipeline.frame import View
from entoptic.pipeline.optics import analytic, radial
from entoptic.pipeline.oracles import glare as reference

CIE = Veil(analytic.cie135, (60.0, 1.0))
SHARE = radial.hemisphere_volume(CIE.density)


def coloured_kernel(side: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).random((3, 3, side, side)) * 0.9 / (3 * side * side)


def in_full(light: np.ndarray, view: View, kernel: np.ndarray, share: float) -> np.ndarray:
    """Pixel by pixel: what it does to each other."""
    _, height, width = light.shape
    middle = kernel.shape[-1] // 2
    v = (np.arange(height) + 0.5 - height / 2) / view.focal_px
    u = (np.arange(width) + 0.5 - width / 2) / view.focal_px
    towards = np.stack(np.broadcast_arrays(u[None, :], v[:, None], np.ones((height, width))), axis=-1)
    towards = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
    at_centre = np.eye(3) * (1 - share) - kernel.sum(axis=(2, 3))
    result = np.zeros_like(light)
    solid_angles = reference.pixel_solid_angles(view)
    for y, x in np.ndindex(height, width):
        result[:, y, x] += at_centre @ light[:, y, x]
        deg = np.degrees(np.arccos(np.clip(towards @ towards[y, x], -1, 1)))
        per_sr = np.where(deg <= 90, CIE.density(np.maximum(deg, 1e-3)), 0) * share / SHARE
        result += light[:, y, x, None, None] * per_sr * solid_angles[y, x]
        for to_y, to_x in np.ndindex(height, width):
            k, j = to_y - y + middle, to_x - x + middle
            if 0 <= k < 2 * middle + 1 and 0 <= j < 2 * middle + 1:
                result[:, to_y, to_x] += kernel[:, :, k, j] @ light[:, y, x]
    return result


@pytest.mark.parametrize("brightest", [0, 3, 1000])
def test_it_is_the_sum_over_all_pixels(brightest: int) -> None:
    view = View(9, 12, 80.0)
    light = np.random.default_rng(0).lognormal(0, 2, (3, 12, 9))
    kernel = coloured_kernel(7, 1)
    got = reference.reference_glare(light, view, kernel, [(CIE, 0.08)], brightest)
    np.testing.assert_allclose(got, in_full(light, view, kernel, 0.08), rtol=2e-5)


def test_a_kernel_may_be_larger_than_the_frame() -> None:
    view = View(3, 2, 10.0)
    light = np.random.default_rng(2).random((3, 2, 3))
    got = reference.reference_glare(light, view, coloured_kernel(31, 3), [])
    np.testing.assert_allclose(got, in_full(light, view, coloured_kernel(31, 3), 0.0), rtol=1e-12)


def test_a_kernel_for_all_channels_is_the_same_for_each() -> None:
    view, light = View(20, 16, 10.0), np.random.default_rng(4).random((3, 16, 20))
    grey = np.random.default_rng(5).random((5, 5)) / 30
    coloured = np.eye(3)[:, :, None, None] * grey
    got = [reference.reference_glare(light, view, kernel, [(CIE, 0.05)]) for kernel in (grey, coloured)]
    np.testing.assert_allclose(got[0], got[1], rtol=1e-12)


def test_how_many_pixels_are_summed_one_by_one_makes_little_difference() -> None:
    """In boxes of 2 × 2 pixels of 1.1°: each box stands where its light is, and the veil is read off by a spline."""
    view = View(130, 120, 104.0)
    random = np.random.default_rng(6)
    light = np.full((3, 120, 130), 0.1)
    light[:, random.integers(120, size=40), random.integers(130, size=40)] = random.lognormal(5, 2, 40)
    exact, some = (
        reference.reference_change(light, view, np.zeros((1, 1)), [(CIE, SHARE)], brightest) for brightest in (60, 20)
    )
    np.testing.assert_allclose(some + SHARE * light, exact + SHARE * light, rtol=1e-2)


def test_an_even_field_has_the_veil_of_the_sphere() -> None:
    """A veil that ends at 40° is all there in the middle of a view of 104°."""
    short = Veil(lambda deg: np.clip(1 - (deg / 40) ** 2, 0, 1) ** 2)
    view = View(140, 140, 104.0)
    change = reference.reference_change(np.ones((3, 140, 140)), view, np.zeros((1, 1)), [(short, 0.1)], 0)
    assert change[1, 70, 70] == pytest.approx(0, abs=0.1 * 2e-3)


def test_light_is_neither_made_nor_lost() -> None:
    view, light = View(64, 64, 20.0), np.zeros((3, 64, 64))
    light[:, 30, 33] = 1000.0
    got = reference.reference_glare(light, view, coloured_kernel(15, 7), [])
    np.testing.assert_allclose(got.sum(axis=(1, 2)), light.sum(axis=(1, 2)), rtol=1e-12)


def test_a_black_frame_stays_black() -> None:
    view = View(40, 30, 60.0)
    assert not reference.reference_glare(np.zeros((3, 30, 40)), view, coloured_kernel(9, 8), [(CIE, 0.1)]).any()


def test_a_prepared_mixture_is_its_sum() -> None:
    grey = component(np.random.default_rng(9).random((5, 5)) / 40, CIE, 0.1)
    coloured = component(coloured_kernel(5, 10), None, 0.0)
    kernel, veils = reference.of_mixture(((grey, 0.25), (coloured, 0.75)))
    assert veils == [(CIE, pytest.approx(0.025))]
    np.testing.assert_allclose(kernel.sum(axis=(2, 3)), np.eye(3) * (1 - 0.025), atol=1e-6)


def test_the_suns_disc_takes_seconds() -> None:
    view = View(512, 512, 36.5)
    light = np.full((3, 512, 512), 1e-3)
    light[:, 8:16, 8:16] = 1.6e9
    start = time.process_time()
    got = reference.reference_glare(light, view, np.full((245, 245), 1e-6), [(CIE, SHARE)], brightest=64)
    # Twenty on a machine of its own; processor time, and all the slack that a shared one needs.
    assert time.process_time() - start < 120
    assert got.min() > 0
