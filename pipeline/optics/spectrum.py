"""From the point-spread function at one wavelength to an RGB kernel over display pixels.

At a focused pupil plane the function only scales with the wavelength: F_λ(θ) = (λ0/λ)²·F_λ0(θ·λ0/λ) (equations E9,
E10). So the light in a pixel at λ is the light in a box λ0/λ times as large at λ0, and a summed-area table of F_λ0
gives it exactly for every wavelength, pixel size and position: each wavelength keeps its energy by construction.
"""

from __future__ import annotations

import functools

import colour
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pipeline.optics.diffraction import WAVELENGTH_NM, bin_deg

RANGE_NM = (380.0, 770.0)
WAVELENGTHS = 32
"""As many as RIT §4 sums."""


@functools.cache
def rgb_of_white(count: int = WAVELENGTHS) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths in nm and the linear Rec.709 RGB that each contributes to D65 white: shapes (count,), (count, 3).

    The contributions add up to (1, 1, 1); those of single wavelengths lie outside the gamut, so some are negative.
    """
    nm = np.linspace(*RANGE_NM, count)
    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    xyz = np.asarray(cmfs[nm]) * np.asarray(colour.SDS_ILLUMINANTS["D65"][nm])[:, None]
    rgb = xyz @ np.asarray(colour.RGB_COLOURSPACES["ITU-R BT.709"].matrix_XYZ_to_RGB).T
    return nm, rgb / rgb.sum(axis=0)


def kernel_radius_px(n: int, pixels_per_deg: float) -> int:
    """How far a kernel of an n × n point-spread function reaches at the longest wavelength."""
    return int(np.ceil(n / 2 * bin_deg(RANGE_NM[1]) * pixels_per_deg))


def rgb_kernel(psf: Float[Array, "n n"], pixels_per_deg: float) -> Float[Array, "3 k k"]:
    """The share of a white point's light that each pixel around it gets, k = 2·radius + 1, each channel's sum 1.

    Pixels outside the gamut are clipped to it. float64: the tail is 1e-8 of the whole, less than float32 can hold in
    a summed-area table.
    """
    nm, weights = rgb_of_white()
    radius = kernel_radius_px(psf.shape[0], pixels_per_deg)
    edges_deg = (np.arange(2 * radius + 2) - radius - 0.5) / pixels_per_deg
    scaled_bins = edges_deg[None, :] / bin_deg(WAVELENGTH_NM) * (WAVELENGTH_NM / nm)[:, None]
    return _sum_wavelengths(psf, jnp.asarray(scaled_bins), jnp.asarray(weights))


@jax.jit
def _sum_wavelengths(
    psf: Float[Array, "n n"], edges_bins: Float[Array, "wavelength edge"], weights: Float[Array, "wavelength 3"]
) -> Float[Array, "3 k k"]:
    n = psf.shape[0]
    table = jnp.zeros((n + 1, n + 1)).at[1:, 1:].set(jnp.cumsum(jnp.cumsum(psf.astype(jnp.float64), 0), 1))

    def add(kernel: Float[Array, "3 k k"], part: tuple[Array, Array]) -> tuple[Float[Array, "3 k k"], None]:
        edges, rgb = part
        # Sample i covers i − ½ … i + ½, so the table's row i, which sums all before sample i, ends at i − ½.
        position = jnp.clip(edges + n // 2 + 0.5, 0, n)
        low = jnp.clip(jnp.floor(position).astype(jnp.int32), 0, n - 1)
        share = position - low
        rows = table[low] * (1 - share)[:, None] + table[low + 1] * share[:, None]
        corners = rows[:, low] * (1 - share)[None, :] + rows[:, low + 1] * share[None, :]
        light = jnp.diff(jnp.diff(corners, axis=0), axis=1)
        return kernel + rgb[:, None, None] * light, None

    k = edges_bins.shape[1] - 1
    kernel, _ = jax.lax.scan(add, jnp.zeros((3, k, k)), (edges_bins, weights))
    kernel = jnp.maximum(kernel, 0)
    return kernel / kernel.sum(axis=(1, 2), keepdims=True)
