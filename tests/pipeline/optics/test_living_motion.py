"""Oscillators, the lens' springs and the vitreous, against other ways to their motion."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from entoptic.pipeline.optics import OpticsError, lens_springs, vitreous_motion
from entoptic.pipeline.optics.damped import free_motion
from entoptic.pipeline.optics.lens_springs import LensState, radial_m
from entoptic.pipeline.optics.microfluctuations import Tones
from entoptic.pipeline.optics.vitreous_motion import SaccadeImpulse, VitreousState

ratios = st.one_of(
    st.floats(0.0, 8.0), st.sampled_from([1.0, math.nextafter(1.0, 0.0), math.nextafter(1.0, 2.0), 1 + 1e-9, 1 - 1e-9])
)


@given(ratios, st.floats(0.5, 20.0), st.floats(0.0, 3.0), st.floats(-5.0, 5.0), st.floats(-50.0, 50.0))
def test_free_motion_is_the_matrix_exponential_at_any_damping(
    ratio: float, omega: float, dt_s: float, position: float, velocity: float
) -> None:
    matrix = np.array([[0.0, 1.0], [-(omega**2), -2 * ratio * omega]])
    expected = expm(matrix * dt_s) @ np.array([position, velocity])
    got = free_motion(np.array(position), np.array(velocity), omega, ratio, dt_s)
    scale = abs(position) * max(omega, 1.0) + abs(velocity) + 1e-12
    assert got == pytest.approx(expected, rel=1e-9, abs=1e-9 * scale)


@given(ratios, st.floats(0.5, 500.0), st.floats(0.0, 1e9))
def test_free_motion_never_overflows_and_gains_no_energy(ratio: float, omega: float, dt_s: float) -> None:
    position, velocity = free_motion(np.array(1.0), np.array(1.0), omega, ratio, dt_s)
    assert np.isfinite(position)
    assert np.isfinite(velocity)
    assert (omega * position) ** 2 + velocity**2 <= (omega**2 + 1.0) * (1 + 1e-9)


# Springs between all neighbours, as stretches of springs by displacements of masses: another way to the same grid.


def stretches() -> np.ndarray:
    n = lens_springs.NODES
    place = np.array(list(itertools.product(range(n), range(n))))
    metres = place[:, ::-1] * np.array([lens_springs.RADIUS_M, lens_springs.THICKNESS_M]) / (n - 1)
    rows = []
    for one, other in itertools.combinations(range(n * n), 2):
        if np.abs(place[one] - place[other]).max() == 1:
            along = (metres[other] - metres[one]) / np.linalg.norm(metres[other] - metres[one])
            row = np.zeros((n * n, 2))
            row[one], row[other] = -along, along
            rows.append(row)
    return np.array(rows)


@pytest.fixture(scope="module")
def grid() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stiffness of the free coordinates, their coupling to the equator, and which they are of [mass, (r, z)]."""
    n = lens_springs.NODES
    springs = stretches()
    free = np.ones((n * n, 2), bool)
    free[::n, 0] = False
    equator = (n // 2) * n + n - 1
    free[equator] = False
    inside = springs[:, free]
    return inside.T @ inside, inside.T @ springs[:, equator, 0], free


def grid_of(values: np.ndarray, free: np.ndarray, equator: complex) -> np.ndarray:
    n = lens_springs.NODES
    full = np.zeros((n * n, 2), values.dtype)
    full[free] = values
    radial = full[:, 0].reshape(n, n)
    radial[n // 2, n - 1] = equator
    return radial


def constant(dioptres: float) -> Tones:
    return Tones(np.zeros(1), np.array([dioptres + 0j]))


def test_accommodation_that_stays_finds_the_springs_balance(grid: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    stiffness, coupling, free = grid
    expected = grid_of(np.linalg.solve(stiffness, -coupling), free, 1.0) * lens_springs.EQUATOR_M_PER_D
    got = radial_m(lens_springs.step(lens_springs.at_rest(), 0.0, 60.0, constant(1.0)), 1.0)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12)
    # Inwards, most at the equator, nothing on the axis, alike before and behind.
    assert got.max() <= 0.0
    assert np.unravel_index(got.argmin(), got.shape) == (8, 16)
    assert got[8, 16] == -33.5e-6
    np.testing.assert_array_equal(got[:, 0], 0.0)
    np.testing.assert_allclose(got, got[::-1], rtol=0, atol=1e-15)
    assert -25e-6 < got[8, 15] < -15e-6


def test_a_tone_that_lasts_has_the_grids_answer(grid: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    stiffness, coupling, free = grid
    squared, shapes = np.linalg.eigh(stiffness)
    moved = np.abs(shapes.T @ coupling) > 1e-9
    scale = (2 * math.pi * lens_springs.SLOWEST_HZ) ** 2 / squared[moved][0]
    omega = 2 * math.pi * 2.0
    root = shapes * np.sqrt(squared * scale) @ shapes.T
    moving = stiffness * scale - omega**2 * np.eye(len(squared)) + 2j * lens_springs.DAMPING_RATIO * omega * root
    expected = grid_of(np.linalg.solve(moving, -coupling * scale), free, 1.0) * lens_springs.EQUATOR_M_PER_D
    tone = Tones(np.array([omega]), np.ones(1, np.complex128))
    state = lens_springs.step(lens_springs.at_rest(), 0.0, 30.0, tone)
    later = lens_springs.step(state, 30.0, 1 / 8, tone)
    np.testing.assert_allclose(radial_m(state, 1.0), expected.real, rtol=0, atol=1e-11)
    np.testing.assert_allclose(radial_m(later, 0.0), -expected.imag, rtol=0, atol=1e-11)
    # It lags behind, which is what the model's latency says: some 40 ms.
    inside = expected[8, 8] / expected[8, 16]
    assert 0.03 < -np.angle(inside) / omega < 0.06


@given(st.lists(st.floats(0.0, 3.0), min_size=1, max_size=5), st.integers(0, 99))
def test_the_lens_is_the_same_in_one_step_as_in_many(parts_s: list[float], seed: int) -> None:
    random = np.random.default_rng(seed)
    tones = Tones(random.uniform(0.1, 14.0, 6), random.normal(size=6) + 1j * random.normal(size=6))
    rest = lens_springs.at_rest()
    start = LensState(rest.position + random.normal(size=rest.position.size) * 1e-5, rest.velocity)
    state, t_s = start, 7.0
    for part_s in parts_s:
        state, t_s = lens_springs.step(state, t_s, part_s, tones), t_s + part_s
    whole = lens_springs.step(start, 7.0, sum(parts_s), tones)
    np.testing.assert_allclose(state.position, whole.position, rtol=0, atol=1e-13)
    np.testing.assert_allclose(state.velocity, whole.velocity, rtol=0, atol=1e-11)


def swing(seconds: float, impulses: tuple[SaccadeImpulse, ...] = ()) -> tuple[float, float]:
    return vitreous_motion.step(vitreous_motion.step(VitreousState(), 0.0, impulses), seconds, ()).deg


def test_the_vitreous_stays_behind_and_comes_back_without_swinging_past() -> None:
    kick = SaccadeImpulse(10.0, -4.0)
    assert swing(0.0, (kick,)) == (-5.0, 2.0)
    way = [swing(t_s, (kick,))[0] for t_s in np.linspace(0.0, 6.0, 601)]
    assert all(before < after < 0.0 for before, after in itertools.pairwise(way))
    # Its latency: at a tenth after 1.1 s, at a hundredth after 2.0 s.
    assert way[100] < -0.5 < way[115]
    assert way[190] < -0.05 < way[210]
    assert swing(1e9, (kick,)) == (0.0, 0.0)


@given(st.lists(st.tuples(st.floats(0.0, 2.0), st.floats(-40, 40), st.floats(-40, 40)), max_size=5))
def test_kicks_add_up_and_know_when_they_were(impulses: list[tuple[float, float, float]]) -> None:
    together = vitreous_motion.step(
        VitreousState(), 2.0, [SaccadeImpulse(right, up, ago) for ago, right, up in impulses]
    )
    state, t_s = VitreousState(), 0.0
    for ago, right, up in sorted(impulses, reverse=True):
        state = vitreous_motion.step(state, 2.0 - ago - t_s, [SaccadeImpulse(right, up)])
        t_s = 2.0 - ago
    state = vitreous_motion.step(state, 2.0 - t_s, ())
    assert together.deg == pytest.approx(state.deg, abs=1e-9)
    assert together.deg_s == pytest.approx(state.deg_s, abs=1e-9)


@pytest.mark.parametrize(
    ("right", "up", "ago"), [(math.nan, 0, 0), (0, math.inf, 0), (181, 0, 0), (0, 0, -1e-9), (0, 0, math.nan)]
)
def test_a_kick_of_no_eye_is_named(right: float, up: float, ago: float) -> None:
    with pytest.raises(OpticsError, match="give"):
        SaccadeImpulse(right, up, ago)
