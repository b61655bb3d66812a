"""The lens as a grid of masses and springs that the ciliary muscle pulls at its equator (RIT 3.3, Fig. 4).

Theory of operation: half a section of the lens, 17 × 17 masses, each joined to its eight neighbours by springs that are
all alike. Masses on the optical axis stay on it; the one at the equator is where the muscle puts it; the others are
free to move along the radius and in depth. For displacements this small against the springs' lengths the forces are
linear. So the grid has modes, each a damped oscillator, found once; the muscle drives them by a sum of tones, to which
each mode answers by known tones of its own, and what is left dies away freely. Nothing is integrated by steps.

Modes that the muscle cannot move, all those that are not alike before and behind the equator's plane, are left out.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
from jaxtyping import Complex, Float

from entoptic.pipeline.optics.damped import free_motion
from entoptic.pipeline.optics.microfluctuations import Tones

NODES = 17
"""In each direction (RIT 3.3)."""
RADIUS_M = 4.665e-3
THICKNESS_M = 3.85e-3
"""Half the diameter, and the thickness at 30 years, of relaxed lenses in vivo (Jones, Atchison & Pope 2007, Optom. Vis.
Sci. 84, 990)."""
EQUATOR_M_PER_D = -33.5e-6
"""How far the equator moves for each dioptre more of accommodation: inwards, by half the 0.067 mm that the diameter
shrinks (Jones, Atchison & Pope 2007)."""
SLOWEST_HZ = 4.0
"""Of the modes that the muscle moves. Engineering choice: the lens then follows the fluctuations (to 2.1 Hz) with a lag
of some 40 ms, least near the equator."""
DAMPING_RATIO = 0.5
"""Of every mode. Engineering choice: the lens is a gel; it overshoots once and no more."""

_EQUATOR = (NODES // 2, NODES - 1)


@dataclasses.dataclass(frozen=True, eq=False)
class _Modes:
    omega_rad_s: Float[np.ndarray, "mode"]
    drive: Float[np.ndarray, "mode"]
    """Acceleration of each mode, m/s², for each metre that the equator moves."""
    radial: Float[np.ndarray, "node mode"]
    """Radial displacement of all masses but the driven one, row by row, by each mode."""


@functools.cache
def _modes() -> _Modes:
    stiffness = _stiffness()
    radial, depth = _degrees_of_freedom()
    equator = radial[_EQUATOR]
    held = {equator, depth[_EQUATOR], *radial[:, 0].tolist()}
    free = np.array([k for k in range(2 * NODES**2) if k not in held])
    squared, shapes = np.linalg.eigh(stiffness[np.ix_(free, free)])
    drive = -shapes.T @ stiffness[free, equator]
    moved = np.abs(drive) > 1e-9 * np.abs(drive).max()
    squared, drive, shapes = squared[moved], drive[moved], shapes[:, moved]
    # Only stiffness over mass matters: it is what makes the slowest mode as slow as it shall be.
    scale = (2 * math.pi * SLOWEST_HZ) ** 2 / float(squared[0])
    every = np.zeros((2 * NODES**2, len(squared)))
    every[free] = shapes
    return _Modes(np.sqrt(squared * scale), drive * scale, every[radial.ravel()])


def _degrees_of_freedom() -> tuple[np.ndarray, np.ndarray]:
    """The numbers of each mass's radial and depth coordinate."""
    numbers = np.arange(2 * NODES**2).reshape(NODES, NODES, 2)
    return numbers[..., 0], numbers[..., 1]


def _stiffness() -> Float[np.ndarray, "coordinate coordinate"]:
    """Force by displacement of the whole grid, for springs of stiffness 1 N/m, along each spring only."""
    radial, depth = _degrees_of_freedom()
    right_m, back_m = RADIUS_M / (NODES - 1), THICKNESS_M / (NODES - 1)
    stiffness = np.zeros((2 * NODES**2, 2 * NODES**2))
    for row in range(NODES):
        for column in range(NODES):
            for rows, columns in ((0, 1), (1, 0), (1, 1), (1, -1)):
                other = row + rows, column + columns
                if other[0] == NODES or not 0 <= other[1] < NODES:
                    continue
                along = np.array((columns * right_m, rows * back_m))
                along /= np.linalg.norm(along)
                ends = np.array((radial[row, column], depth[row, column], radial[other], depth[other]))
                stretch = np.concatenate((-along, along))
                stiffness[np.ix_(ends, ends)] += np.outer(stretch, stretch)
    return stiffness


@dataclasses.dataclass(frozen=True, eq=False)
class LensState:
    """How far each mode is from its rest, and how fast it goes."""

    position: Float[np.ndarray, "mode"]
    velocity: Float[np.ndarray, "mode"]


def at_rest() -> LensState:
    """A lens that nothing has moved yet."""
    nothing = np.zeros(len(_modes().omega_rad_s))
    return LensState(nothing, nothing)


@functools.lru_cache(maxsize=8)
def _answer(tones_rad_s: tuple[float, ...]) -> Complex[np.ndarray, "mode tone"]:
    """What each mode makes of tones that have long lasted, as a factor on each, in metres by dioptre."""
    modes = _modes()
    omega, tone = modes.omega_rad_s[:, None], np.array(tones_rad_s)[None, :]
    return EQUATOR_M_PER_D * modes.drive[:, None] / (omega**2 - tone**2 + 2j * DAMPING_RATIO * omega * tone)


def step(state: LensState, t_s: float, dt_s: float, tones_d: Tones) -> LensState:
    """The lens at `t_s` + `dt_s`, of `state` at `t_s`, driven by accommodation. Exact for any `dt_s` ≥ 0."""
    answer = _answer(tuple(tones_d.omega_rad_s.tolist()))
    position, velocity = _settled(answer, tones_d, t_s)
    left, left_velocity = free_motion(
        state.position - position, state.velocity - velocity, _modes().omega_rad_s, DAMPING_RATIO, dt_s
    )
    position, velocity = _settled(answer, tones_d, t_s + dt_s)
    return LensState(left + position, left_velocity + velocity)


def _settled(
    answer: Complex[np.ndarray, "mode tone"], tones: Tones, t_s: float
) -> tuple[Float[np.ndarray, "mode"], Float[np.ndarray, "mode"]]:
    """The modes as the tones alone would have them."""
    now = tones.at(t_s)
    both = _product(answer, np.stack((now, 1j * tones.omega_rad_s * now), axis=1)).real
    return both[:, 0], both[:, 1]


def _product(matrix: np.ndarray, other: np.ndarray) -> np.ndarray:
    """A matrix product without BLAS, whose threads cost more than so small a product where others use the machine."""
    product: np.ndarray = np.einsum("ij,j...->i...", matrix, other, optimize=False)
    return product


def radial_m(state: LensState, accommodation_d: float) -> Float[np.ndarray, "17 17"]:
    """Radial displacement of every mass, metres outwards: rows in depth, columns from the axis to the equator."""
    grid = _product(_modes().radial, state.position).reshape(NODES, NODES)
    grid[_EQUATOR] = EQUATOR_M_PER_D * accommodation_d
    return grid
