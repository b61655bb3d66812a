"""Kernels over display pixels at all wavelengths."""

import functools
import math
from collections.abc import Callable

import numpy as np
import pytest
from clear_pupil import pupil_disc
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import aperture, diffraction, focus, light_spectra, spectrum
from entoptic.pipeline.optics.aperture import PLANE_M, Pose

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
N = 512


def speckled_plane(n: int = N, seed: int = 0) -> np.ndarray:
    """A pupil with a random phase in it: light all over the field."""
    random = np.random.default_rng(seed)
    phase = np.exp(0.5j * random.normal(size=(n, n)))
    return np.asarray(np.asarray(pupil_disc(5e-3, n)) * phase)


@functools.cache
def psf(n: int = N, seed: int = 0, kind: type = np.float64) -> np.ndarray:
    number = np.complex64 if kind is np.float32 else np.complex128
    return diffraction.point_spread(speckled_plane(n, seed).astype(number))


def light_of(plane: np.ndarray) -> Callable[[float], np.ndarray]:
    """The same pupil plane at every wavelength."""
    return lambda _: diffraction.point_spread(plane.astype(np.complex128))


def plain(light: np.ndarray, nm: float, pixels_per_deg: float, radius: int, shift: tuple[float, float]) -> np.ndarray:
    """The same by the overlap of every sample with every pixel, written out."""
    sample_deg = math.degrees(nm * 1e-9 / PLANE_M)
    low = (np.arange(len(light)) - len(light) // 2 - 0.5) * sample_deg
    shares = []
    for by in shift:
        pixel = (np.arange(-radius, radius + 1)[:, None] - 0.5 - by) / pixels_per_deg
        overlap = np.minimum(low + sample_deg, pixel + 1 / pixels_per_deg) - np.maximum(low, pixel)
        shares.append(np.clip(overlap, 0, None) / sample_deg)
    return np.asarray(shares[0] @ light @ shares[1].T)


@pytest.mark.parametrize("pixels_per_deg", [5.0, 9.82, 13.85, 30.0, 60.0])
def test_every_primary_keeps_its_light_at_any_pixel_size(pixels_per_deg: float) -> None:
    nm, weights = light_spectra.primary_weights()
    kernel = spectrum.scaled_kernel(psf(), nm, weights, pixels_per_deg)
    assert np.abs(kernel.sum(axis=(2, 3)) - np.eye(3)).max() < 1e-12
    grey = kernel.sum(axis=1).sum(axis=(1, 2))
    assert grey == pytest.approx([1, 1, 1], abs=1e-12)
    luminance = np.tensordot(LUMINANCE, kernel, axes=1)
    assert luminance.min() >= -1e-18
    single = spectrum.scaled_kernel(psf(kind=np.float32), nm, weights, pixels_per_deg)
    assert np.abs(single.sum(axis=(2, 3)) - np.eye(3)).max() < 1e-5
    assert np.abs(single - kernel).max() < 3e-6 * np.abs(kernel).max()
    assert np.tensordot(LUMINANCE, single, axes=1).min() >= -1e-12


@given(st.floats(380, 770), st.floats(3, 300), st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)))
def test_the_sparse_sums_are_the_overlaps_written_out(
    nm: float, pixels_per_deg: float, shift: tuple[float, float]
) -> None:
    light = psf(64)
    radius = spectrum.kernel_radius_px(64, pixels_per_deg)
    kernel = spectrum.scaled_kernel(light, np.array([nm]), np.ones(1), pixels_per_deg, shift)
    assert kernel.shape == (2 * radius + 1, 2 * radius + 1)
    assert np.abs(kernel - plain(light, nm, pixels_per_deg, radius, shift)).max() < 1e-14
    assert kernel.sum() == pytest.approx(1, abs=1e-12)


def test_scaling_one_function_equals_an_fft_for_each_wavelength() -> None:
    """In focus: in float64 to rounding, and in float32 to 1e-6 of the peak."""
    plane = speckled_plane()
    nm, weights = light_spectra.primary_weights(8)
    fresh = spectrum.fresh_kernel(light_of(plane), nm, weights, 9.82)
    assert np.abs(spectrum.scaled_kernel(psf(), nm, weights, 9.82) - fresh).max() < 1e-14
    single = spectrum.scaled_kernel(psf(kind=np.float32), nm, weights, 9.82)
    assert np.abs(single - fresh).max() < 3e-6 * np.abs(fresh).max()
    assert np.linalg.norm(single - fresh) / np.linalg.norm(fresh) < 1e-6


def test_out_of_focus_the_reference_differs_as_the_blur_does_not_scale() -> None:
    """Geometric blur is as wide at all wavelengths; scaling one function makes it grow."""
    disc, nm = np.asarray(pupil_disc(4e-3, N)), np.array([450.0, 700.0])

    def light(at: float) -> np.ndarray:
        field = disc.astype(np.complex64)
        focus.turn(field, N, 3.0, 4e-3, at)
        return diffraction.point_spread(field.astype(np.complex128))

    one = light(575.0)
    fresh, scaled = (
        kernel(subject, nm, np.eye(2), 60.0)
        for kernel, subject in ((spectrum.fresh_kernel, light), (spectrum.scaled_kernel, one))
    )
    radius = np.arange(fresh.shape[-1]) - fresh.shape[-1] // 2
    away = np.hypot(radius[:, None], radius[None, :])
    fresh_width, scaled_width = ((kernel * away).sum(axis=(1, 2)) for kernel in (fresh, scaled))
    assert fresh_width[1] / fresh_width[0] == pytest.approx(1, abs=0.02)
    assert scaled_width[1] / scaled_width[0] == pytest.approx(700 / 450, rel=0.02)


@pytest.mark.parametrize("nm", [420.0, 500.0, 575.0, 680.0])
@pytest.mark.parametrize("pupil_diameter_mm", [0.3, 0.4, 0.5])
@pytest.mark.parametrize("kernel_of", ["scaled", "fresh"])
def test_airys_dark_rings_in_a_kernel(nm: float, pupil_diameter_mm: float, kernel_of: str) -> None:
    """Of pupils so narrow that samples are small beside the rings; wider ones are in test_diffraction.py."""
    diameter_m = pupil_diameter_mm * 1e-3
    disc = np.asarray(pupil_disc(diameter_m, N), np.float64)
    lambda_over_d_px = 16
    pixels_per_deg = lambda_over_d_px / math.degrees(nm * 1e-9 / diameter_m)
    task = (np.array([nm]), np.ones(1), pixels_per_deg)
    if kernel_of == "fresh":
        kernel = spectrum.fresh_kernel(light_of(disc), *task, radius_px=60)
    else:
        light = diffraction.point_spread(disc.astype(np.complex128))
        kernel = spectrum.scaled_kernel(light, *task, radius_px=60)
    x = np.arange(121) - 60
    away = np.hypot(x[:, None], x[None, :])
    for ring in (1.2197, 2.2331, 3.2383):
        ring_px = ring * lambda_over_d_px
        near = np.abs(away - ring_px) < 4
        curve = np.polyfit(away[near] - ring_px, kernel[near], 4)
        error_px = min(np.roots(np.polyder(curve)).real, key=abs)
        assert error_px / ring_px == pytest.approx(0, abs=0.005)


def test_a_kernel_moves_with_its_light() -> None:
    nm, weights = light_spectra.light_weights("D65", 4)
    up, down = (spectrum.scaled_kernel(psf(), nm, weights, 30.0, (shift, 0.0)) for shift in (-0.5, 0.5))
    assert np.abs(down[:, 1:] - up[:, :-1]).max() < 1e-14


@pytest.mark.parametrize("shift", [(0.31, -0.44), (-0.5, 0.125)])
def test_a_light_off_the_middle_has_the_pixels_integrals_there(shift: tuple[float, float]) -> None:
    """Down and right, in colour, by both ways."""
    nm, weights = light_spectra.primary_weights(4)
    kernel = spectrum.scaled_kernel(psf(), nm, weights, 30.0, shift)
    light = np.stack([plain(psf(), at, 30.0, kernel.shape[-1] // 2, shift) for at in nm])
    exact = np.einsum("loi,lyx->oiyx", weights, light)
    assert np.abs(kernel - exact).max() < 1e-14
    fresh = spectrum.fresh_kernel(light_of(speckled_plane()), nm, weights, 30.0, shift)
    assert np.abs(fresh - exact).max() < 1e-14


@pytest.mark.parametrize("rows", [1, 7, 32])
def test_however_many_rows_are_made_at_once(rows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    nm, weights = light_spectra.primary_weights(4)
    before = spectrum.scaled_kernel(psf(), nm, weights, 13.85)
    monkeypatch.setattr(spectrum, "ROWS", rows)
    assert np.array_equal(spectrum.scaled_kernel(psf(), nm, weights, 13.85), before)


def test_a_smaller_kernel_is_the_middle_of_the_whole() -> None:
    nm, weights = light_spectra.primary_weights(4)
    whole = spectrum.scaled_kernel(psf(), nm, weights, 30.0)
    part = spectrum.scaled_kernel(psf(), nm, weights, 30.0, radius_px=10)
    middle = slice(whole.shape[-1] // 2 - 10, whole.shape[-1] // 2 + 11)
    assert np.array_equal(part, whole[..., middle, middle])


def test_a_taper_leaves_a_round_field_and_all_the_light() -> None:
    light = spectrum.tapered(psf(), (0.8, 1.0))
    away = np.hypot(*(np.indices(light.shape) - N // 2)) / (N / 2)
    assert light.sum() == pytest.approx(1, abs=1e-12)
    assert not light[away >= 1].any()
    inside = away < 0.8
    share = 1 - (psf() * spectrum._field(N, (0.8, 1.0), psf().dtype)).sum() / psf().sum()
    assert psf()[away > 1].sum() < share < psf()[~inside].sum()
    assert light[inside] / psf()[inside] == pytest.approx(1 / (1 - share), rel=1e-9)
    nm, weights = light_spectra.primary_weights(4)
    kernel = spectrum.scaled_kernel(psf(), nm, weights, 9.82, taper=(0.8, 1.0))
    assert np.abs(kernel.sum(axis=(2, 3)) - np.eye(3)).max() < 1e-12
    plane = speckled_plane()
    fresh = spectrum.fresh_kernel(light_of(plane), nm, weights, 9.82, taper=(0.8, 1.0))
    assert np.abs(kernel - fresh).max() < 1e-14


def ring_mean(image: np.ndarray) -> np.ndarray:
    """Mean of each ring, one sample wide, around the middle."""
    y, x = np.indices(image.shape) - image.shape[0] // 2
    ring = np.hypot(x, y).round().astype(int)
    return np.bincount(ring.ravel(), image.ravel()) / np.bincount(ring.ravel())


@functools.cache
def fibres_alone() -> np.ndarray:
    plane = aperture.pupil_plane(Observer(particles=0, cornea_cells=0, vitreous_particles=0), Pose(7.0), 2048)
    return np.asarray(diffraction.point_spread(plane))


def halo_deg(weights: np.ndarray, nm: np.ndarray) -> float:
    """Centroid of the light in the rings around a halo's brightest one."""
    kernel = spectrum.scaled_kernel(fibres_alone(), nm, weights, 60.0)
    profile = ring_mean(kernel)
    light = profile * np.arange(len(profile))
    start, end = round(1.7 * 60), round(4.4 * 60)
    best = start + int(np.argmax(light[start:end]))
    near = np.arange(best - 24, best + 25)
    above = np.clip(light[near] - 0.5 * light[best], 0, None)
    return float((near * above).sum() / above.sum() / 60)


def test_the_halo_lies_at_three_degrees_and_grows_with_the_wavelength() -> None:
    assert halo_deg(np.ones(1), np.array([568.0])) == pytest.approx(3.0, abs=0.03)
    for nm in (450.0, 510.0, 650.0):
        assert halo_deg(np.ones(1), np.array([nm])) == pytest.approx(3.0 * nm / 568, rel=0.01)


def test_a_red_lights_halo_is_wider_than_a_blue_ones() -> None:
    """As their dominant wavelengths: what each primary sends to its own channel."""
    nm, weights = light_spectra.primary_weights(64)
    red, green, blue = (halo_deg(np.clip(weights[:, c, c], 0, None), nm) for c in range(3))
    assert blue < green < red
    dominant = [nm[np.argmax(weights[:, c, c])] for c in range(3)]
    for halo, at in zip((red, green, blue), dominant, strict=True):
        assert halo == pytest.approx(3.0 * at / 568, rel=0.03)
