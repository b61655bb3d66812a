"""A clear pupil, and Airy's pattern of it: what the optics' tests hold everything against."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy import special

from entoptic.pipeline.optics import coverage


def pupil_disc(diameter_m: float, n: int) -> NDArray[np.float32]:
    """The covered share of each sample: 1 inside and 0 outside."""
    return np.asarray(coverage.disc(diameter_m, n, coverage.PLANE_M / n), np.float32)


def airy(deg: NDArray[np.float64], pupil_diameter_mm: float, wavelength_nm: float) -> NDArray[np.float64]:
    """Light per steradian behind a focused pupil; small angles."""
    size = math.pi * pupil_diameter_mm * 1e-3 / (wavelength_nm * 1e-9)
    x = size * np.radians(deg)
    jinc = np.divide(2 * special.j1(x), x, out=np.ones_like(x), where=x != 0)
    return size**2 / (4 * math.pi) * jinc**2
