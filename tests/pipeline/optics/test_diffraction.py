"""Wave optics against closed forms."""

import functools
import math
import re
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest
from clear_pupil import pupil_disc
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.special import j1, jv

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import OpticsError, aperture, diffraction, focus
from entoptic.pipeline.optics.aperture import PLANE_M, Pose

N = 512
DARK_RINGS = (1.2197, 2.2331, 3.2383)
"""Of Airy's pattern in λ/D: the zeros of J1 over π."""


def samples(n: int) -> np.ndarray:
    return np.arange(n) - n // 2


def grid_m(n: int) -> tuple[np.ndarray, np.ndarray]:
    x = samples(n) * PLANE_M / n
    return x[:, None], x[None, :]


def apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max())


def psf_of(plane: np.ndarray) -> np.ndarray:
    return np.asarray(diffraction.point_spread(jnp.asarray(plane, jnp.complex128)))


@functools.cache
def disc(diameter_mm: float) -> np.ndarray:
    return np.asarray(pupil_disc(diameter_mm * 1e-3, N), np.float64)


def amplitude_of(diameter_mm: float) -> Callable[[float], float]:
    """The FFT's own sum along an axis of the field, at any fraction of a bin."""
    profile = disc(diameter_mm).sum(axis=0)
    x = samples(N)
    return lambda bins: float(profile @ np.cos(2 * np.pi * bins * x / N)) / float(profile.sum())


@pytest.mark.parametrize("diameter_mm", [2.0, 4.0, 7.0])
@pytest.mark.parametrize("nm", [420.0, 500.0, 575.0, 680.0])
def test_the_first_three_dark_rings_are_airys_at_each_wavelength(nm: float, diameter_mm: float) -> None:
    amplitude = amplitude_of(diameter_mm)
    first_bins = PLANE_M / (diameter_mm * 1e-3)
    for ring in DARK_RINGS:
        bins = brentq(amplitude, (ring - 0.3) * first_bins, (ring + 0.3) * first_bins)
        deg = math.degrees(ring * nm * 1e-9 / (diameter_mm * 1e-3))
        assert bins * diffraction.bin_deg(nm) == pytest.approx(deg, rel=0.005)
        scaled = bins * diffraction.bin_deg(diffraction.WAVELENGTH_NM) * nm / diffraction.WAVELENGTH_NM
        assert scaled == pytest.approx(deg, rel=0.005)


@pytest.mark.parametrize("diameter_mm", [2.0, 4.0, 7.0])
def test_the_function_is_airys_at_every_sample_near_the_axis(diameter_mm: float) -> None:
    psf = psf_of(disc(diameter_mm))
    v, u = samples(N)[:, None], samples(N)[None, :]
    x = np.pi * np.hypot(u, v) * diameter_mm * 1e-3 / PLANE_M
    with np.errstate(invalid="ignore"):
        airy = np.where(x == 0, 1, (2 * j1(x) / np.where(x == 0, 1, x)) ** 2)
    near = np.hypot(u, v) < 40
    assert np.abs(psf / psf.max() - airy)[near].max() < 1e-4
    amplitude = amplitude_of(diameter_mm)
    for bins in range(6):
        assert psf[N // 2, N // 2 + bins] / psf.max() == pytest.approx(amplitude(bins) ** 2, abs=1e-9)


@pytest.mark.parametrize("diameter_mm", [2.0, 4.0, 7.0])
def test_full_width_at_half_maximum(diameter_mm: float) -> None:
    amplitude = amplitude_of(diameter_mm)
    lambda_over_d = PLANE_M / (diameter_mm * 1e-3)
    half = brentq(lambda bins: amplitude(bins) ** 2 - 0.5, 0.01, 1.2 * lambda_over_d)
    assert 2 * half == pytest.approx(1.029 * lambda_over_d, rel=0.001)


@pytest.mark.parametrize("diameter_mm", [2.0, 4.0, 7.0])
def test_encircled_energy_at_the_dark_rings(diameter_mm: float) -> None:
    """An empty margin around the plane makes samples finer. The light on the axis says how much there is in all."""
    n, finer = 256, 8
    plane = np.pad(np.asarray(pupil_disc(diameter_mm * 1e-3, n), np.complex64), n * (finer - 1) // 2)
    psf = np.asarray(diffraction.point_spread(jnp.asarray(plane)))
    lambda_over_d = finer * PLANE_M / (diameter_mm * 1e-3)
    middle = slice(len(psf) // 2 - 200, len(psf) // 2 + 201)
    near = psf[middle, middle].astype(np.float64)
    away = np.hypot(*(np.indices(near.shape) - 200))
    whole = near.max() * 4 / np.pi * lambda_over_d**2
    for ring, share in zip(DARK_RINGS, (0.8378, 0.9099, 0.9376), strict=True):
        within = np.clip(ring * lambda_over_d - away + 0.5, 0, 1)
        assert (near * within).sum() / whole == pytest.approx(share, abs=0.002)


@pytest.mark.parametrize("amplitude", [0.29, 1.0, 2.4])
@pytest.mark.parametrize("lines", [16, 50])
def test_a_phase_gratings_orders(amplitude: float, lines: int) -> None:
    """At sin θ = m·λ/p with J_m² of the light each."""
    x = samples(N) / N
    psf = psf_of(np.ones((N, 1)) * np.exp(1j * amplitude * np.sin(2 * np.pi * lines * x))[None, :])
    for order in range(-4, 5):
        assert psf[N // 2, N // 2 + order * lines] == pytest.approx(jv(order, amplitude) ** 2, abs=1e-10)
    period_m = PLANE_M / lines
    sine = math.radians(lines * diffraction.bin_deg(532.0))
    assert sine == pytest.approx(532e-9 / period_m, rel=1e-12)


@given(st.sampled_from([4, 9, 32]), st.integers(0, 2**32 - 1))
def test_parseval(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    plane = random.normal(size=(n, n)) + 1j * random.normal(size=(n, n))
    psf = psf_of(plane)
    assert psf.sum() == pytest.approx(1, abs=1e-12)
    on_axis = abs(plane.sum()) ** 2 / (n * n * (abs(plane) ** 2).sum())
    assert psf[n // 2, n // 2] == pytest.approx(on_axis, rel=1e-9, abs=1e-15)


def test_precision_follows_the_plane() -> None:
    plane = jnp.asarray(disc(4.0))
    single = diffraction.point_spread(plane.astype(jnp.complex64))
    double = diffraction.point_spread(plane.astype(jnp.complex128))
    assert single.dtype == jnp.float32
    assert double.dtype == jnp.float64
    assert np.abs(np.asarray(single) - np.asarray(double)).max() < 1e-6 * float(double.max())
    assert float(np.asarray(single, np.float64).sum()) == pytest.approx(1, abs=1e-5)


def test_no_light_is_no_light_and_not_nan() -> None:
    assert not diffraction.point_spread(jnp.zeros((64, 64), jnp.complex64)).any()


def gaussian_pair(n: int, turned_rad: float) -> np.ndarray:
    """Two round Gaussian holes, 2 mm apart along a direction."""
    y, x = grid_m(n)
    along, across = x * np.cos(turned_rad) + y * np.sin(turned_rad), -x * np.sin(turned_rad) + y * np.cos(turned_rad)
    width = 0.5e-3
    return np.exp(-((along - 1e-3) ** 2 + across**2) / width**2) + np.exp(-((along + 1e-3) ** 2 + across**2) / width**2)


def test_a_gaussian_aperture_has_a_gaussian_function() -> None:
    y, x = grid_m(N)
    width = 0.7e-3
    psf = psf_of(np.exp(-(x**2 + y**2) / width**2))
    f = np.hypot(samples(N)[:, None], samples(N)[None, :]) / PLANE_M
    assert apart(psf / psf.max(), np.exp(-2 * (np.pi * width * f) ** 2)) < 1e-12


@pytest.mark.parametrize("turned_deg", [0.0, 17.0, 45.0, 121.5])
def test_turning_the_aperture_turns_the_function(turned_deg: float) -> None:
    turned = math.radians(turned_deg)
    psf = psf_of(gaussian_pair(N, turned))
    v, u = samples(N)[:, None] / PLANE_M, samples(N)[None, :] / PLANE_M
    along = u * np.cos(turned) + v * np.sin(turned)
    expected = np.exp(-2 * (np.pi * 0.5e-3) ** 2 * (u**2 + v**2)) * np.cos(2 * np.pi * 1e-3 * along) ** 2
    assert apart(psf / psf.max(), expected) < 1e-9


def test_a_quarter_turn_is_exact() -> None:
    random = np.random.default_rng(3)
    plane = random.normal(size=(255, 255)) + 1j * random.normal(size=(255, 255))
    assert apart(psf_of(np.rot90(plane)), np.rot90(psf_of(plane))) < 1e-12


@pytest.mark.parametrize("bins", [(3, 0), (-20, 7), (0, -255)])
def test_a_tilt_shifts_the_function_and_moving_the_aperture_does_not(bins: tuple[int, int]) -> None:
    plane = gaussian_pair(512, 0.4)
    psf = psf_of(plane)
    y, x = grid_m(512)
    tilt = np.exp(2j * np.pi * (bins[0] * y + bins[1] * x) / PLANE_M)
    assert apart(psf_of(plane * tilt), np.roll(psf, bins, (0, 1))) < 1e-14
    assert apart(psf_of(np.roll(plane, bins, (0, 1))), psf) < 1e-14


@pytest.mark.parametrize("defocus_d", [-0.3, 0.1, 0.25, 0.6])
@pytest.mark.parametrize("nm", [450.0, 650.0])
def test_light_on_the_axis_out_of_focus(defocus_d: float, nm: float) -> None:
    """sinc² of half the phase at the pupil's edge."""
    pupil = disc(4.0)
    ratio = psf_of(turned(pupil, defocus_d, 4e-3, nm))[N // 2, N // 2] / psf_of(pupil)[N // 2, N // 2]
    cycles = defocus_d * 2e-3**2 / (nm * 1e-9) / 2
    assert ratio == pytest.approx(np.sinc(cycles) ** 2, abs=0.001)


@pytest.mark.parametrize("defocus_d", [-4.0, 3.0, 4.0])
def test_far_out_of_focus_the_eye_has_the_blur_disc_of_geometric_optics(defocus_d: float) -> None:
    """As wide as the pupil × the defocus, evenly lit.

    Of a wide pupil: diffraction softens the disc's edge by a share that falls with the square root of the cycles of
    defocus at the pupil's edge, here 64 or 85.
    """
    psf = psf_of(turned(disc(7.0), defocus_d, 7e-3, 575.0))
    away_rad = np.hypot(samples(N)[:, None], samples(N)[None, :]) * math.radians(diffraction.bin_deg(575.0))
    order = np.argsort(away_rad, axis=None)
    within = np.cumsum(psf.ravel()[order])
    for share in (0.25, 0.5, 0.75, 0.9):
        radius = away_rad.ravel()[order][np.searchsorted(within, share)]
        assert radius == pytest.approx(math.sqrt(share) * 7e-3 * abs(defocus_d) / 2, rel=0.02)


@pytest.mark.parametrize("n", [256, 512, 1024])
def test_defocus_that_a_grid_does_not_sample_is_refused_up_to_the_limit(n: int) -> None:
    limit = 575e-9 / (2 * PLANE_M / n * 3.5e-3)
    part = np.ones((3, 3), np.complex64)
    focus.turn(part, n, 0.999 * limit, 7e-3, 575.0)
    with pytest.raises(OpticsError, match=r"samples less than .* D of defocus at a 7\.00 mm pupil") as refused:
        focus.turn(part, n, -1.2 * limit, 7e-3, 575.0)
    focus.turn(part, _named(refused), -1.2 * limit, 7e-3, 575.0)


@pytest.mark.parametrize(("n", "side"), [(256, 256), (256, 101), (2048, 1139)])
def test_the_phase_of_defocus_is_that_of_the_distance_from_the_middle(n: int, side: int) -> None:
    part = np.ones((side, side), np.complex128)
    focus.turn(part, n, 0.3, 4e-3, 500.0)
    x = (np.arange(side) - side // 2) * PLANE_M / n
    cycles = 0.3 * (x[:, None] ** 2 + x[None, :] ** 2) / 2 / 500e-9
    np.testing.assert_allclose(part, np.exp(2j * np.pi * cycles), rtol=0, atol=1e-12)


def turned(plane: np.ndarray, defocus_d: float, diameter_m: float, nm: float) -> np.ndarray:
    field = plane.astype(np.complex64)
    focus.turn(field, N, defocus_d, diameter_m, nm)
    return field


def _named(refused: pytest.ExceptionInfo[OpticsError]) -> int:
    found = re.search(r"use (\d+) samples", str(refused.value))
    assert found
    return int(found[1])


def random_planes(n: int, count: int) -> list[np.ndarray]:
    random = np.random.default_rng(11)
    return [random.random((n, n)) * np.exp(1j * random.normal(size=(n, n))) for _ in range(count)]


def test_planes_at_the_pupil_multiply() -> None:
    first, second, third = random_planes(64, 3)
    field = diffraction.through_planes(jnp.asarray(first), [(second, 0.0), (third, 0.0)])
    assert apart(np.asarray(field), first * second * third) < 1e-14


def test_a_clear_plane_further_back_keeps_energy_and_function() -> None:
    first = random_planes(256, 1)[0]
    field = diffraction.through_planes(jnp.asarray(first), [(np.ones((256, 256)), 12e-3)])
    assert (abs(np.asarray(field)) ** 2).sum() == pytest.approx((abs(first) ** 2).sum(), rel=1e-12)
    assert apart(psf_of(np.asarray(field)), psf_of(first)) < 1e-14
    assert np.abs(np.asarray(field) - first).max() > 0.1


@pytest.mark.parametrize("distance_m", [2e-3, 8e-3, 14e-3])
def test_a_converging_gaussian_beam(distance_m: float) -> None:
    """Against the complex beam parameter (ABCD): its width at the plane, over the cone's."""
    n, width_m, f = 512, 0.2e-3, diffraction.IMAGE_DISTANCE_M
    y, x = grid_m(n)
    beam = np.exp(-(x**2 + y**2) / width_m**2).astype(complex)
    field = np.abs(np.asarray(diffraction.through_planes(jnp.asarray(beam), [(np.ones((n, n)), distance_m)], 600.0)))
    wavelength = 600e-9 / diffraction.VITREOUS_INDEX
    q = 1 / (-1 / f - 1j * wavelength / (np.pi * width_m**2)) + distance_m
    width_there = math.sqrt(-wavelength / (np.pi * (1 / q).imag))
    in_pupil_coordinates = width_there / (1 - distance_m / f)
    assert apart(field / field.max(), np.exp(-(x**2 + y**2) / in_pupil_coordinates**2)) < 1e-6


def test_a_grating_images_itself_at_talbots_distance() -> None:
    """Half-way it is moved by half a period; so a second grating meets the first's own field, or its shifted one."""
    n, lines = 512, 64
    x = samples(n) / n
    first, second = (np.ones((n, 1)) * np.exp(1j * a * np.cos(2 * np.pi * lines * x))[None, :] for a in (0.5, 0.8))
    collimated = (PLANE_M / lines) ** 2 / (575e-9 / diffraction.VITREOUS_INDEX)
    f = diffraction.IMAGE_DISTANCE_M
    for talbots, moved in ((1.0, n // lines // 2), (2.0, 0)):
        distance = talbots * collimated * f / (f + talbots * collimated)
        field = np.asarray(diffraction.through_planes(jnp.asarray(first), [(second, distance)]))
        expected = np.roll(first, moved, 1) * second
        assert apart(psf_of(field), psf_of(expected)) < 1e-12


def test_planes_that_cannot_be_propagated_are_refused_by_name() -> None:
    ones = np.ones((64, 64), complex)
    with pytest.raises(OpticsError, match="between it and the focus"):
        diffraction.through_planes(jnp.asarray(ones), [(ones, 20.4e-3)])
    with pytest.raises(OpticsError, match="between it and the focus"):
        diffraction.through_planes(jnp.asarray(ones), [(ones, -1e-3)])
    with pytest.raises(OpticsError, match="order"):
        diffraction.through_planes(jnp.asarray(ones), [(ones, 5e-3), (ones, 4e-3)])
    with pytest.raises(OpticsError, match="too fine") as refused:
        diffraction.through_planes(jnp.ones((128, 128), complex), [(1.0, 20.2e-3)])
    least = _named(refused)
    assert PLANE_M**2 / least >= 575e-9 / 1.336 * diffraction.collimated_m(20.2e-3) > PLANE_M**2 / (least + 1)


def test_particles_of_the_vitreous_in_their_own_plane() -> None:
    """The single plane that RIT 4.1 chose has another pattern of speckles and the same light at each angle."""
    n = 1024
    observer = Observer(particles=0, gratings=0, cornea_cells=0)
    first = aperture.placed(aperture.pupil_box(observer, Pose(5.0), n, vitreous_apart=True), n)
    later = aperture.later_planes(observer, Pose(5.0), n)
    far, near, clear = (
        diffraction.point_spread(plane).astype(np.float64)
        for plane in (diffraction.through_planes(first, later), first * later[0][0], first)
    )
    assert np.linalg.norm(far - near) / np.linalg.norm(near) < 0.02
    away = np.hypot(samples(n)[:, None], samples(n)[None, :])
    speckles = (away > 60) & (away < 200)
    assert np.linalg.norm((far - near)[speckles]) > 0.2 * np.linalg.norm(near[speckles])
    scattered = [(psf - clear)[speckles].sum() for psf in (far, near)]
    assert scattered[0] == pytest.approx(scattered[1], rel=0.1)
