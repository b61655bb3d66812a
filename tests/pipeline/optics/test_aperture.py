"""The whole pupil plane: parts that do not disturb each other, shares of scatter, grids of any size."""

import math

import numpy as np
import pytest
from clear_pupil import pupil_disc

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import OpticsError, aperture, lens
from entoptic.pipeline.optics.aperture import Pose

N = 2048
PARTS = {"cornea_cells": 5400, "particles": 1000, "vitreous_particles": 250, "gratings": 9000}
NOTHING = dict.fromkeys(PARTS, 0)
STRAIN_M = 2e-4 * np.linspace(0, 1, 17) * np.ones((17, 1))


def plane(pose: Pose, n: int = N, **parts: int) -> np.ndarray:
    return np.asarray(aperture.pupil_plane(Observer(**{**NOTHING, **parts}), pose, n))


def test_a_plane_is_the_product_of_its_parts() -> None:
    """So each has a random stream of its own: leaving one out leaves the others where they are."""
    product = np.asarray(pupil_disc(8e-3, N)) == 1
    inside = product.copy()
    for part, count in PARTS.items():
        product = product * plane(Pose(8.0), **{part: count})
    assert np.abs(plane(Pose(8.0), **PARTS) - product)[inside].max() < 2e-6


def test_the_scattered_light_divides_as_measured_in_eyes() -> None:
    """Cornea 25–30, lens 40, vitreous 10 (RIT Table 1). By Babinet, opaque discs scatter as much as they block."""
    blocked = dict.fromkeys(("cornea_cells", "particles", "vitreous_particles"), 0.0)
    clear = plane(Pose(7.0), 512).real.sum()
    for part in blocked:
        for seed in range(8):
            eye = Observer(**{**NOTHING, part: PARTS[part]}, seed=seed)
            shown = np.asarray(aperture.pupil_plane(eye, Pose(7.0), 512)).real
            blocked[part] += float(1 - shown.sum(dtype=np.float64) / clear) / 8
    shares = {part: 40 * share / blocked["particles"] for part, share in blocked.items()}
    print({part: f"{blocked[part]:.2%} of the light, {shares[part]:.1f} to the lens' 40" for part in blocked})
    assert 25 < shares["cornea_cells"] < 30
    assert 9 < shares["vitreous_particles"] < 11.5
    assert sum(blocked.values()) == pytest.approx(aperture.blocked_share(Observer()), rel=0.1)
    assert {part: getattr(Observer(), part) for part in PARTS} == PARTS


@pytest.mark.parametrize("n", [256, 257, 300, 1001])
def test_any_grid_shows_the_same_eye(n: int) -> None:
    pose = Pose(5.0, openness=0.55, lashes=True, vitreous_deg=(2.0, -1.0), lens_m=STRAIN_M)
    shown = plane(pose, n, particles=1000, cornea_cells=5400, vitreous_particles=250)
    assert shown.shape == (n, n)
    assert shown.dtype == np.complex64
    fine = plane(pose, 1024, particles=1000, cornea_cells=5400, vitreous_particles=250)
    assert shown.real.mean(dtype=np.float64) == pytest.approx(fine.real.mean(dtype=np.float64), rel=2e-3)


@pytest.mark.slow
def test_the_finest_grid_has_room_for_everything() -> None:
    coarse, fine = (np.abs(plane(Pose(8.0), n, **PARTS)).mean(dtype=np.float64) for n in (2048, 4096))
    assert fine == pytest.approx(coarse, rel=1e-3)


def test_a_pupil_is_clamped_to_what_the_plane_holds() -> None:
    assert np.array_equal(plane(Pose(0.0), 256), plane(Pose(2.0), 256))
    assert np.array_equal(plane(Pose(11.0), 256), plane(Pose(8.0), 256))


def test_planes_apart_multiply_to_the_one_plane() -> None:
    pose = Pose(6.0, openness=0.6, vitreous_deg=(3.0, 1.0), lens_m=STRAIN_M)
    observer = Observer(gratings=0)
    first = aperture.placed(aperture.pupil_box(observer, pose, 512, vitreous_apart=True), 512)
    ((vitreous, distance_m),) = aperture.later_planes(observer, pose, 512)
    assert distance_m == 12e-3
    assert (first.dtype, vitreous.dtype) == (np.complex64, np.float32)
    assert np.abs(first * vitreous - aperture.pupil_plane(observer, pose, 512)).max() < 1e-6


def test_only_what_the_pupil_shows_is_worked_on() -> None:
    observer, pose = Observer(gratings=0), Pose(3.0, openness=0.6)
    box = aperture.pupil_box(observer, pose, 512)
    assert len(box) == 2 * math.ceil(1.5 / 9 * 512) + 1
    assert np.array_equal(aperture.placed(box, 512), aperture.pupil_plane(observer, pose, 512))


def test_what_moves_is_drawn_anew_and_what_does_not_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    observer = Observer(seed=77)
    calls = []
    whole = lens.fibres
    monkeypatch.setattr(lens, "fibres", lambda *args: calls.append(args) or whole(*args))
    at_rest = np.asarray(aperture.pupil_plane(observer, Pose(6.0), N))
    for pose in (Pose(6.0, lens_m=STRAIN_M), Pose(6.0, vitreous_deg=(1.0, 0.0)), Pose(6.0, openness=0.5)):
        assert not np.array_equal(np.asarray(aperture.pupil_plane(observer, pose, N)), at_rest)
    again = np.asarray(aperture.pupil_plane(observer, Pose(6.0, lens_m=np.zeros((17, 17))), N))
    assert np.abs(again - at_rest).max() < 1e-6
    assert len(calls) == 1


def test_the_same_observer_has_the_same_eye_and_another_seed_another() -> None:
    one, same, other = (
        np.asarray(aperture.pupil_plane(Observer(seed=s, gratings=0), Pose(5.0), 512)) for s in (0, 0, 1)
    )
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


@pytest.mark.parametrize("pupil_diameter_mm", [0.0, 0.5, -1.0, math.nan])
def test_a_pupil_too_narrow_or_none_is_the_narrowest(pupil_diameter_mm: float) -> None:
    assert Pose(pupil_diameter_mm).diameter_m == 2e-3


def test_an_eye_full_of_particles_is_refused_by_name() -> None:
    with pytest.raises(OpticsError, match="fewer or smaller"):
        aperture.pupil_plane(Observer(particles=20000, particle_mm=0.5, gratings=0), Pose(4.0), 256)
