"""Lines that are radial, alike for a seed, and leave every neighbourhood its light."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter, map_coordinates

from entoptic.pipeline.optics import analytic, flare_lines, radial
from entoptic.pipeline.optics.flare_lines import NEIGHBOURHOOD_PX, SPACING_PX, Flare

RADIUS_PX = 100


@pytest.mark.parametrize("flare", Flare)
@pytest.mark.parametrize("seed", [0, 7])
def test_every_neighbourhood_keeps_the_mean_of_one(flare: Flare, seed: int) -> None:
    margin = round(4 * NEIGHBOURHOOD_PX)
    around = flare_lines.flare_lines(seed, flare, RADIUS_PX + margin, RADIUS_PX + margin)
    means = gaussian_filter(around, NEIGHBOURHOOD_PX)[margin:-margin, margin:-margin]
    assert means.min() > 0.85
    assert means.max() < 1.15
    assert np.sqrt(np.mean((means - 1) ** 2)) < 0.03
    assert around.min() >= 0
    assert around.std() > 1  # lines, not a level field


@given(
    seed=st.integers(0, 2**40), flare=st.sampled_from(Flare), rows_px=st.integers(0, 20), columns_px=st.integers(0, 20)
)
@settings(max_examples=5)
def test_the_same_seed_draws_the_same_lines_on_a_kernel_of_any_size(
    seed: int, flare: Flare, rows_px: int, columns_px: int
) -> None:
    lines = flare_lines.flare_lines(seed, flare, rows_px, columns_px)
    assert lines.shape == (2 * rows_px + 1, 2 * columns_px + 1)
    assert lines[rows_px, columns_px] == 1
    larger = flare_lines.flare_lines(seed, flare, 20, 25)
    middle = larger[20 - rows_px : 21 + rows_px, 25 - columns_px : 26 + columns_px]
    np.testing.assert_allclose(lines, middle, rtol=1e-9, atol=1e-12)


def test_seeds_and_sets_differ() -> None:
    pictures = [flare_lines.flare_lines(seed, flare, 40, 40).ravel() for seed, flare in ((0, 101), (1, 101), (0, 102))]
    correlations = np.corrcoef(pictures)[np.triu_indices(3, 1)]
    assert np.abs(correlations).max() < 0.3


def test_lines_are_radial_and_of_constant_width() -> None:
    """Along the radius the picture hardly changes; across it, it has changed after two pixels at any distance."""
    lines = flare_lines.flare_lines(3, Flare.CORONA, RADIUS_PX, RADIUS_PX)
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)

    def ring(radius_px: float, turn: float = 0.0) -> np.ndarray:
        y, x = radius_px * np.sin(angle + turn) + RADIUS_PX, radius_px * np.cos(angle + turn) + RADIUS_PX
        return map_coordinates(lines, [y, x], order=1)

    for radius_px in (25.0, 50.0, 90.0):
        here = ring(radius_px)
        along = np.corrcoef(here, ring(radius_px + 4))[0, 1]
        across = np.corrcoef(here, ring(radius_px, 2.5 / radius_px))[0, 1]
        assert along > 0.8
        assert abs(across) < 0.35
        peaks = np.count_nonzero((here > np.roll(here, 1)) & (here >= np.roll(here, -1)) & (here > 1))
        assert 0.3 < peaks / (2 * np.pi * radius_px / SPACING_PX) < 1.5


def test_a_lines_intensity_does_not_depend_on_its_slope() -> None:
    """A line of one pixel has one pixel's light for each pixel of its length, in whichever direction."""
    for degrees in (0.0, 10.0, 30.0, 40.0):
        picture = np.zeros((61, 61))
        along, across = (np.array([f(np.radians(degrees))]) for f in (np.cos, np.sin))
        flare_lines._draw(picture, along, across, np.array([0.0]), np.array([1.0]))
        length_px = 20 / along[0]
        assert picture[:, 40:60].sum() == pytest.approx(length_px, rel=0.03)


@pytest.mark.parametrize("name", ["f1", "f2", "f3"])
def test_lines_leave_the_sum_unchanged(name: str) -> None:
    kernel = radial.pixel_integrated(getattr(analytic, name), 14.0, 60, 60)
    lines = flare_lines.flare_lines(5, Flare.CORONA, 60, 60)
    both = flare_lines.with_flare_lines(np.stack([kernel, 2 * kernel]), lines)
    assert both.sum(axis=(1, 2)) == pytest.approx(kernel.sum() * np.array([1, 2]), rel=1e-12)
    # Nearly so even without the last scaling.
    assert (kernel * lines).sum() == pytest.approx(kernel.sum(), rel=0.03)
