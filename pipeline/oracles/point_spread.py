"""Analytic point-spread functions in sr⁻¹, written down from the papers, each scaled to 1 over the hemisphere.

They share nothing with optics/analytic.py: another order of terms, and an integral of their own.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Density = Callable[[Reals], Reals]
"""Of angles in degrees from the light, in sr⁻¹. Beyond 90° it is 0."""

FINEST_DEG = 1e-7
"""Where the integrals' logarithmic steps begin. Engineering choice: far within the narrowest core, CIE's of 0.0046°."""
PER_DECADE = 400
"""Gauss–Legendre panels. Engineering choice: integrals to 1e-12."""
PANEL = np.polynomial.legendre.leggauss(4)


def radial_edges() -> Reals:
    """Edges of the panels that integrals over the angle are summed from, in degrees: 0 to 90."""
    decades = math.log10(90 / FINEST_DEG)
    return np.concatenate([[0.0], np.geomspace(FINEST_DEG, 90, math.ceil(decades * PER_DECADE) + 1)])


def per_panel(density: Density) -> Reals:
    """The share of the light in each panel of `radial_edges`: 2π ∫ K(θ) sin θ dθ."""
    edges = radial_edges()
    half, middle = np.diff(edges) / 2, (edges[1:] + edges[:-1]) / 2
    deg = middle[:, None] + half[:, None] * PANEL[0]
    ring = 2 * math.pi * np.sin(np.radians(deg)) * density(deg) * math.radians(1)
    return np.asarray((ring @ PANEL[1]) * half)


def _unit(printed: Density) -> Density:
    volume = float(per_panel(printed).sum())
    return lambda deg: np.asarray(np.where(deg <= 90, printed(deg) / volume, 0.0))


@functools.cache
def cie135(age_years: float, pigmentation: float) -> Density:
    """CIE 135's total glare, Vos and van den Berg 1999; pigmentation 0 dark, 0.5 brown, 1 green, 1.2 light blue."""
    older = (age_years / 70) ** 4

    def printed(deg: Reals) -> Reals:
        wide = 1 + (deg / 0.1) ** 2
        lens = 400 / wide + 3e-8 * deg**2
        pigment = 1300 / wide**1.5 + 0.8 / np.sqrt(wide)
        sharp = 9.2e6 / (1 + (deg / 0.0046) ** 2) ** 1.5 + 1.5e5 / (1 + (deg / 0.045) ** 2) ** 1.5
        even = 2.5e-3 * pigmentation
        return np.asarray((1 - 0.08 * older) * sharp + (1 + 1.6 * older) * (lens + pigmentation * pigment) + even)

    return _unit(printed)


@functools.cache
def ijspeert(pupil_diameter_mm: float, age_years: float, straylight: float) -> Density:
    """IJspeert, van den Berg and Spekreijse 1993; straylight m 0.142 mean, 0.16 blue, 0.106 brown, 0.056 dark."""
    age_factor = 1 + (age_years / 70) ** 4
    odds = 1 / straylight - 1
    small, large = 1 / (1 + age_factor / odds), 1 / (1 + odds / age_factor)
    wider = (pupil_diameter_mm / 3.2) ** 2
    b = 9000 - 936 * math.sqrt(age_factor)
    shares = [small / (1 + wider), small / (1 + 1 / wider), large / ((1 + 25 * straylight) * (1 + 1 / age_factor))]
    shares.append(large - shares[2])
    widths = [
        (1 + wider) / (b * pupil_diameter_mm),
        (1 + 1 / wider) * (math.sqrt(age_factor) / 2000 - 1 / (b * pupil_diameter_mm)),
        1 / (10 + 60 * straylight - 5 / age_factor),
        1.0,
    ]

    def printed(deg: Reals) -> Reals:
        sine2 = np.sin(np.radians(deg)) ** 2
        total = np.zeros_like(deg)
        for share, width in zip(shares, widths, strict=True):
            total += share * width / (2 * math.pi) / (sine2 + width**2 * (1 - sine2)) ** 1.5
        return total

    return _unit(printed)


def _spe_terms() -> tuple[Density, ...]:
    return (
        lambda deg: 2.61e6 * np.exp(-((deg / 0.02) ** 2)),
        lambda deg: 20.91 / (deg + 0.02) ** 3,
        lambda deg: 72.37 / (deg + 0.02) ** 2,
        lambda deg: spe_halo(deg, 568.0),
    )


def spe_halo(deg: Reals, nm: float) -> Reals:
    """SPE's lenticular halo of one wavelength, as printed."""
    return np.asarray(436.9 * (568 / nm) * np.exp(-19.75 * (deg - 3 * nm / 568) ** 2))


SPE_WEIGHTS = {
    "photopic": (0.384, 0.478, 0.138, 0.0),
    "mesopic": (0.368, 0.478, 0.138, 0.016),
    "scotopic": (0.282, 0.478, 0.207, 0.033),
}
"""Spencer, Shirley, Zimmerman and Greenberg 1995, eqs. 5–7, of f0 to f3."""


@functools.cache
def spe(adaptation: str, age_years: float | None = None) -> Density:
    """Spencer et al. 1995, the halo that of 568 nm; an age applies to photopic vision alone."""
    weights = list(SPE_WEIGHTS[adaptation])
    if age_years is not None:
        weights[0] -= 6.9e-9 * age_years**4
        weights[2] += 6.9e-9 * age_years**4
    terms = _spe_terms()

    def printed(deg: Reals) -> Reals:
        return np.asarray(sum(weight * term(deg) for weight, term in zip(weights, terms, strict=True)))

    return _unit(printed)
