"""Light of radial densities: over the sphere, over a flat plane, over pixels, and over spatial frequencies.

A density is a function of the angle θ in degrees that gives sr⁻¹ and works on arrays of any shape. It may have a core
far narrower than a pixel on the axis; off the axis its features are at least FINEST_DEG wide. Beyond 90° there is no
light.

**Flat or sphere.** A kernel over pixels is flat: θ is the distance in pixels over the pixels per degree, and a ring has
the area 2πθ dθ; on the sphere it has 2π sinθ dθ. Within 9° the two differ by at most (9° in rad)²/6 = 0.4 % of the
light at the rim: a flat kernel cut at 9° holds 0.00003 more of all light than the sphere's cap with CIE 135 at 30
years, 0.0003 with SPE's widest term f2. Out to 90° the flat sums exceed 1 (f2's is 1.027), which is
why wide veils are summed over the sphere.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.special import j0

Angles = NDArray[np.float64]
Density = Callable[[Angles], Angles]

EDGE_DEG = 90.0
"""The hemisphere's edge."""
FINEST_DEG = 0.1
"""Off the axis, integrals along a pixel's edge have two nodes in this angle: the lenticular halo, the narrowest ring of
all, is 0.35° wide (SPE 3.1.1)."""

INNERMOST_DEG, PANELS, ORDER = 1e-6, 8192, 4
"""Integration goes over PANELS of equal ratio from INNERMOST_DEG to 90°, with ORDER Gauss–Legendre nodes in each.
Engineering choice: steps of 0.2 % follow the halo to 1e-8; half of CIE's core of 0.0046° has its own thousand steps."""
NEAR_PX, NEAR_NODES, NODES = 8, 32, 4
"""Nodes along a pixel's edge: more within NEAR_PX of the axis, where the azimuth turns within an edge. Engineering
choice: the error falls as 2.4^(−2·nodes) at the innermost edge and as (4·px)^(−2·nodes) further out, 1e-12 for both."""

ROUNDING = 1e-13
"""Light in a pixel below this is taken as none: it is the rounding of fluxes up to 1, and would be negative half of the
time. Engineering choice: ten times what the halo's empty middle shows; a dark eye's CIE at 90° has 1.6e-11 in a pixel
of 1/120°."""
SR_PER_DEG2 = math.radians(1) ** 2
"""Steradians in a square degree."""


@functools.cache
def _gauss_legendre(nodes: int) -> tuple[Angles, Angles]:
    """Nodes and weights on −½ … ½."""
    x, weights = np.polynomial.legendre.leggauss(nodes)
    return x / 2, weights / 2


def _flat(deg: Angles) -> Angles:
    """Radius of a flat ring in degrees."""
    return deg


def _sphere(deg: Angles) -> Angles:
    """Radius of a ring on the sphere in degrees."""
    return np.degrees(np.sin(np.radians(deg)))


def _edges_deg() -> Angles:
    return np.concatenate([[0.0], np.geomspace(INNERMOST_DEG, EDGE_DEG, PANELS + 1)])


def _light(density: Density, low_deg: Angles, high_deg: Angles, radius: Density) -> Angles:
    """Light of each ring between two angles so close to each other that one Gauss–Legendre rule holds."""
    x, weights = _gauss_legendre(ORDER)
    wide = (high_deg - low_deg)[..., None]
    deg = (low_deg + high_deg)[..., None] / 2 + wide * x
    return 2 * math.pi * SR_PER_DEG2 * (density(deg) * radius(deg) * wide) @ weights


def encircled(density: Density, deg: ArrayLike) -> Angles:
    """Light within angles from the axis, over the sphere."""
    edges = _edges_deg()
    within = np.concatenate([[0.0], np.cumsum(_light(density, edges[:-1], edges[1:], _sphere))])
    angle = np.clip(np.asarray(deg, np.float64), 0.0, EDGE_DEG)
    below = np.searchsorted(edges, angle, side="right") - 1
    return within[below] + _light(density, edges[below], angle, _sphere)


def hemisphere_volume(density: Density) -> float:
    """All light: 1 for a point-spread function that neither makes nor loses any."""
    return float(encircled(density, EDGE_DEG))


def hankel(density: Density, cpd: ArrayLike) -> Angles:
    """The modulation transfer function of a density at spatial frequencies in cycles per degree; at 0 its volume.

    Numerical, over the hemisphere: ∫ density(θ)·J0(2πνθ) 2π sinθ dθ, with at least one panel in each cycle.
    """
    frequencies = np.asarray(cpd, np.float64)
    coarse = _edges_deg()
    result = np.empty(frequencies.shape)
    for index, frequency in np.ndenumerate(frequencies):
        cycles = np.arange(0.0, EDGE_DEG, 0.5 / max(float(frequency), 1e-9))
        edges = np.union1d(np.append(coarse[:: 1 + len(coarse) // 4096], EDGE_DEG), cycles)

        def wave(deg: Angles, frequency: float = float(frequency)) -> Angles:
            return density(deg) * j0(2 * math.pi * frequency * deg)

        result[index] = _light(wave, edges[:-1], edges[1:], _sphere).sum()
    return result


def pixel_integrated(density: Density, ppd: float, rows_radius_px: int, columns_radius_px: int) -> NDArray[np.float64]:
    """Share of a point's light that each pixel around it gets, on a flat plane at `ppd` pixels per degree.

    The point is in the middle of the array's central pixel; the sides are 2·radius + 1. Pixels add up to
    the light of the area they cover, to 1e-6 of it and better, whatever the width of the core.

    A radial density f is the divergence of the field G(r)/r² · (x, y), where G(r) is the integral of f r dr. So a
    pixel's light is the field's flux through its four edges, and each edge is one integral of G over its azimuth; it
    never comes near the axis, where a core would have to be resolved. Of G only what lies beyond r is integrated: the
    rest is the same all round and leaves light only where the axis is inside.
    """
    edges = _edges_deg()
    rings = _light(density, edges[:-1], edges[1:], _flat) / (2 * math.pi)
    beyond = np.concatenate([np.cumsum(rings[::-1])[::-1], [0.0]])
    slope = -SR_PER_DEG2 * density(edges[1:]) * edges[1:] ** 2
    spline = CubicHermiteSpline(np.log(edges[1:]), beyond[1:], slope)

    def flux(across_px: int, along_px: int) -> Angles:
        """Of the light beyond each edge: edges at across + ½, from along − ½ to along + ½."""
        far = _flux(spline, ppd, np.arange(across_px + 1.0), np.arange(along_px + 1.0), _nodes(ppd, NODES))
        near = np.arange(min(across_px, NEAR_PX) + 1.0), np.arange(min(along_px, NEAR_PX) + 1.0)
        far[: len(near[0]), : len(near[1])] = _flux(spline, ppd, *near, _nodes(ppd, NEAR_NODES))
        return far

    right = flux(columns_radius_px, rows_radius_px)
    top = right if rows_radius_px == columns_radius_px else flux(rows_radius_px, columns_radius_px)
    # The edge left of the axis mirrors the one right of it.
    outwards = [np.diff(edge, axis=0, prepend=-edge[:1]) for edge in (right, top)]
    quarter = -(outwards[0].T + outwards[1])
    quarter[0, 0] += 2 * math.pi * beyond[0]
    quarter[np.abs(quarter) < ROUNDING] = 0
    half = np.concatenate([quarter[:0:-1], quarter])
    return np.concatenate([half[:, :0:-1], half], axis=1)


def _nodes(ppd: float, least: int) -> int:
    return max(least, math.ceil(2 / (FINEST_DEG * ppd)))


def _flux(spline: CubicHermiteSpline, ppd: float, across: Angles, along: Angles, nodes: int) -> Angles:
    x, weights = _gauss_legendre(nodes)
    result = np.zeros((len(across), len(along)))
    distance = across[:, None] + 0.5
    # One node at a time: a node of all edges is as much memory as the kernel.
    for offset, weight in zip(x, weights, strict=True):
        squared = distance**2 + (along + offset) ** 2
        logarithm = np.minimum(0.5 * np.log(squared) - math.log(ppd), math.log(EDGE_DEG))
        result += weight * distance / squared * spline(logarithm)
    return result
