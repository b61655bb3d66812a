"""Wave optics against closed forms."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from pipeline import Observer
from pipeline.optics import OpticsError, aperture, diffraction, spectrum

CLEAR = Observer(particles=0, gratings=0)
N = 2048


def psf_of(observer: Observer, diameter_mm: float) -> np.ndarray:
    plane = aperture.pupil_plane(aperture.eye_structure(observer, N), jnp.float32(diameter_mm * 1e-3), N)
    return np.asarray(diffraction.point_spread(plane))


def radial_mean(psf: np.ndarray) -> np.ndarray:
    y, x = np.indices(psf.shape) - N // 2
    ring = np.hypot(x, y).astype(int)
    return np.bincount(ring.ravel(), psf.ravel().astype(np.float64)) / np.bincount(ring.ravel())


@pytest.mark.parametrize("diameter_mm", [2.0, 4.0, 7.0])
def test_a_clear_pupils_first_dark_ring_is_airys(diameter_mm: float) -> None:
    """Between the samples of the FFT, the amplitude is the same sum at a fraction of a bin."""
    profile = np.asarray(aperture.pupil_disc(diameter_mm * 1e-3, N), np.float64).sum(axis=0)
    x = np.arange(N) - N // 2

    def amplitude(bins: float) -> float:
        return float(profile @ np.cos(2 * np.pi * bins * x / N))

    expected_bins = 1.2197 * aperture.PLANE_M / (diameter_mm * 1e-3)
    assert brentq(amplitude, 0.9 * expected_bins, 1.1 * expected_bins) == pytest.approx(expected_bins, rel=0.005)
    psf = psf_of(CLEAR, diameter_mm)
    for bins in range(6):
        assert psf[N // 2, N // 2 + bins] / psf.max() == pytest.approx((amplitude(bins) / amplitude(0)) ** 2, abs=1e-6)


def test_encircled_energy_of_a_clear_pupil() -> None:
    psf = psf_of(CLEAR, 2.0)
    y, x = np.indices(psf.shape) - N // 2
    within = np.hypot(x, y) <= 1.2197 * aperture.PLANE_M / 2e-3
    assert psf[within].sum() == pytest.approx(0.838, abs=0.01)


def test_the_fibres_halo_lies_at_three_degrees_for_568_nm() -> None:
    psf = psf_of(Observer(particles=0), 7.0)
    profile = radial_mean(psf) * np.arange(len(radial_mean(psf)))
    deg_at_568 = np.arange(len(profile)) * diffraction.bin_deg(diffraction.WAVELENGTH_NM) * 568 / 575
    near = (deg_at_568 > 2) & (deg_at_568 < 4)
    assert deg_at_568[near][np.argmax(profile[near])] == pytest.approx(3.0, abs=0.03)


def test_the_halo_of_the_average_eye_has_spencers_share_of_the_light() -> None:
    """3.3 % at 7 mm (SPE 10), counted in the ring itself against the same pupil without fibres."""
    y, x = (np.indices((N, N)) - N // 2) * diffraction.bin_deg(diffraction.WAVELENGTH_NM)
    ring = (np.hypot(x, y) > 2) & (np.hypot(x, y) < 4)
    clear = psf_of(CLEAR, 7.0)[ring].sum(dtype=np.float64)
    eyes = [psf_of(Observer(particles=0, seed=seed), 7.0) for seed in range(6)]
    shares = [eye[ring].sum(dtype=np.float64) - clear for eye in eyes]
    assert np.mean(shares) == pytest.approx(0.033, abs=0.002)
    assert np.ptp(shares) < 0.01


def test_a_pupil_under_3_mm_has_no_halo() -> None:
    ring = slice(780, 860)
    narrow, wide = (radial_mean(psf_of(Observer(particles=0), mm))[ring].max() for mm in (2.5, 7.0))
    assert wide > 20 * narrow


def test_a_coarse_grid_refuses_fibres_by_name() -> None:
    with pytest.raises(OpticsError, match="2048"):
        aperture.eye_structure(Observer(), 1024)


@pytest.mark.parametrize("pixels_per_deg", [5.0, 9.82, 13.85, 30.0, 60.0])
def test_a_kernel_has_unit_volume_at_any_pixel_size(pixels_per_deg: float) -> None:
    kernel = np.asarray(spectrum.rgb_kernel(psf_of(Observer(), 5.0), pixels_per_deg))
    assert kernel.sum(axis=(1, 2)) == pytest.approx([1, 1, 1], abs=1e-9)
    assert kernel.min() >= 0


def test_the_summed_area_table_equals_summing_each_wavelength() -> None:
    psf, pixels_per_deg = psf_of(Observer(), 5.0), 9.82
    nm, weights = spectrum.rgb_of_white()
    radius = spectrum.kernel_radius_px(N, pixels_per_deg)
    expected = np.zeros((3, 2 * radius + 1, 2 * radius + 1))
    fine = psf.astype(np.float64)
    for wavelength, rgb in zip(nm, weights, strict=True):
        edges_deg = (np.arange(N + 1) - N // 2 - 0.5) * diffraction.bin_deg(wavelength)
        pixel_edges = (np.arange(2 * radius + 2) - radius - 0.5) / pixels_per_deg
        low = np.maximum(edges_deg[None, :-1], pixel_edges[:-1, None])
        high = np.minimum(edges_deg[None, 1:], pixel_edges[1:, None])
        share = np.clip(high - low, 0, None) / diffraction.bin_deg(wavelength)
        expected += rgb[:, None, None] * (share @ fine @ share.T)
    expected = np.maximum(expected, 0)
    expected /= expected.sum(axis=(1, 2), keepdims=True)
    assert np.asarray(spectrum.rgb_kernel(psf, pixels_per_deg)) == pytest.approx(expected, rel=1e-6, abs=1e-14)


def test_the_same_observer_has_the_same_eye_and_another_seed_another() -> None:
    aperture.eye_structure.cache_clear()
    one = np.asarray(aperture.eye_structure(Observer(), N))
    aperture.eye_structure.cache_clear()
    assert np.array_equal(one, np.asarray(aperture.eye_structure(Observer(), N)))
    assert not np.array_equal(one, np.asarray(aperture.eye_structure(Observer(seed=1), N)))


def test_the_halo_is_a_ring_without_corners() -> None:
    """Higher orders of the fibres, were they kept, would fold back to the diagonals at 4.6°."""
    psf = psf_of(Observer(particles=0), 7.0)
    y, x = (np.indices(psf.shape) - N // 2) * diffraction.bin_deg(diffraction.WAVELENGTH_NM)
    away = np.hypot(x, y)
    corners, ring = (away > 4.3) & (away < 4.9), (away > 2.95) & (away < 3.15)
    assert psf[corners].mean() < 1e-3 * psf[ring].mean()
