"""Pixels' light against dense sampling and against the exact light within a square."""

import functools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from entoptic.pipeline.optics import analytic, radial

CIE = functools.partial(analytic.cie135, age_years=30.0, pigmentation=0.5)
DENSITIES = {
    "core": analytic.f0,
    "narrow": analytic.f1,
    "wide": analytic.f2,
    "halo": analytic.f3,
    "cie": CIE,
    "ijspeert": functools.partial(analytic.ijspeert, pupil_diameter_mm=3.0, age_years=30.0, straylight=0.142),
}


def flat_encircled(density: radial.Density, deg: np.ndarray) -> np.ndarray:
    """Light within angles from the axis, over a flat plane, where a ring has the radius deg and not sin(deg)."""

    def flattened(at: np.ndarray) -> np.ndarray:
        sine = np.degrees(np.sin(np.radians(at)))
        return np.asarray(density(at) * np.divide(at, sine, out=np.ones_like(at), where=sine > 0))

    return radial.encircled(flattened, deg)


def within_square(density: radial.Density, half_side_deg: float) -> float:
    """Light within a square on a flat plane: eight times the rays of one eighth, each to the square's side."""
    x, weights = np.polynomial.legendre.leggauss(400)
    reach = half_side_deg / np.cos((x + 1) * math.pi / 8)
    return float(flat_encircled(density, reach) @ weights) / 2


def sampled(density: radial.Density, ppd: float, radius_px: int, points: int) -> np.ndarray:
    """Each pixel's light as the mean of points² midpoints."""
    side = 2 * radius_px + 1
    fine = ((np.arange(side * points) + 0.5) / points - radius_px - 0.5) / ppd
    light = density(np.hypot(fine[:, None], fine[None, :])).reshape(side, points, side, points).mean(axis=(1, 3))
    return light * math.radians(1 / ppd) ** 2


@pytest.mark.parametrize("name", DENSITIES)
@pytest.mark.parametrize(("ppd", "radius_px"), [(0.3, 2), (14.0, 3), (120.0, 3)])
def test_a_pixels_light_is_that_of_dense_samples(name: str, ppd: float, radius_px: int) -> None:
    density = DENSITIES[name]
    kernel = radial.pixel_integrated(density, ppd, radius_px, radius_px)
    expected = sampled(density, ppd, radius_px, 121)
    away = np.ones_like(kernel, bool)
    away[radius_px, radius_px] = False
    assert kernel[away] == pytest.approx(expected[away], rel=1e-3, abs=2e-6)
    # Samples 0.028° apart do not resolve a core of 0.0046°: the middle pixel of a coarse grid is checked by the sums.
    if ppd >= 14:
        assert kernel[radius_px, radius_px] == pytest.approx(expected[radius_px, radius_px], abs=1e-4)


def test_the_pixels_of_a_distant_halo() -> None:
    kernel = radial.pixel_integrated(analytic.f3, 5.0, 20, 20)
    np.testing.assert_allclose(kernel, sampled(analytic.f3, 5.0, 20, 41), atol=1e-6)


@pytest.mark.parametrize("name", DENSITIES)
@given(ppd=st.floats(0.3, 120), radius_px=st.integers(0, 12))
@settings(max_examples=8)
def test_the_pixels_add_up_to_the_light_in_their_square(name: str, ppd: float, radius_px: int) -> None:
    density = DENSITIES[name]
    half_side = (radius_px + 0.5) / ppd
    if half_side * math.sqrt(2) > radial.EDGE_DEG:  # the hemisphere's edge crosses pixels: a step, not a ring
        half_side, radius_px = radial.EDGE_DEG / 2, 0
        ppd = 0.5 / half_side
    kernel = radial.pixel_integrated(density, ppd, radius_px, radius_px)
    assert kernel.sum() == pytest.approx(within_square(density, half_side), abs=1e-6)


@given(ppd=st.floats(0.3, 120), width_deg=st.floats(1e-4, 1.0))
def test_a_core_of_any_width_is_whole(ppd: float, width_deg: float) -> None:
    """The light of 1/(1+(r/a)²)^1.5 in the middle pixel has a closed form: (2/π)·atan(h²/(a·√(a² + 2h²)))."""

    def density(deg: np.ndarray) -> np.ndarray:
        return 1 / (2 * math.pi * radial.SR_PER_DEG2 * width_deg**2) / (1 + (deg / width_deg) ** 2) ** 1.5

    half = 0.5 / ppd
    expected = 2 / math.pi * math.atan(half**2 / (width_deg * math.sqrt(width_deg**2 + 2 * half**2)))
    # A millionth of this density lies beyond 90° for each 1e-4 degree of width: it is cut off.
    middle = radial.pixel_integrated(density, ppd, 2, 2)[2, 2]
    assert middle == pytest.approx(expected, abs=1e-7 + 1e-7 * width_deg)


@pytest.mark.parametrize("name", DENSITIES)
def test_a_kernel_is_symmetric_and_a_smaller_one_is_its_middle(name: str) -> None:
    density = DENSITIES[name]
    kernel = radial.pixel_integrated(density, 14.0, 20, 30)
    assert kernel.shape == (41, 61)
    assert kernel.min() >= 0
    for mirrored in (kernel[::-1], kernel[:, ::-1]):
        np.testing.assert_array_equal(kernel, mirrored)
    smaller = radial.pixel_integrated(density, 14.0, 20, 20)
    assert smaller == pytest.approx(kernel[:, 10:-10], rel=1e-9, abs=1e-13)
    assert smaller == pytest.approx(smaller.T, rel=1e-9, abs=1e-13)


def test_far_pixels_hold_their_density() -> None:
    """Though each is the difference of fluxes that are thousands of times larger."""
    kernel = radial.pixel_integrated(CIE, 30.0, 135, 135)
    y, x = np.mgrid[-135:136, -135:136] / 30.0
    far = np.hypot(y, x) > 1.5
    density = CIE(np.hypot(y, x)[far]) * math.radians(1 / 30.0) ** 2
    np.testing.assert_allclose(kernel[far], density, rtol=3e-4)


def test_light_on_the_hemisphere_in_closed_form() -> None:
    """A level density and one that falls as the cosine."""

    def level(deg: np.ndarray) -> np.ndarray:
        return np.full_like(deg, 1 / (2 * math.pi))

    deg = np.array([0.0, 0.5, 9.0, 45.0, 90.0])
    assert radial.encircled(level, deg) == pytest.approx(1 - np.cos(np.radians(deg)), abs=1e-12)
    assert radial.hemisphere_volume(lambda deg: np.cos(np.radians(deg)) / math.pi) == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize(("name", "more"), [("wide", 2.9e-4), ("cie", 3.1e-5), ("ijspeert", 2.7e-5)])
def test_a_flat_kernel_of_nine_degrees_holds_little_more_than_the_cap_of_a_sphere(name: str, more: float) -> None:
    density = DENSITIES[name]
    difference = float(flat_encircled(density, np.array(9.0)) - radial.encircled(density, 9.0))
    assert 0 < difference < more


def test_the_transform_of_a_gaussian_is_a_gaussian() -> None:
    cpd = np.array([0.0, 0.3, 3.0, 30.0])
    expected = 2.61e6 * math.pi * 0.02**2 * radial.SR_PER_DEG2 * np.exp(-((math.pi * 0.02 * cpd) ** 2))
    assert radial.hankel(analytic.f0, cpd) == pytest.approx(expected, abs=1e-7)
