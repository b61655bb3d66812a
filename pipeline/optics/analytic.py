"""Point-spread functions measured on people, as closed formulas of the angle θ in degrees, in sr⁻¹.

SPE's is the sum of a core f0, two scattering terms f1 and f2 and the lenticular halo f3, each of unit volume over the
hemisphere; adaptation and age set their weights (SPE §3.1, eqs 5–10, with the errata E7 of the papers mended).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

HALO_NM = (611.0, 549.0, 464.0)
"""Wavelength that stands for each linear Rec.709 channel in the halo: the primaries' dominant wavelengths."""
PHOTOPIC, MESOPIC, SCOTOPIC = (
    np.array([0.384, 0.478, 0.138, 0.0]),
    np.array([0.368, 0.478, 0.138, 0.016]),
    np.array([0.282, 0.478, 0.207, 0.033]),
)
"""Weights of f0 … f3 (SPE eqs 8–10)."""
PHOTOPIC_CD_M2, SCOTOPIC_CD_M2 = 3.0, 0.01
"""Adaptation above which only cones, below which only rods work (SPE §2.2)."""

NEAR_PX, POINTS = 6, 150
"""Pixels this near the axis are the mean of POINTS² points each: f0's width, 0.02°, is 15 points at 5 pixels per degree
and one at 0.33, below which f0 and f1 lose light."""

Angles = NDArray[np.float64]


def f0(deg: Angles) -> Angles:
    """The core."""
    return 2.61e6 * np.exp(-((deg / 0.02) ** 2))


def f1(deg: Angles) -> Angles:
    """Narrow scattering."""
    return 20.91 / (deg + 0.02) ** 3


def f2(deg: Angles) -> Angles:
    """Wide scattering."""
    return 72.37 / (deg + 0.02) ** 2


def f3(deg: Angles, wavelength_nm: float) -> Angles:
    """The lenticular halo, at 3° for 568 nm (E7: with 19.75 in the exponent its volume is 1)."""
    return 436.9 * (568 / wavelength_nm) * np.exp(-19.75 * (deg - 3 * wavelength_nm / 568) ** 2)


def spe_weights(adapted_cd_m2: float, age_years: float) -> NDArray[np.float64]:
    """Weights of f0 … f3 for a state of adaptation and an age.

    SPE gives three states; between them the weights go linearly with the log of the luminance, so that nothing jumps.
    Age moves light from the core to the wide term in photopic vision (SPE eq. 10b), until at 86 years none is left.
    """
    moved = min(6.9e-9 * age_years**4, float(PHOTOPIC[0]))
    aged = PHOTOPIC + moved * np.array([-1.0, 0.0, 1.0, 0.0])
    low, high = math.log10(SCOTOPIC_CD_M2), math.log10(PHOTOPIC_CD_M2)
    position = np.clip((math.log10(max(adapted_cd_m2, 1e-12)) - low) / (high - low), 0, 1)
    stages = np.stack([SCOTOPIC, MESOPIC, aged])
    return np.array([np.interp(position, [0.0, 0.5, 1.0], stages[:, k]) for k in range(4)])


def hemisphere_volume(density: Angles, deg: Angles) -> float:
    """Volume of a radial function, sampled at `deg`, over the hemisphere: 1 for f0 … f3."""
    return float(math.pi**2 / 90 * np.trapezoid(density * np.sin(np.radians(deg)), deg))


def spe_components(pixels_per_deg: float, rows_radius_px: int, columns_radius_px: int) -> list[NDArray[np.float32]]:
    """f0 … f3 as light per pixel around a point: the mean over the pixel near the axis, its middle's value further out.

    Four arrays of (channels, 2·rows_radius + 1, 2·columns_radius + 1): one channel, and for the halo, which differs by
    wavelength, three. The angle is the distance in pixels over `pixels_per_deg`, so the plane is flat. What falls
    outside the kernel is missing from its sum.
    """
    halos = [functools.partial(f3, wavelength_nm=nm) for nm in HALO_NM]
    y, x = (np.arange(-radius, radius + 1) / pixels_per_deg for radius in (rows_radius_px, columns_radius_px))
    coarse = np.hypot(y[:, None], x[None, :])
    # Near the axis the functions bend within a pixel: there each pixel is the mean of many points.
    near_y, near_x = min(rows_radius_px, NEAR_PX), min(columns_radius_px, NEAR_PX)
    dense = np.hypot(_fine(near_y, pixels_per_deg)[:, None], _fine(near_x, pixels_per_deg)[None, :])
    middle = (
        slice(rows_radius_px - near_y, rows_radius_px + near_y + 1),
        slice(columns_radius_px - near_x, columns_radius_px + near_x + 1),
    )

    def integrate(density: Callable[[Angles], Angles]) -> NDArray[np.float32]:
        kernel = density(coarse)
        kernel[middle] = density(dense).reshape(2 * near_y + 1, POINTS, 2 * near_x + 1, POINTS).mean(axis=(1, 3))
        kernel *= math.radians(1 / pixels_per_deg) ** 2
        # A kernel must make no light: on a flat plane f2 adds up to 1.12 at a reach of 163°, and the halo, sampled once
        # a pixel of 0.4°, to 1.04.
        return (kernel / max(kernel.sum(), 1.0)).astype(np.float32)

    return [np.stack([integrate(density) for density in part]) for part in ([f0], [f1], [f2], halos)]


def _fine(radius_px: int, pixels_per_deg: float) -> Angles:
    """POINTS midpoints in each of the pixels within a radius, in degrees from the middle one's centre."""
    return ((np.arange((2 * radius_px + 1) * POINTS) + 0.5) / POINTS - radius_px - 0.5) / pixels_per_deg
