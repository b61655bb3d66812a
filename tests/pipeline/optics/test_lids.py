"""Lids and lashes before the pupil, and their agreement with how the tracker's side tells openness."""

import msgspec
import numpy as np
import pytest

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import aperture, coverage, lids
from entoptic.pipeline.optics.aperture import Pose
from entoptic.tracker_bridge.lids import estimated_openness

BARE = Observer(particles=0, cornea_cells=0, vitreous_particles=0, gratings=0)
N = 512


def shown(pose: Pose, observer: Observer = BARE, n: int = N) -> np.ndarray:
    return np.asarray(aperture.pupil_plane(observer, pose, n)).real.astype(np.float64)


def uncovered(pose: Pose, observer: Observer = BARE) -> float:
    """Share of the pupil's area that lids and lashes leave."""
    return float(shown(pose, observer).sum() / shown(Pose(pose.pupil_diameter_mm)).sum())


def test_open_lids_are_clear_of_the_widest_pupil() -> None:
    assert np.array_equal(shown(Pose(8.0, openness=0.9999999)), shown(Pose(8.0)))


@pytest.mark.parametrize(("openness", "expected"), [(0.75, 1.0), (0.7, 1.0), (0.5, 0.5)])
def test_where_a_lid_covers_a_4_mm_pupil(openness: float, expected: float) -> None:
    assert uncovered(Pose(4.0, openness=openness)) == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("openness", [0.65, 0.6, 0.55, 0.5, 0.45, 0.4])
def test_the_trackers_side_reads_the_same_openness_back(openness: float) -> None:
    """It takes the lid's edge for straight, and sees the diameter of the circle with the area left."""
    seen = uncovered(Pose(4.0, openness=openness)) ** 0.5
    assert estimated_openness(seen, 4.0) == pytest.approx(openness, abs=0.02)


def test_the_upper_lid_comes_from_above_and_the_lower_from_below() -> None:
    half = shown(Pose(8.0, openness=0.35))
    rows = np.flatnonzero(half.any(axis=1)) - N // 2
    assert rows[0] * aperture.PLANE_M / N == pytest.approx(1.5e-3, abs=2e-5)
    assert rows[-1] * aperture.PLANE_M / N == pytest.approx(3.7e-3, abs=3e-5)


def test_less_open_never_shows_more() -> None:
    left = [uncovered(Pose(6.0, openness=openness)) for openness in np.linspace(0, 1, 41)]
    assert np.all(np.diff(left) >= -1e-7)


@pytest.mark.parametrize("pupil_diameter_mm", [2.0, 4.0, 8.0])
@pytest.mark.parametrize("openness", [0.0, 0.1, 0.3])
def test_a_closed_eye_keeps_a_slit_with_light_in_it(pupil_diameter_mm: float, openness: float) -> None:
    """With as many lashes as an observer may have: a point-spread function needs some light."""
    plane = shown(Pose(pupil_diameter_mm, openness=openness, lashes=True), Observer(lashes=500, gratings=0))
    assert plane.max() > 0.5
    spread = np.abs(np.fft.fft2(plane)) ** 2
    assert np.isfinite(spread / spread.sum()).all()
    rows = np.flatnonzero(plane.any(axis=1))
    if openness == 0:
        assert np.ptp(rows) * aperture.PLANE_M / N < 1.3 * lids.SLIT_M


def test_lashes_hang_from_a_low_lid_only() -> None:
    """None before a pupil clear of the lid; more shadow the lower the lid is; the same lashes at every openness."""
    assert uncovered(Pose(4.0, openness=1.0, lashes=True)) == 1
    for openness, least in ((0.7, 0.0), (0.6, 0.02), (0.5, 0.05)):
        bare, hung = (uncovered(Pose(4.0, openness=openness, lashes=lashes)) for lashes in (False, True))
        assert least < 1 - hung / bare < 0.4
    hairless = msgspec.structs.replace(BARE, lashes=0)
    assert uncovered(Pose(4.0, openness=0.5, lashes=True), hairless) == uncovered(Pose(4.0, openness=0.5))


def test_lashes_have_the_same_area_on_any_grid() -> None:
    """Grids of odd size, which end at the same place whatever their step."""
    areas = []
    for n in (301, 601, 1201):
        clear = np.ones((n, n))
        lids.shade_lashes(clear, coverage.PLANE_M / n, Observer(lashes=60), 0.8, 4e-3)
        areas.append((1 - clear).sum() * (coverage.PLANE_M / n) ** 2)
    assert areas == pytest.approx([areas[-1]] * 3, rel=1e-3)


def test_lashes_leave_what_is_promised_at_the_lids_edge() -> None:
    """Where all of 500 grow side by side, the gaps are 0.4 of the edge."""
    clear = np.ones((2048, 2048))
    lids.shade_lashes(clear, coverage.PLANE_M / 2048, Observer(lashes=500), 0.6, 6e-3)
    upper_m, _ = lids.edges_m(0.6, 6e-3)
    root = round(1024 - upper_m / coverage.PLANE_M * 2048)
    assert clear[root + 2, 900:1150].mean() == pytest.approx(lids.LASH_GAP, abs=0.06)
