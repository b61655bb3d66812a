"""The phase of a pupil out of focus."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Complex

from entoptic.pipeline.optics import OpticsError
from entoptic.pipeline.optics.coverage import PLANE_M


def turn(part: Complex[np.ndarray, "k k"], n: int, defocus_d: float, diameter_m: float, wavelength_nm: float) -> None:
    """Turns the phase of the middle of an n × n pupil plane by that of `defocus_d` dioptres, in place: exp(iπ·ΔD·r²/λ).

    The phase is a product of a row and a column, made in float64, as it is many turns.
    Raises OpticsError where it turns by half a cycle or more between samples at the edge of the pupil.
    """
    dx_m, wavelength_m = PLANE_M / n, wavelength_nm * 1e-9
    limit = wavelength_m / (2 * dx_m * diameter_m / 2)
    if abs(defocus_d) >= limit:
        raise OpticsError(
            f"a {n}×{n} pupil plane samples less than {limit:.2f} D of defocus at a {diameter_m * 1e3:.2f} mm pupil, "
            f"not {defocus_d:.2f} D: use {_finer(n, abs(defocus_d) / limit)} samples a side or a narrower pupil"
        )
    x_m = (np.arange(len(part)) - len(part) // 2) * dx_m
    line = np.exp(1j * np.pi * defocus_d / wavelength_m * x_m**2).astype(part.dtype)
    part *= line[:, None]
    part *= line


def _finer(n: int, factor: float) -> int:
    """The least even number of samples with more than `factor` times as many."""
    return 2 * (math.floor(n * factor / 2) + 1)
