"""Point-spread functions from the papers, of unit volume over the hemisphere, for the direct sum.

CIE 135/1 and Vos 2003, IJspeert 1993, Spencer 1995 without its flare lines; and wave optics' as it was sampled. Angles
in degrees, densities in sr⁻¹.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.oracles.sphere import SPLIT_DEG, Function

Reals = NDArray[np.float64]
Radial = Callable[[Reals], Reals]

EDGE_DEG = 90.0
NODES = 40_000
"""Of integrals over the angle, even in its logarithm from INNERMOST_DEG."""
INNERMOST_DEG = 1e-6


def cie135(age_years: float, pigmentation: float) -> Radial:
    """Vos 2003, equation 8, as printed: its volume is near 1."""
    a4 = (age_years / 70) ** 4
    p = pigmentation

    def density(deg: Reals) -> Reals:
        core = 9.2e6 / (1 + (deg / 0.0046) ** 2) ** 1.5 + 1.5e5 / (1 + (deg / 0.045) ** 2) ** 1.5
        wide = 1 + (deg / 0.1) ** 2
        pigment = p * (1300 / wide**1.5 + 0.8 / wide**0.5)
        return np.asarray((1 - 0.08 * a4) * core + (1 + 1.6 * a4) * (400 / wide + 3e-8 * deg**2 + pigment) + 2.5e-3 * p)

    return density


def ijspeert(pupil_diameter_mm: float, age_years: float, m: float) -> Radial:
    """IJspeert, van den Berg, Spekreijse 1993: four terms c·β/[2π(sin²φ + β²cos²φ)^1.5]."""
    p, af, d = pupil_diameter_mm, 1 + (age_years / 70) ** 4, 3.2
    small = 1 / (1 + af / (1 / m - 1))
    large = 1 / (1 + (1 / m - 1) / af)
    b, e = 9000 - 936 * math.sqrt(af), math.sqrt(af) / 2000
    wide = large / ((1 + 25 * m) * (1 + 1 / af))
    terms = (
        (small / (1 + (p / d) ** 2), (1 + (p / d) ** 2) / (b * p)),
        (small / (1 + (d / p) ** 2), (1 + (d / p) ** 2) * (e - 1 / (b * p))),
        (wide, 1 / (10 + 60 * m - 5 / af)),
        (large - wide, 1.0),
    )

    def density(deg: Reals) -> Reals:
        sine, cosine = np.sin(np.radians(deg)), np.cos(np.radians(deg))
        parts = [c * beta / (2 * math.pi * (sine**2 + beta**2 * cosine**2) ** 1.5) for c, beta in terms]
        return np.asarray(sum(parts))

    return density


def alike(density: Radial) -> Function:
    """A function of the angle alone, made of unit volume; 0 beyond 90°."""
    beyond = _beyond(density)
    volume = float(beyond(np.zeros(1))[0])

    def far(deg: Reals) -> Reals:
        return np.where(deg <= EDGE_DEG, density(np.minimum(deg, EDGE_DEG)), 0) / volume

    return Function(
        lambda deg, azimuth: far(np.maximum(deg, INNERMOST_DEG))[None, None],
        far,
        lambda deg: (beyond(deg) / volume)[None, None],
    )


def sampled(
    cells: NDArray[np.floating], cell_deg: float, core: NDArray[np.floating], core_deg: float, wide: Radial
) -> Function:
    """A function given as the light in square cells (o, i, k, k) around its axis, and by a formula beyond SPLIT_DEG.

    `core` is the same in smaller cells as far as they reach. `wide` has the unit that makes its volume 1 over all.
    """

    def look_up(of: NDArray[np.floating], side_deg: float) -> Callable[[Reals, Reals], Reals]:
        side = of.shape[-1]
        cells = np.moveaxis(of, (0, 1), (2, 3)).reshape(side * side, -1) / np.radians(side_deg) ** 2

        def at(deg: Reals, azimuth: Reals) -> Reals:
            y, x = (deg * turned / side_deg + side // 2 for turned in (np.sin(azimuth), np.cos(azimuth)))
            low_y, low_x = (np.clip(np.floor(place).astype(int), 0, side - 2) for place in (y, x))
            dy, dx = (np.clip(place - low, 0, 1)[:, None] for place, low in ((y, low_y), (x, low_x)))
            first = low_y * side + low_x
            above = cells[first] * (1 - dx) + cells[first + 1] * dx
            below = cells[first + side] * (1 - dx) + cells[first + side + 1] * dx
            return np.asarray((above * (1 - dy) + below * dy).T.reshape(*of.shape[:2], -1))

        return at

    in_cells, in_core = look_up(cells, cell_deg), look_up(core, core_deg)
    inner = (core.shape[-1] // 2 - 1) * core_deg

    def near(deg: Reals, azimuth: Reals) -> Reals:
        found = in_cells(deg, azimuth)
        inside = deg < inner
        found[:, :, inside] = in_core(deg[inside], azimuth[inside])
        return found

    far_beyond = _beyond(wide)
    offset = (np.arange(cells.shape[-1]) - cells.shape[-1] // 2) * cell_deg
    outer_deg = np.hypot(offset[:, None], offset)
    offset = (np.arange(core.shape[-1]) - core.shape[-1] // 2) * core_deg
    inner_deg = np.hypot(offset[:, None], offset)
    outside = (outer_deg >= inner) & (outer_deg < SPLIT_DEG)
    steps = np.concatenate([np.linspace(0, inner, 200), np.linspace(inner, SPLIT_DEG, 800)[1:]])
    further = float(far_beyond(np.array([SPLIT_DEG]))[0])

    def table(o: int, i: int) -> Reals:
        order = np.searchsorted(steps, np.concatenate([inner_deg[inner_deg < inner], outer_deg[outside]]))
        light = np.concatenate([core[o, i][inner_deg < inner], cells[o, i][outside]])
        of_step = np.bincount(order, light, len(steps) + 1)
        return np.asarray(of_step[::-1].cumsum()[::-1][1:] + (further if o == i else 0))

    tables = np.array([[table(o, i) for i in range(cells.shape[1])] for o in range(cells.shape[0])])
    return Function(
        near,
        lambda deg: np.where(deg <= EDGE_DEG, wide(deg), 0),
        lambda deg: np.array([[np.interp(deg, steps, one) for one in of] for of in tables]),
    )


def _beyond(density: Radial) -> Radial:
    """How much light goes further than an angle."""
    edges = np.concatenate([[0.0], np.geomspace(INNERMOST_DEG, EDGE_DEG, NODES)])
    low, high = np.radians(edges[:-1]), np.radians(edges[1:])
    # Three nodes of Gauss and Legendre in each step.
    nodes, weights = (0.5 - math.sqrt(0.15), 0.5, 0.5 + math.sqrt(0.15)), (5 / 18, 8 / 18, 5 / 18)
    light = sum(
        weight * density(np.degrees(low + (high - low) * node)) * np.sin(low + (high - low) * node)
        for node, weight in zip(nodes, weights, strict=True)
    )
    of_step = 2 * math.pi * np.asarray(light) * (high - low)
    further = np.concatenate([of_step[::-1].cumsum()[::-1], [0.0]])
    return lambda deg: np.interp(deg, edges, further)
