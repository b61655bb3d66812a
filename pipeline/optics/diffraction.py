"""Fraunhofer diffraction: the point-spread function of a pupil plane at one wavelength."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from pipeline.optics.aperture import PLANE_M

WAVELENGTH_NM = 575.0
"""The wavelength that is computed; all others are scaled from it (LUI §5.2.2)."""


def bin_deg(wavelength_nm: float) -> float:
    """Angle between neighbouring samples of the point-spread function: λ/W (W the plane's side)."""
    return math.degrees(wavelength_nm * 1e-9 / PLANE_M)


@jax.jit
def point_spread(plane: Complex[Array, "n n"]) -> Float[Array, "n n"]:
    """|FFT|² of the pupil plane, its sum 1, the direction of the light itself at sample n/2 (KRI 3.18, LUI 5.11).

    Each sample is the share of the light that falls within λ/W × λ/W radians around its direction.
    """
    intensity = jnp.abs(jnp.fft.fftshift(jnp.fft.fft2(plane))) ** 2
    return intensity / jnp.sum(intensity)
