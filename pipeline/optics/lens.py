"""The lens: particles in its body, which move as it deforms, and the fibres of its cortex, which make the halo.

Only the particles follow the deformation (RIT 3.3). The fibres stay: some tens of µm move none of their orders, whose
angle is the pitch's, and shift only the phase of one patch against another within a ring of 200 spots. So the costliest
part of the plane is drawn once.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.ndimage import map_coordinates
from scipy.special import j0, j1, ndtr

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import OpticsError, coverage, lens_springs

RADIUS_M = coverage.PLANE_M / 2
"""How far out particles and fibres lie: all that the widest pupil shows."""
FIBRE_PITCH_M = 10.85e-6
"""Spacing of the lens fibres: puts the lenticular halo at sin θ = λ/e, 3.00° at 568 nm (equations: SPE f3)."""
FIBRE_INNER_M = 1.5e-3
"""Nearer to the axis the fibre membranes have no contrast: no halo for pupils under 3 mm (RIT 3.2)."""
FIBRE_PHASE_RAD = 0.29
"""Phase amplitude of the fibres. Engineering choice: at a 7 mm pupil the first orders of the average eye then carry the
3.3 % of the light that SPE's scotopic f3 gives the halo. A patch has 2·(J1/J0)² = 4.3 % of its light in them, J1/J0 =
0.147; the patches, overlaps included, cover on average 0.97 of the annulus, which is 82 % of the pupil. By chance of
where the patches lie, twenty eyes measured 2.9–3.6 %, 3.26 % on average."""
PATCH_M = 0.3e-3
"""Radius of one patch of parallel fibres. Engineering choice: 200 patches then cover the annulus about once, and each
spreads its spot by λ/0.6 mm = 0.05°, as far as two neighbouring spots lie apart, so that they close to a ring."""
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
    """Puts the lens' particles before the plane, in place: opaque discs (LUI 5.2.1 i).

    At rest they lie uniformly over the plane's inscribed disc, and uniformly in depth. `lens_m` is the deformed lens'
    radial displacement in metres, outward positive, on a grid of depth (rows, share of the lens' thickness) and radius
    (columns, share of `lens_springs.RADIUS_M`); a particle takes it bilinearly at its own depth and radius, its azimuth
    stays.
    """
    random = np.random.default_rng([observer.seed, STREAM])
    radius = np.sqrt(random.random(observer.particles))
    azimuth, depth = random.random(observer.particles) * 2 * np.pi, random.random(observer.particles)
    diameter_m = diameters_m(observer, random.standard_normal(observer.particles))
    distance_m = RADIUS_M * radius
    if lens_m is not None:
        rows, columns = lens_m.shape
        place = [depth * (rows - 1), distance_m / lens_springs.RADIUS_M * (columns - 1)]
        distance_m = distance_m + map_coordinates(lens_m, place, order=1)
    coverage.shade_discs(
        transmittance, dx_m, distance_m * np.cos(azimuth), distance_m * np.sin(azimuth), diameter_m / 2
    )


def fibres(observer: Observer, n: int) -> Float[np.ndarray, "n n"]:
    """What the fibres add to the plane's transmittance, as its imaginary part, float32.

    They are patches of radial fibres outside 1.5 mm: transparent membranes, so a phase and no shadow (RIT 3.2). Of a
    grating the direct light and the first orders are kept: 1 + 2i·J1(a)/J0(a)·cos. The higher orders lie beyond the
    field of the grid and would fold back into it as corners of the halo.
    Raises OpticsError if the grid is too coarse for the fibres.
    """
    dx_m = coverage.PLANE_M / n
    added = np.zeros((n, n), np.float32)
    if not observer.gratings:
        return added
    if dx_m > FIBRE_PITCH_M / 2:
        raise OpticsError(
            f"a {n}×{n} pupil plane has {dx_m * 1e6:.2f} µm a sample and lens fibres of "
            f"{FIBRE_PITCH_M * 1e6:.2f} µm pitch need two samples each: use 2048×2048, or an observer without gratings"
        )
    random = np.random.default_rng([observer.seed, FIBRE_STREAM])
    inner_share = (FIBRE_INNER_M / RADIUS_M) ** 2
    distance_m = RADIUS_M * np.sqrt(inner_share + (1 - inner_share) * random.random(observer.gratings))
    azimuth, phase = random.random((2, observer.gratings)) * 2 * np.pi
    across, along = np.cos(azimuth), np.sin(azimuth)
    radius_m = np.full(observer.gratings, PATCH_M)
    for patches in coverage.disc_patches(distance_m * across, distance_m * along, radius_m, n, dx_m):
        index, share, patch = coverage.on_grid(patches, n)
        row, column = np.divmod(index, n)
        beside_m = (across[patch] * (row - n // 2) - along[patch] * (column - n // 2)) * dx_m
        cosine = np.cos(2 * np.pi / FIBRE_PITCH_M * beside_m + phase[patch])
        np.add.at(added.reshape(-1), index, (share * cosine).astype(np.float32))
    added *= np.float32(2 * j1(FIBRE_PHASE_RAD) / j0(FIBRE_PHASE_RAD))
    return added * (1 - coverage.disc(2 * FIBRE_INNER_M, n, dx_m))
