"""The whole point-spread function: its parts' energy, its join, its independence of the display."""

import numpy as np
import pytest

from entoptic.pipeline import Observer
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.optics import analytic, light_spectra, radial, whole
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.optics.monochromatic import monochromatic

N = 512
CLEAR = Observer(particles=0, cornea_cells=0, vitreous_particles=0, gratings=0)
EYE = 30.0, 0.5


def clear_psf(n: int = N) -> np.ndarray:
    return monochromatic(CLEAR, Pose(3.0), n)


@pytest.mark.parametrize("nm", [400.0, 568.0, 700.0])
@pytest.mark.parametrize(("age", "pigmentation"), [(20.0, 0.0), (80.0, 1.2)])
def test_each_wavelengths_light_is_accounted_for(nm: float, age: float, pigmentation: float) -> None:
    """From the central peak to 90°: what the core does not have, the formula has."""

    def beyond(deg: np.ndarray) -> np.ndarray:
        near = whole.beyond_core(deg, (nm,), (1.0,), 2048, age, pigmentation) * (1 - whole.veil_part(deg))
        return near + analytic.cie135(deg, age, pigmentation) * whole.veil_part(deg)

    parts = whole.shares(nm, 2048, age, pigmentation)
    assert sum(parts) == pytest.approx(1, abs=1e-12)
    assert min(parts) > 0
    assert radial.hemisphere_volume(beyond) == pytest.approx(parts[1] + parts[2], abs=1e-6)


@pytest.mark.parametrize("pixels_per_deg", [5.0, 9.82, 20.0, 60.0])
def test_kernel_and_veil_have_unit_volume(pixels_per_deg: float) -> None:
    nm, weights = light_spectra.primary_weights(8)
    kernel, veil = whole.wave_kernel(clear_psf(), nm, weights, pixels_per_deg, *EYE)
    np.testing.assert_allclose(kernel.sum(axis=(2, 3)) + veil * np.eye(3), np.eye(3), atol=1e-3)
    assert np.einsum("o,oijk->ijk", np.array(LUMINANCE_WEIGHTS), kernel).min() >= 0


@pytest.mark.parametrize("n", [256, 2048, 3000, 4096])
def test_a_finer_plane_ends_before_the_veil_and_keeps_its_light(n: int) -> None:
    psf = np.zeros((n, n), np.float32)
    psf[n // 2, n // 2] = 1
    nm, weights = light_spectra.primary_weights(4)
    kernel, veil = whole.wave_kernel(psf, nm, weights, 8.0, *EYE)
    np.testing.assert_allclose(kernel.sum(axis=(2, 3)) + veil * np.eye(3), np.eye(3), atol=1e-3)


def test_glares_angle_does_not_depend_on_resolution() -> None:
    """The light beyond an angle is the same on displays of 8 and 24 pixels per degree."""
    nm, weights = light_spectra.primary_weights(16)
    beyond = {}
    for pixels_per_deg in (8.0, 24.0):
        kernel, _ = whole.wave_kernel(clear_psf(), nm, weights, pixels_per_deg, *EYE)
        y, x = (np.indices(kernel.shape[2:]) - kernel.shape[2] // 2) / pixels_per_deg
        white = np.einsum("o,oijk->jk", np.array(LUMINANCE_WEIGHTS), kernel)
        # Pixels have corners: a ring through pixel borders, averaged over many of them.
        beyond[pixels_per_deg] = [white[np.hypot(x, y) > deg].sum() for deg in (1.0, 2.0, 4.0, 6.0)]
    assert beyond[8.0] == pytest.approx(beyond[24.0], rel=0.02)


def test_the_join_has_no_step() -> None:
    """Of a formula continued by itself nothing is seen: the taper gives what it takes."""
    deg = np.linspace(0.5, 20, 2000)
    joined = whole.beyond_core(deg, (568.0,), (1.0,), 2048, *EYE)
    steps = np.diff(np.log(joined))
    assert np.abs(steps).max() < 0.055
    outside = deg > 5
    np.testing.assert_allclose(joined[outside], analytic.cie135(deg[outside], *EYE), rtol=1e-12)


def test_the_default_eyes_mean_is_cies() -> None:
    """Of what its structures scatter and what the plane cannot resolve, but for the halo; and on through the join."""
    nm, weights = light_spectra.primary_weights()
    psf = monochromatic(Observer(), Pose(2.5))
    kernel, _ = whole.wave_kernel(psf, nm, weights, 20.0, *EYE)
    white = np.einsum("o,oijk->jk", np.array(LUMINANCE_WEIGHTS), kernel) * (np.degrees(1) * 20) ** 2
    y, x = (np.indices(white.shape) - white.shape[0] // 2) / 20.0
    away = np.hypot(x, y)
    for low, high, tolerance in (
        (0.5, 1.0, 0.1),
        (1.0, 1.5, 0.12),
        (1.5, 2.0, 0.05),
        (2.5, 3.0, 0.2),
        (3.4, 3.8, 0.05),
        (3.9, 4.4, 0.01),
    ):
        ring = (away > low) & (away < high)
        expected = analytic.cie135(away[ring], *EYE).mean()
        assert white[ring].mean() == pytest.approx(expected, rel=tolerance), (low, high)


def test_fresh_ffts_give_the_same_kernel_in_focus() -> None:
    nm, weights = light_spectra.primary_weights(4)

    def light(wavelength_nm: float) -> np.ndarray:
        return monochromatic(CLEAR, Pose(3.0), N, wavelength_nm=wavelength_nm, double=True)

    fresh, veil = whole.fresh_wave_kernel(light, N, nm, weights, 9.82, *EYE)
    scaled, same_veil = whole.wave_kernel(clear_psf(), nm, weights, 9.82, *EYE)
    assert veil == same_veil
    np.testing.assert_allclose(scaled, fresh, rtol=0, atol=1e-6)
