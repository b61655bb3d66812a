"""The sphere of particles behind the lens."""

import numpy as np
import pytest

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import coverage, vitreous


def shadows(observer: Observer, deg: tuple[float, float], monkeypatch: pytest.MonkeyPatch) -> tuple[np.ndarray, ...]:
    """Places x, y and radii of the discs that the vitreous would draw, in metres."""
    drawn: list[tuple[np.ndarray, ...]] = []
    monkeypatch.setattr(coverage, "shade_discs", lambda *args: drawn.append(args[2:]))
    vitreous.shade(np.ones((2, 2), np.float32), 1e-3, observer, deg)
    return drawn[0]


def test_the_front_turns_to_the_right_and_up() -> None:
    front = np.array([0.0, 0.0, -1.0])  # right, down, backward
    assert vitreous.turn((90.0, 0.0)) @ front == pytest.approx([1, 0, 0])
    assert vitreous.turn((0.0, 90.0)) @ front == pytest.approx([0, -1, 0])
    turn = vitreous.turn((20.0, -35.0))
    assert turn @ turn.T == pytest.approx(np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1)


@pytest.mark.parametrize("deg", [(0.0, 0.0), (40.0, 0.0), (-15.0, 70.0)])
def test_as_many_particles_lie_before_the_plane_however_it_is_turned(
    deg: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    x, y, _ = shadows(Observer(vitreous_particles=5000), deg, monkeypatch)
    assert np.count_nonzero(np.hypot(x, y) < coverage.PLANE_M / 2) == pytest.approx(5000, rel=0.05)
    assert np.hypot(x, y).max() <= vitreous.RADIUS_M


def test_particles_at_different_depths_move_differently(monkeypatch: pytest.MonkeyPatch) -> None:
    """Turned right by an angle, each moves by its depth times that angle: half of them the other way, none up."""
    before = shadows(Observer(vitreous_particles=5000), (0.0, 0.0), monkeypatch)
    after = shadows(Observer(vitreous_particles=5000), (0.1, 0.0), monkeypatch)
    moved = after[0] - before[0]
    angle = np.radians(0.1)
    assert np.array_equal(after[1], before[1])
    assert np.abs(moved).max() <= vitreous.RADIUS_M * angle
    assert moved.std() == pytest.approx(vitreous.RADIUS_M / 5**0.5 * angle, rel=0.02)
    assert np.median(moved) == pytest.approx(0, abs=0.02 * vitreous.RADIUS_M * angle)


def test_some_leave_the_pupil_and_others_appear(monkeypatch: pytest.MonkeyPatch) -> None:
    within = [np.hypot(*shadows(Observer(), deg, monkeypatch)[:2]) < 2e-3 for deg in ((0.0, 0.0), (5.0, 0.0))]
    assert np.any(within[0] & ~within[1])
    assert np.any(within[1] & ~within[0])
