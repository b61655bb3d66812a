"""The formulas' volumes, what age, pigment and pupil do to them, and their transforms against numerical ones."""

import functools
import itertools
import math

import numpy as np
import pytest
from clear_pupil import airy
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import special

from entoptic.pipeline.observer import Iris
from entoptic.pipeline.optics import analytic, radial

AGES = (20.0, 40.0, 60.0, 80.0)
CPD = np.array([0.0, 0.01, 0.1, 0.3, 0.49, 0.51, 1.0, 3.0, 10.0, 30.0, 60.0])


@pytest.mark.parametrize("nm", [420.0, 464.0, 568.0, 700.0])
def test_the_halo_has_unit_volume_at_every_wavelength(nm: float) -> None:
    halo = functools.partial(analytic.f3, wavelength_nm=nm)
    assert radial.hemisphere_volume(halo) == pytest.approx(1, abs=1e-3)
    deg = np.linspace(0, 6, 6001)
    assert deg[np.argmax(halo(deg))] == pytest.approx(3 * nm / 568, abs=1e-3)


@given(adapted=st.floats(0, 1e6), age=st.floats(1, 120))
def test_spe_weights_share_out_all_light(adapted: float, age: float) -> None:
    weights = analytic.spe_weights(adapted, age)
    assert weights.sum() == pytest.approx(1, abs=1e-12)
    assert weights.min() >= 0


@pytest.mark.parametrize("pigmentation", sorted(analytic.PIGMENTATION.values()))
def test_cies_printed_volume_and_the_renormalised_one(pigmentation: float) -> None:
    """Printed: 1.00–1.14 up to 70 years, more beyond."""
    for age in AGES:
        assert 1.0 < analytic.cie135_volume(age, pigmentation) < (1.12 if age <= 60 else 1.2)

        def density(deg: np.ndarray, age: float = age) -> np.ndarray:
            return analytic.cie135(deg, age, pigmentation)

        assert radial.hemisphere_volume(density) == pytest.approx(1, abs=1e-6)
        # Another rule: the trapezoid over a grid of its own.
        deg = np.concatenate([[0], np.geomspace(1e-6, 90, 20_001)])
        volume = math.pi**2 / 90 * np.trapezoid(density(deg) * np.sin(np.radians(deg)), deg)
        assert volume == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("pupil_diameter_mm", [2.0, 4.0, 6.0, 8.0])
def test_ijspeerts_volume_is_one(pupil_diameter_mm: float) -> None:
    for age, iris in itertools.product(AGES, Iris):
        density = functools.partial(
            analytic.ijspeert, pupil_diameter_mm=pupil_diameter_mm, age_years=age, straylight=analytic.STRAYLIGHT[iris]
        )
        assert radial.hemisphere_volume(density) == pytest.approx(1.0, abs=1e-4)
        assert density(np.geomspace(1e-4, 90, 50)).min() > 0


@pytest.mark.parametrize("iris", Iris)
def test_straylight_against_stiles_and_holladay(iris: Iris) -> None:
    """10/θ² (sr⁻¹), times 1 + (age/70)⁴: both formulas stay within a factor of 2.4 of it from 1° to 30°."""
    deg = np.geomspace(1, 30, 30)
    for age in AGES:
        rule = 10 / deg**2 * (1 + (age / 70) ** 4)
        cie = analytic.cie135(deg, age, analytic.PIGMENTATION[iris]) / rule
        ijspeert = analytic.ijspeert(deg, 4.0, age, analytic.STRAYLIGHT[iris]) / rule
        for ratio in (cie, ijspeert):
            assert ratio.min() > 1 / 2.4
            assert ratio.max() < 2.4


@given(age=st.floats(5, 75), more=st.floats(1, 40), pupil_diameter_mm=st.floats(2, 8), deg=st.floats(1, 80))
@settings(max_examples=15)
def test_straylight_grows_with_age(age: float, more: float, pupil_diameter_mm: float, deg: float) -> None:
    angle = np.array(deg)
    for iris in Iris:
        pigmentation, m = analytic.PIGMENTATION[iris], analytic.STRAYLIGHT[iris]
        old = min(age + more, 80.0)
        assert analytic.cie135(angle, old, pigmentation) >= analytic.cie135(angle, age, pigmentation)
        assert analytic.ijspeert(angle, pupil_diameter_mm, old, m) >= analytic.ijspeert(
            angle, pupil_diameter_mm, age, m
        )


def test_lighter_eyes_scatter_more_at_wide_angles() -> None:
    order = (Iris.DARK, Iris.BROWN, Iris.GREEN, Iris.BLUE)
    for table in (analytic.PIGMENTATION, analytic.STRAYLIGHT):
        assert [table[iris] for iris in order] == sorted(table.values())
    wide = np.array(20.0)
    cie = [float(analytic.cie135(wide, 40.0, analytic.PIGMENTATION[iris])) for iris in order]
    ijspeert = [float(analytic.ijspeert(wide, 4.0, 40.0, analytic.STRAYLIGHT[iris])) for iris in order]
    assert cie == sorted(cie)
    assert ijspeert == sorted(ijspeert)


@pytest.mark.parametrize("adapted_cd_m2", [100.0, 0.2, 0.001])
def test_spes_transfer_function(adapted_cd_m2: float) -> None:
    def density(deg: np.ndarray) -> np.ndarray:
        return analytic.spe(deg, adapted_cd_m2, 40.0)

    assert analytic.spe_mtf(CPD, adapted_cd_m2, 40.0) == pytest.approx(radial.hankel(density, CPD), abs=1e-4)


@pytest.mark.parametrize(("age", "iris"), list(itertools.product((20.0, 80.0), (Iris.DARK, Iris.BLUE))))
def test_transfer_functions_of_cie_and_ijspeert(age: float, iris: Iris) -> None:
    pigmentation, m = analytic.PIGMENTATION[iris], analytic.STRAYLIGHT[iris]
    cie = radial.hankel(lambda deg: analytic.cie135(deg, age, pigmentation), CPD)
    assert analytic.cie135_mtf(CPD, age, pigmentation) == pytest.approx(cie, abs=1e-4)
    for pupil_diameter_mm in (2.0, 8.0):
        ijspeert = radial.hankel(lambda deg, mm=pupil_diameter_mm: analytic.ijspeert(deg, mm, age, m), CPD)
        assert analytic.ijspeert_mtf(CPD, pupil_diameter_mm, age, m) == pytest.approx(ijspeert, abs=1e-4)


@pytest.mark.parametrize(("pupil_diameter_mm", "nm"), [(2.0, 575.0), (3.0, 450.0), (6.0, 650.0)])
def test_a_clear_pupils_transfer_function(pupil_diameter_mm: float, nm: float) -> None:
    """Against Airy's pattern within 3°, which leaves out less than 1e-3 of its light."""
    ring_deg = math.degrees(nm * 1e-9 / (pupil_diameter_mm * 1e-3))
    x, weights = np.polynomial.legendre.leggauss(8)
    edges = np.arange(0, 3, ring_deg / 4)
    deg = (edges[:, None] + ring_deg / 8 * (1 + x)).ravel()
    ring = np.tile(weights, len(edges)) * ring_deg / 8 * 2 * math.pi * deg * radial.SR_PER_DEG2
    light = airy(deg, pupil_diameter_mm, nm) * ring
    cut_off = 1 / ring_deg
    for cpd in (0.0, 0.1 * cut_off, 0.5 * cut_off, 0.9 * cut_off, 1.3 * cut_off):
        numerical = float(light @ special.j0(2 * math.pi * cpd * deg))
        assert float(analytic.diffraction_mtf(cpd, pupil_diameter_mm, nm)) == pytest.approx(numerical, abs=3e-3)
    assert float(airy(np.array(0.0), pupil_diameter_mm, nm)) == pytest.approx(
        math.pi / 4 * (pupil_diameter_mm * 1e-3 / (nm * 1e-9)) ** 2, rel=1e-12
    )


def test_transfer_functions_take_single_frequencies() -> None:
    for cpd in (0.0, 5.0):
        assert float(analytic.cie135_mtf(cpd, 30.0, 0.5)) == analytic.cie135_mtf(np.array([cpd]), 30.0, 0.5)[0]


def test_airys_first_dark_ring() -> None:
    dark = math.degrees(1.2197 * 575e-9 / 3e-3)
    assert airy(np.array(dark), 3.0, 575.0) < 1e-7 * airy(np.array(0.0), 3.0, 575.0)
