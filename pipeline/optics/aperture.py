"""The pupil plane: what of the light passes where, and how its phase is turned.

The plane is a square of `PLANE_M`, sampled n × n; sample i lies at (i − n/2)·dx, so the origin is a sample.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float
from scipy.special import j0, j1

from pipeline.observer import Observer
from pipeline.optics import OpticsError

PLANE_M = 9e-3
"""Side of the pupil plane: the widest pupil."""
PUPIL_RANGE_MM = (2.0, 8.0)
"""What a pupil is clamped to (LUI §5.2.1 ii)."""
FIBRE_PITCH_M = 10.85e-6
"""Spacing of the lens fibres: puts the lenticular halo at sin θ = λ/e, 3.00° at 568 nm (equations: SPE f3)."""
FIBRE_INNER_M = 1.5e-3
"""Nearer to the axis the fibre membranes have no contrast: no halo for pupils under 3 mm (RIT §3.2)."""
FIBRE_PHASE_RAD = 0.29
"""Phase amplitude of the fibres. Engineering choice: at a 7 mm pupil the first orders of the average eye then carry the
3.3 % of the light that SPE's scotopic f3 gives the halo. A patch has 2·(J1/J0)² = 4.3 % of its light in them, J1/J0 =
0.147; the patches, overlaps included, cover on average 0.97 of the annulus, which is 82 % of the pupil. By chance of
where the patches lie, twenty eyes measured 3.0–3.8 %."""
PATCH_M = 0.3e-3
"""Radius of one patch of parallel fibres. Engineering choice: 200 patches then cover the annulus about once, and each
spreads its spot by λ/0.6 mm = 0.05°, as far as two neighbouring spots lie apart, so that they close to a ring."""


def pupil_disc(diameter_m: Float[Array, ""] | float, n: int) -> Float[Array, "n n"]:
    """A clear pupil, 1 inside and 0 outside, its edge antialiased over one sample. JAX, differentiable."""
    dx = PLANE_M / n
    x = (jnp.arange(n, dtype=jnp.float32) - n // 2) * np.float32(dx)
    radius = jnp.hypot(x[:, None], x[None, :])
    return jnp.clip((diameter_m / 2 - radius) / dx + 0.5, 0, 1).astype(jnp.float32)


@functools.lru_cache(maxsize=4)
def eye_structure(observer: Observer, n: int) -> Complex[Array, "n n"]:
    """Complex transmittance of everything in this observer's eye but the pupil, 1 where light passes unhindered.

    Particles are opaque discs, uniformly over the plane's inscribed disc (LUI §5.2.1 i); gratings are patches of radial
    fibres outside 1.5 mm that turn the phase (RIT §3.2; transparent membranes, so a phase and no shadow). Of a grating
    the direct light and the first orders are kept: 1 + 2i·J1(a)/J0(a)·cos. The higher orders lie beyond the field of
    the grid and would fold back into it as corners of the halo.
    Raises OpticsError if the grid is too coarse for the fibres.
    """
    dx = PLANE_M / n
    if observer.gratings and dx > FIBRE_PITCH_M / 2:
        raise OpticsError(
            f"a {n}×{n} pupil plane has {dx * 1e6:.2f} µm a sample and lens fibres of "
            f"{FIBRE_PITCH_M * 1e6:.2f} µm pitch need two samples each: use 2048×2048, or an observer without gratings"
        )
    random = np.random.default_rng(observer.seed)
    blocked = _particles(observer, random, n)
    orders = 2 * j1(FIBRE_PHASE_RAD) / j0(FIBRE_PHASE_RAD) * _fibres(observer, random, n)
    return jnp.asarray(((1 - blocked) * (1 + 1j * orders)).astype(np.complex64))


def _particles(observer: Observer, random: np.random.Generator, n: int) -> np.ndarray:
    """Share of each sample that particles cover, in [0, 1]."""
    dx = PLANE_M / n
    radius = observer.particle_mm * 1e-3 / 2
    distance = PLANE_M / 2 * np.sqrt(random.random(observer.particles))
    azimuth = random.random(observer.particles) * 2 * np.pi
    covered = np.zeros((n, n), np.float32)
    half = int(np.ceil(radius / dx)) + 1
    offsets = np.arange(-half, half + 1)
    for x, y in zip(distance * np.cos(azimuth), distance * np.sin(azimuth), strict=True):
        column, row = round(x / dx) + n // 2, round(y / dx) + n // 2
        rows, columns = row + offsets, column + offsets
        rows, columns = rows[(rows >= 0) & (rows < n)], columns[(columns >= 0) & (columns < n)]
        away = np.hypot(((rows - n // 2) * dx - y)[:, None], ((columns - n // 2) * dx - x)[None, :])
        coverage = np.clip((radius - away) / dx + 0.5, 0, 1)
        patch = np.ix_(rows, columns)
        covered[patch] = np.maximum(covered[patch], coverage)
    return covered


def _fibres(observer: Observer, random: np.random.Generator, n: int) -> np.ndarray:
    """Sum of the patches' cosines at each sample."""
    dx = PLANE_M / n
    outer = PLANE_M / 2
    distance = np.sqrt(FIBRE_INNER_M**2 + (outer**2 - FIBRE_INNER_M**2) * random.random(observer.gratings))
    azimuth = random.random(observer.gratings) * 2 * np.pi
    shift = random.random(observer.gratings) * 2 * np.pi
    cosines = np.zeros((n, n), np.float32)
    half = int(np.ceil(PATCH_M / dx)) + 1
    offsets = np.arange(-half, half + 1)
    for r, angle, start in zip(distance, azimuth, shift, strict=True):
        x, y = r * np.cos(angle), r * np.sin(angle)
        rows, columns = round(y / dx) + n // 2 + offsets, round(x / dx) + n // 2 + offsets
        rows, columns = rows[(rows >= 0) & (rows < n)], columns[(columns >= 0) & (columns < n)]
        v, u = ((rows - n // 2) * dx)[:, None], ((columns - n // 2) * dx)[None, :]
        inside = np.clip((PATCH_M - np.hypot(v - y, u - x)) / dx + 0.5, 0, 1) * (np.hypot(v, u) >= FIBRE_INNER_M)
        along = -np.sin(angle) * u + np.cos(angle) * v
        cosines[np.ix_(rows, columns)] += inside * np.cos(2 * np.pi * along / FIBRE_PITCH_M + start)
    return cosines


@functools.partial(jax.jit, static_argnames="n")
def pupil_plane(structure: Complex[Array, "n n"], diameter_m: Float[Array, ""], n: int) -> Complex[Array, "n n"]:
    """The complex amplitude behind a pupil of this diameter in this eye."""
    return structure * pupil_disc(diameter_m, n)
