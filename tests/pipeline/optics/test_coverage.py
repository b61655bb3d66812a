"""Covered shares against areas in closed form, and how fast a drawn pupil's diffraction comes to the true one's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import j1

from entoptic.pipeline.optics import coverage

SIZES = st.sampled_from([64, 101, 256])
PLACE = st.floats(-3.5e-3, 3.5e-3)


def dx_of(n: int) -> float:
    return coverage.PLANE_M / n


@given(SIZES, PLACE, PLACE, st.floats(1e-6, 0.9e-3))
def test_a_disc_within_the_grid_covers_its_area(n: int, x: float, y: float, radius: float) -> None:
    discs = (np.array([x]), np.array([y]), np.array([radius]))
    (patches,) = coverage.disc_patches(*discs, n, dx_of(n))
    _, share, _ = coverage.on_grid(patches, n)
    assert share.sum() * dx_of(n) ** 2 == pytest.approx(np.pi * radius**2, rel=1e-12)


@given(SIZES, st.floats(1e-3, 8.5e-3))
def test_the_pupil_is_the_same_disc(n: int, diameter: float) -> None:
    """The fast way for one centred disc against the way for many, in the float32 that a plane is kept in."""
    (patches,) = coverage.disc_patches(np.zeros(1), np.zeros(1), np.array([diameter / 2]), n, dx_of(n))
    index, share, _ = coverage.on_grid(patches, n)
    expected = np.zeros(n * n)
    expected[index] = share
    assert np.abs(coverage.disc(diameter, n, dx_of(n)).ravel() - expected).max() < 1e-7


def test_discs_of_all_sizes_keep_their_areas_whatever_they_are_drawn_with() -> None:
    random = np.random.default_rng(0)
    x, y = random.uniform(-3e-3, 3e-3, (2, 300))
    radius = 1e-6 * 10 ** random.uniform(0, 3, 300)
    drawn = np.zeros(300)
    for patches in coverage.disc_patches(x, y, radius, 256, dx_of(256)):
        drawn[patches.disc] += patches.share.sum(axis=(1, 2))
    assert drawn * dx_of(256) ** 2 == pytest.approx(np.pi * radius**2, rel=1e-12)


def test_a_disc_across_the_grids_side_is_cut_there() -> None:
    """Half a disc, centred on the outer side of the first row's cells."""
    n = 64
    clear = np.ones((n, n))
    coverage.shade_discs(clear, dx_of(n), np.zeros(1), np.array([-(n // 2 + 0.5) * dx_of(n)]), np.array([0.7e-3]))
    assert (1 - clear).sum() * dx_of(n) ** 2 == pytest.approx(np.pi * 0.7e-3**2 / 2, rel=1e-12)


def test_overlapping_discs_multiply_their_transmittances() -> None:
    n, place, radius = 64, np.array([0.1e-3, 0.1e-3]), np.array([0.3e-3, 0.3e-3])
    one, two = np.ones((2, n, n))
    coverage.shade_discs(one, dx_of(n), place[:1], place[:1], radius[:1])
    coverage.shade_discs(two, dx_of(n), place, place, radius)
    assert np.abs(two - one**2).max() < 1e-15


@given(SIZES, st.lists(st.tuples(PLACE, PLACE), min_size=3, max_size=3, unique=True), st.booleans())
def test_a_polygon_of_either_sense_covers_its_area(
    n: int, corners: list[tuple[float, float]], turned_round: bool
) -> None:
    x, y = np.array(corners[::-1] if turned_round else corners).T
    area = abs((x * np.roll(y, -1) - np.roll(x, -1) * y).sum()) / 2
    drawn = coverage.polygons(x[None], y[None], n, dx_of(n)).share.sum() * dx_of(n) ** 2
    assert drawn == pytest.approx(area, rel=1e-12, abs=1e-12 * dx_of(n) ** 2 * n)


def test_a_polygons_cells_are_those_that_a_thousand_points_in_each_tell() -> None:
    n, x, y = 48, np.array([[-2.1e-3, 0.4e-3, 1.9e-3]]), np.array([[-0.3e-3, -1.7e-3, 2.6e-3]])
    region = coverage.polygons(x, y, n, dx_of(n))
    inside = np.zeros((n, n))
    rows, columns = region.share.shape
    inside[region.row : region.row + rows, region.column : region.column + columns] = region.share
    fine = (np.arange(n * 32) + 0.5) / 32 - 0.5 - n // 2
    across, down = np.meshgrid(fine * dx_of(n), fine * dx_of(n))
    left_of = [
        (x[0, i - 2] - x[0, i]) * (down - y[0, i]) > (y[0, i - 2] - y[0, i]) * (across - x[0, i]) for i in range(3)
    ]
    points = np.all(left_of, axis=0) | ~np.any(left_of, axis=0)
    assert np.abs(inside - points.reshape(n, 32, n, 32).mean(axis=(1, 3))).max() < 0.02


def test_a_polygon_partly_off_the_grid_keeps_what_is_on_it() -> None:
    """A square over the grid's upper left corner, half of each of its sides outside."""
    n = 65
    corner = -(n // 2 + 0.5) * dx_of(n)
    x, y = corner + 0.5e-3 * np.array([[-1, 1, 1, -1]]), corner + 0.5e-3 * np.array([[-1, -1, 1, 1]])
    region = coverage.polygons(x, y, n, dx_of(n))
    assert (region.row, region.column) == (0, 0)
    assert region.share.sum() * dx_of(n) ** 2 == pytest.approx(0.5e-3**2, rel=1e-12)
    assert coverage.polygons(x - 2e-3, y, n, dx_of(n)).share.size == 0


@given(SIZES, st.floats(-5e-3, 5e-3), st.sampled_from([-200.0, -40.0, -1.0, 0.0, 7.0, 90.0]))
def test_the_area_below_a_parabola_is_its_integral(n: int, height: float, bend: float) -> None:
    region = coverage.below_parabola(height, bend, n, dx_of(n))
    rows = len(region.share)
    drawn = (region.share.sum() + (n - region.row - rows) * n) * dx_of(n) ** 2
    left, top = -(n // 2 + 0.5) * dx_of(n), (n // 2 + 0.5) * dx_of(n)
    right, bottom = left + n * dx_of(n), top - n * dx_of(n)
    kinks = [root for level in (bottom, top) if bend and (root := (level - height) / bend) > 0]
    kinks = [side * root**0.5 for root in kinks for side in (-1, 1) if left < side * root**0.5 < right]
    whole, _ = quad(
        lambda x: min(max(height + bend * x * x - bottom, 0), top - bottom),
        left,
        right,
        points=kinks or None,
        limit=200,
    )
    assert drawn == pytest.approx(whole, rel=1e-9, abs=1e-9 * coverage.PLANE_M**2)


def exact(diameter: float, n: int) -> np.ndarray:
    return coverage.disc(diameter, n, dx_of(n)).astype(np.float64)


def away_from_centre(n: int) -> np.ndarray:
    x = (np.arange(n) - n // 2) * dx_of(n)
    return np.hypot(x[:, None], x[None, :])


def ramp(diameter: float, n: int) -> np.ndarray:
    """An edge blurred over one sample along its normal, as graphics would draw it."""
    return np.clip((diameter / 2 - away_from_centre(n)) / dx_of(n) + 0.5, 0, 1)


def hard(diameter: float, n: int) -> np.ndarray:
    return (away_from_centre(n) <= diameter / 2).astype(np.float64)


def test_halving_the_step_quarters_the_error_of_a_pupils_diffraction() -> None:
    """Amplitude at 3 cycles over the plane, against Airy's, over 24 pupils. Blurred and hard edges do worse."""
    grids, bins = np.array([64, 128, 256, 512]), 3
    diameters = np.random.default_rng(1).uniform(2e-3, 8e-3, 24)
    errors = {}
    for draw in (exact, ramp, hard):
        off = np.zeros((len(grids), len(diameters)))
        for i, n in enumerate(grids):
            wave = np.cos(2 * np.pi * bins * (np.arange(n) - n // 2) / n)
            for j, diameter in enumerate(diameters):
                v = np.pi * bins * diameter / coverage.PLANE_M
                amplitude = draw(diameter, n).sum(axis=0) @ wave * dx_of(n) ** 2 / (np.pi * diameter**2 / 4)
                off[i, j] = amplitude - 2 * j1(v) / v
        errors[draw.__name__] = np.sqrt((off**2).mean(axis=1))
    orders = {name: -np.polyfit(np.log(grids), np.log(error), 1)[0] for name, error in errors.items()}
    print({name: f"order {orders[name]:.2f}, {errors[name][-1]:.1e} at 512" for name in orders})
    assert orders["exact"] == pytest.approx(2.0, abs=0.1)
    assert orders["ramp"] < 1.8
    assert orders["hard"] < 1.7
    assert np.all(errors["exact"] < errors["ramp"])
    assert np.all(errors["ramp"] < errors["hard"])
