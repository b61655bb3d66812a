"""The lens: particles in its body, which move as it deforms, and the fibres of its cortex, which make the halo.

Only the particles follow the deformation (RIT 3.3). The fibres stay: some tens of µm move none of their orders, whose
angle is the pitch's, and shift only the phase of one patch against another within a ring of 200 spots. So the costliest
part of the plane is drawn once.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from jaxtyping import Float
from scipy.ndimage import map_coordinates
from scipy.special import ndtr

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import OpticsError, coverage, lens_springs

RADIUS_M = coverage.PLANE_M / 2
"""How far out particles and fibres lie: all that the widest pupil shows."""
FIBRE_PITCH_M = 10.85e-6
"""Spacing of the lens fibres: puts the lenticular halo at sin θ = λ/e, 3.00° at 568 nm (equations: SPE f3)."""
FIBRE_INNER_M = 1.5e-3
"""Nearer to the axis the fibre membranes have no contrast: no halo for pupils under 3 mm (RIT 3.2)."""
FIBRE_AMPLITUDE = 0.57
"""Amplitude a of a patch's grating, which is 1 + i·a·cos in its middle. Engineering choice: at a 7 mm pupil the first
orders of the average eye then carry the 3.3 % of the light that SPE's scotopic f3 gives the halo."""
PATCH_M = 23.0e-6
"""Standard deviation of a patch of parallel fibres, a Gaussian: it spreads its spots by exp(−19.75 θ²), as wide as
SPE's f3 makes the halo. So many of them lie behind any pupil that their spots close to a ring."""
PATCH_REACH = 3.0
"""Standard deviations at which a patch ends: 1 % of its middle. Engineering choice."""
SPREAD_LIMIT = 2.5
"""Where the log-normal spread of diameters is cut, in standard deviations. Engineering choice: 1.2 % of the particles
are drawn at the limit, and the widest is 12 times the median at a spread of 1, not 50 times."""
STREAM = 2
FIBRE_STREAM = 3
"""Which random streams are the lens', so that no other part changes them."""


def diameters_m(observer: Observer, deviates: Float[np.ndarray, " particle"]) -> Float[np.ndarray, " particle"]:
    """Diameters of particles from standard normal deviates: log-normal about the observer's median."""
    spread = np.clip(deviates, -SPREAD_LIMIT, SPREAD_LIMIT) * observer.particle_spread
    return np.asarray(observer.particle_mm * 1e-3 * np.exp(spread))


def mean_square_of_spread(spread: float) -> float:
    """Mean of the squared diameters over the squared median."""
    cut = SPREAD_LIMIT
    within = np.exp(2 * spread**2) * (ndtr(cut - 2 * spread) - ndtr(-cut - 2 * spread))
    return float(within + (np.exp(2 * spread * cut) + np.exp(-2 * spread * cut)) * ndtr(-cut))


def shade(
    transmittance: Float[np.ndarray, "n n"],
    dx_m: float,
    observer: Observer,
    lens_m: Float[np.ndarray, "17 17"] | None = None,
) -> None:
    """Puts the lens' particles before the plane, in place: opaque discs (LUI 5.2.1 i)."""
    stream = observer.seed, STREAM
    x_m, y_m = places_m(stream, observer.particles, lens_m)
    *_, deviates = _body(stream, observer.particles)
    coverage.shade_discs(transmittance, dx_m, x_m, y_m, diameters_m(observer, deviates) / 2)


def places_m(
    stream: tuple[int, ...], count: int, lens_m: Float[np.ndarray, "17 17"] | None = None
) -> tuple[Float[np.ndarray, " particle"], Float[np.ndarray, " particle"]]:
    """Places right of and below the axis, from a random stream.

    At rest they lie uniformly over the plane's inscribed disc, and uniformly in depth. `lens_m` is the deformed lens'
    radial displacement in metres, outward positive, on a grid of depth (rows, share of the lens' thickness) and radius
    (columns, share of `lens_springs.RADIUS_M`); a particle takes it bilinearly at its own depth and radius, its azimuth
    stays.
    """
    distance_m, right, down, depth, _ = _body(stream, count)
    if lens_m is not None:
        rows, columns = lens_m.shape
        place = [depth * (rows - 1), distance_m / lens_springs.RADIUS_M * (columns - 1)]
        distance_m = distance_m + map_coordinates(lens_m, place, order=1)
    return distance_m * right, distance_m * down


@functools.lru_cache(maxsize=4)
def _body(stream: tuple[int, ...], count: int) -> tuple[Float[np.ndarray, " particle"], ...]:
    """Of each particle at rest its distance from the axis in metres, its direction, its depth and a normal deviate."""
    random = np.random.default_rng(stream)
    radius = np.sqrt(random.random(count))
    azimuth, depth = random.random(count) * 2 * np.pi, random.random(count)
    return RADIUS_M * radius, np.cos(azimuth), np.sin(azimuth), depth, random.standard_normal(count)


def fibres(observer: Observer, n: int) -> Float[np.ndarray, "n n"]:
    """What the fibres add to the plane's transmittance, as its imaginary part, float32.

    They are radial fibres outside 1.5 mm, in patches within which they are straight: transparent membranes, so a phase
    and no shadow (RIT 3.2). Of a grating the direct light and the first orders are kept: 1 + i·a·cos. The higher orders
    lie beyond the field of the grid and would fold back into it as corners of the halo.
    Raises OpticsError if the grid is too coarse for the fibres.
    """
    dx_m = coverage.PLANE_M / n
    if not observer.gratings:
        return np.zeros((n, n), np.float32)
    if dx_m > FIBRE_PITCH_M / 2:
        raise OpticsError(
            f"a {n}×{n} pupil plane has {dx_m * 1e6:.2f} µm a sample and lens fibres of "
            f"{FIBRE_PITCH_M * 1e6:.2f} µm pitch need two samples each: use 2048×2048, or an observer without gratings"
        )
    random = np.random.default_rng([observer.seed, FIBRE_STREAM])
    inner_share = (FIBRE_INNER_M / RADIUS_M) ** 2
    distance_m = RADIUS_M * np.sqrt(inner_share + (1 - inner_share) * random.random(observer.gratings))
    azimuth, phase = random.random((2, observer.gratings)) * 2 * np.pi
    reach = math.ceil(PATCH_REACH * PATCH_M / dx_m)
    added = np.zeros((n + 2 * reach + 1, n + 2 * reach + 1), np.float32)
    offset = np.arange(-reach, reach + 1)

    def along(place_m: Float[np.ndarray, " patch"], turn: Float[np.ndarray, " patch"]) -> tuple[np.ndarray, np.ndarray]:
        """The nearest sample, and a patch's wave along one axis of the grid."""
        sample = np.rint(place_m / dx_m).astype(int)
        beside_m = (sample[:, None] + offset) * dx_m - place_m[:, None]
        wave = 2j * np.pi / FIBRE_PITCH_M * turn[:, None] * beside_m - (beside_m / PATCH_M) ** 2 / 2
        return sample + n // 2, np.exp(wave).astype(np.complex64)

    # Waves run across the fibres, along the circle around the axis; a Gaussian patch is a product of row and column.
    column, across = along(distance_m * np.cos(azimuth), -np.sin(azimuth))
    row, down = along(distance_m * np.sin(azimuth), np.cos(azimuth))
    down *= np.exp(1j * phase).astype(np.complex64)[:, None]
    side = 2 * reach + 1
    for top, left, y, x in zip(row, column, down, across, strict=True):
        added[top : top + side, left : left + side] += np.outer(y.real, x.real) - np.outer(y.imag, x.imag)
    added = added[reach : reach + n, reach : reach + n] * np.float32(FIBRE_AMPLITUDE)
    return added * (1 - coverage.disc(2 * FIBRE_INNER_M, n, dx_m))
