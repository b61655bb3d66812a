"""Diffraction at the pupil: the point-spread function of a plane, or of planes one behind another, at one wavelength.

All planes are given in pupil coordinates: a ray that enters the pupil at r meets a later plane at r times the beam's
width there, and keeps its coordinate. In these coordinates a converging wave travels like a collimated one, only
further (Sziklai 1981; Talanov 1970), so that every plane has the same samples and the last step is one FFT.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence

import numpy as np
import scipy.fft
from jaxtyping import Complex, Float

from entoptic.pipeline.optics import OpticsError
from entoptic.pipeline.optics.aperture import PLANE_M

WAVELENGTH_NM = 575.0
"""The wavelength that is computed; all others are scaled from it (LUI 5.2.2)."""
VITREOUS_INDEX = 1.336
"""Refractive index of the vitreous (Gullstrand 1909)."""
SHARED_SAMPLES = 1024
"""Planes of more samples a side are transformed by all cores. Engineering choice: measured."""
IMAGE_DISTANCE_M = 20.4e-3
"""Over which a wave in focus converges: from the pupil, 3.6 mm behind the cornea, to the retina at 24 mm (Gullstrand
1909). The pupil and its images by cornea and lens, 13 and 3 % wider, are taken as one."""


def bin_deg(wavelength_nm: float) -> float:
    """Angle between neighbouring samples of the point-spread function in degrees: λ/W (W the plane's side)."""
    return math.degrees(wavelength_nm * 1e-9 / PLANE_M)


def field_of(plane: Complex[np.ndarray, "k k"], n: int | None = None) -> Complex[np.ndarray, "n n"]:
    """FFT of a pupil plane, or of the lit part of one of n × n samples; the direction of the light itself is first."""
    size = len(plane) if n is None else n
    # Small ones take longer to share out than to make.
    workers = os.cpu_count() if size > SHARED_SAMPLES else 1
    return np.asarray(scipy.fft.fft2(plane, (size, size), workers=workers))


def point_spread(plane: Complex[np.ndarray, "k k"], n: int | None = None) -> Float[np.ndarray, "n n"]:
    """|FFT|² of the pupil plane, its sum 1, the direction of the light itself at sample n/2 (KRI 3.18, LUI 5.11).

    Each sample is the share of the light that falls within λ/W × λ/W radians around its direction. float32 for a
    complex64 plane, float64 for a complex128 one. All 0 for a plane through which no light comes.
    """
    return intensity(field_of(plane, n))


def power(field: Complex[np.ndarray, "k k"]) -> float:
    """Sum of squares."""
    return float(np.square(field.real).sum() + np.square(field.imag).sum())


def intensity(field: Complex[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """The light of a field, its sum 1, its first sample moved to n/2."""
    # Real and imaginary part apart: the modulus would take a root only to square it again.
    light = np.square(field.real)
    light += np.square(field.imag)
    total = float(light.sum(axis=1).sum(dtype=np.float64))
    light *= 1 / total if total > 0 else 0
    return np.asarray(scipy.fft.fftshift(light))


def collimated_m(distance_m: float) -> float:
    """How far a collimated wave travels for the diffraction of one that converges on the retina, from the pupil.

    z·f/(f − z), f the distance to the focus. Raises OpticsError at or behind the focus.
    """
    if not 0 <= distance_m < IMAGE_DISTANCE_M:
        raise OpticsError(
            f"a plane {distance_m * 1e3:.2f} mm behind the pupil does not lie between it and the focus: use "
            f"0 to less than {IMAGE_DISTANCE_M * 1e3:.2f} mm"
        )
    return distance_m * IMAGE_DISTANCE_M / (IMAGE_DISTANCE_M - distance_m)


def through_planes(
    first: Complex[np.ndarray, "n n"],
    later: Sequence[tuple[Float[np.ndarray, "n n"] | Complex[np.ndarray, "n n"], float]],
    wavelength_nm: float = WAVELENGTH_NM,
) -> Complex[np.ndarray, "n n"]:
    """The pupil plane that has the diffraction pattern of planes one behind another.

    `later` are transmittances in pupil coordinates with their distances behind the pupil in metres of vitreous,
    nearest first. Between two planes the field travels by Fresnel's transfer function; the field behind the last plane
    is the result, as its |FFT|² is what reaches the retina. Raises OpticsError for planes out of order, at or behind
    the focus, or further apart than the grid samples: N·dx² < λz/n.
    """
    n = first.shape[0]
    dx, wavelength_m = PLANE_M / n, wavelength_nm * 1e-9 / VITREOUS_INDEX
    field, before_m = first, 0.0
    for mask, distance_m in later:
        here_m = collimated_m(distance_m)
        apart_m = here_m - before_m
        if apart_m < 0:
            raise OpticsError(
                f"a plane {distance_m * 1e3:.2f} mm behind the pupil comes after one further back: "
                "give the planes in the order in which the light meets them"
            )
        if n * dx**2 < wavelength_m * apart_m:
            least = math.floor(PLANE_M**2 / (wavelength_m * apart_m))
            raise OpticsError(
                f"a {n}×{n} plane is too fine for a plane {distance_m * 1e3:.2f} mm behind the pupil: its widest "
                f"diffraction leaves the {PLANE_M * 1e3:.0f} mm grid; use {least} samples a side at most or a plane "
                "nearer to the pupil"
            )
        if apart_m > 0:
            field = _travel(field, wavelength_m * apart_m / PLANE_M**2)
        field, before_m = field * mask, here_m
    return field


def _travel(field: Complex[np.ndarray, "n n"], turns: float) -> Complex[np.ndarray, "n n"]:
    """Fresnel's transfer function exp(−iπ·λz·f²) on a field; `turns` is λz/W², so that f counts bins."""
    n = len(field)
    f = np.fft.fftfreq(n, 1 / n)
    line = np.exp(-1j * np.pi * turns * f**2).astype(field.dtype)
    spread = field_of(field) * line[:, None] * line
    return np.asarray(scipy.fft.ifft2(spread, workers=os.cpu_count()))
