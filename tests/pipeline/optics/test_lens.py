"""The fibres' halo against Spencer's, and the particles' statistics and motion."""

import numpy as np
import pytest
import scipy.fft
from clear_pupil import pupil_disc

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import OpticsError, aperture, coverage, lens, lens_springs
from entoptic.pipeline.optics.aperture import Pose

FIBRES = {"particles": 0, "cornea_cells": 0, "vitreous_particles": 0}
N = 2048
DEG_AT_575 = np.degrees(575e-9 / aperture.PLANE_M)


def spread(plane: object) -> np.ndarray:
    """Intensity of the plane's diffraction, its sum 1, by a second library."""
    intensity = np.abs(scipy.fft.fftshift(scipy.fft.fft2(np.asarray(plane)))) ** 2
    return np.asarray(intensity / intensity.sum(dtype=np.float64))


def off_axis_deg() -> np.ndarray:
    y, x = (np.indices((N, N)) - N // 2) * DEG_AT_575
    return np.asarray(np.hypot(x, y))


def test_the_halo_is_a_ring_at_three_degrees_for_568_nm_and_has_spencers_share() -> None:
    """3.3 % of the light at 7 mm (SPE 10), counted in the ring against the same pupil without fibres."""
    away = off_axis_deg()
    ring = (away > 2) & (away < 4)
    clear = spread(pupil_disc(7e-3, N))[ring].sum()
    flank = (away > 2.4) & (away < 3.7)
    out = away[flank] * 568 / 575
    shares = []
    for seed in range(4):
        eye = spread(aperture.pupil_plane(Observer(seed=seed, **FIBRES), Pose(7.0), N))
        shares.append(eye[ring].sum(dtype=np.float64) - clear)
        middle = np.average(out, weights=eye[flank] / out)
        assert middle == pytest.approx(3.0, abs=0.02)
        width = np.sqrt(np.average((out - middle) ** 2, weights=eye[flank] / out))
        assert width == pytest.approx(1 / np.sqrt(2 * 19.75), rel=0.05), "SPE f3"
    print(f"halo: {100 * np.mean(shares):.2f} % of the light, {100 * min(shares):.1f}–{100 * max(shares):.1f} %")
    assert np.mean(shares) == pytest.approx(0.033, abs=0.002)
    assert np.ptp(shares) < 0.01
    # Higher orders of the fibres, were they kept, would fold back to the diagonals at 4.6°.
    assert eye[(away > 4.3) & (away < 4.9)].mean() < 1e-3 * eye[(away > 2.95) & (away < 3.15)].mean()


def test_a_pupil_under_3_mm_has_no_halo() -> None:
    away = off_axis_deg()
    ring = (away > 2.9) & (away < 3.1)
    narrow, wide = (spread(aperture.pupil_plane(Observer(**FIBRES), Pose(mm), N))[ring].sum() for mm in (2.5, 7.0))
    assert wide > 20 * narrow


def test_a_coarse_grid_refuses_fibres_by_name() -> None:
    with pytest.raises(OpticsError, match="2048"):
        aperture.pupil_plane(Observer(), Pose(4.0), 1024)
    aperture.pupil_plane(Observer(gratings=0), Pose(4.0), 1024)


def shadows(observer: Observer, lens_m: np.ndarray | None, monkeypatch: pytest.MonkeyPatch) -> tuple[np.ndarray, ...]:
    """Places x, y and radii of the discs that the lens would draw, in metres."""
    drawn: list[tuple[np.ndarray, ...]] = []
    monkeypatch.setattr(coverage, "shade_discs", lambda *args: drawn.append(args[2:]))
    lens.shade(np.ones((2, 2), np.float32), 1e-3, observer, lens_m)
    return drawn[0]


def test_particles_at_rest_fill_the_plane_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    x, y, radius = shadows(Observer(particles=20000), None, monkeypatch)
    share_within, _ = np.histogram(np.hypot(x, y) / lens.RADIUS_M, np.sqrt(np.linspace(0, 1, 11)))
    assert share_within / 20000 == pytest.approx(np.full(10, 0.1), abs=0.01)
    assert (x.mean(), y.mean()) == pytest.approx((0, 0), abs=5e-5)
    assert np.unique(radius) == pytest.approx([21e-6])


def test_diameters_spread_log_normally_about_their_median(monkeypatch: pytest.MonkeyPatch) -> None:
    _, _, radius = shadows(Observer(particles=20000, particle_spread=0.5), None, monkeypatch)
    assert np.median(radius) == pytest.approx(21e-6, rel=0.02)
    assert np.log(radius).std() == pytest.approx(0.5, rel=0.05)
    assert radius.max() <= 21e-6 * np.exp(0.5 * lens.SPREAD_LIMIT) * (1 + 1e-9)


def test_a_deformed_lens_moves_its_particles_outward_by_their_depth_and_radius(monkeypatch: pytest.MonkeyPatch) -> None:
    """A displacement that is bilinear in depth and radius is found exactly; azimuths stay."""
    depth, radius = np.meshgrid(np.linspace(0, 1, 17), np.linspace(0, 1, 17), indexing="ij")
    at_rest = shadows(Observer(), None, monkeypatch)
    by_radius = shadows(Observer(), 0.1 * lens_springs.RADIUS_M * radius, monkeypatch)
    assert by_radius[0] == pytest.approx(1.1 * at_rest[0])
    assert by_radius[1] == pytest.approx(1.1 * at_rest[1])
    by_depth = shadows(Observer(), 1e-4 * depth, monkeypatch)
    moved = np.hypot(*by_depth[:2]) - np.hypot(*at_rest[:2])
    assert np.sort(moved) == pytest.approx(np.linspace(0, 1e-4, 1000), abs=5e-6)
    still = shadows(Observer(), np.zeros((17, 17)), monkeypatch)
    assert np.array_equal(still[0], at_rest[0])
