"""From point-spread functions at single wavelengths to a colour kernel over display pixels.

At a focused pupil plane the function only scales with the wavelength: F_λ(θ) = (λ0/λ)²·F_λ0(θ·λ0/λ) (equations E9,
E10). So one function serves all wavelengths, its samples λ/W wide at each. The light of a pixel is the sum of the
samples that it covers, wholly or in part: B·F·Bᵀ with a sparse matrix B of the shares of samples in pixels. It is exact
for any wavelength, pixel size and position, only adds what is positive, and keeps each wavelength's energy.

What this costs is memory traffic, not arithmetic. So a few rows of the kernel are made at once, for all wavelengths:
they need neighbouring samples, and all that lies between the function and the kernel stays in the processor's cache.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import scipy.sparse
from jaxtyping import Float
from numpy.typing import NDArray

from entoptic.pipeline.optics.diffraction import bin_deg
from entoptic.pipeline.optics.light_spectra import RANGE_NM

ROWS = 32
"""Of a kernel that are made at once. Engineering choice: 4 MB for 32 wavelengths and a function of 1024² samples."""
CACHE_LINE_BYTES = 64


def kernel_radius_px(n: int, pixels_per_deg: float) -> int:
    """How far a kernel of an n × n point-spread function reaches at the longest wavelength, shifts included."""
    return int(np.ceil((n + 1) / 2 * bin_deg(RANGE_NM[1]) * pixels_per_deg))


def scaled_kernel(
    psf: Float[np.ndarray, "n n"],
    nm: Float[np.ndarray, "wavelength"],
    weights: Float[np.ndarray, "wavelength *c"],
    pixels_per_deg: float,
    shift_px: tuple[float, float] = (0.0, 0.0),
    taper: tuple[float, float] | None = None,
    radius_px: int | None = None,
) -> Float[np.ndarray, "*c k k"]:
    """The light of a point in each pixel around it: Σ over wavelengths of `weights` × the light of each, float64.

    `psf` is the function at diffraction.WAVELENGTH_NM, as `point_spread` gives it. k is 2·`radius_px` + 1, by default
    as far as the function reaches, so that the kernel adds up to the weights' sum. Light is `shift_px` (down, right,
    within ±½) away from the centre of the middle pixel. With `taper`, see `tapered`. The arithmetic has the precision
    of `psf`; nothing is clipped, so a channel is negative where a wavelength lies outside the gamut.
    """
    light = psf if taper is None else tapered(psf, taper)
    radius = kernel_radius_px(light.shape[0], pixels_per_deg) if radius_px is None else radius_px
    return _over_pixels(light, nm, weights, pixels_per_deg, shift_px, 2 * radius + 1)


def fresh_kernel(
    light: Callable[[float], Float[np.ndarray, "n n"]],
    nm: Float[np.ndarray, "wavelength"],
    weights: Float[np.ndarray, "wavelength *c"],
    pixels_per_deg: float,
    shift_px: tuple[float, float] = (0.0, 0.0),
    taper: tuple[float, float] | None = None,
    radius_px: int | None = None,
) -> Float[np.ndarray, "*c k k"]:
    """The same from a function made anew for each wavelength: the reference, and exact out of focus too.

    `light` is the function at a wavelength in nm, of the same size at each.
    """
    kernel: NDArray[np.float64] | float = 0.0
    for index, wavelength_nm in enumerate(nm):
        one = slice(index, index + 1)
        made = light(float(wavelength_nm))
        kernel = kernel + scaled_kernel(made, nm[one], weights[one], pixels_per_deg, shift_px, taper, radius_px)
    return np.asarray(kernel)


def tapered(psf: NDArray[np.floating], taper: tuple[float, float]) -> NDArray[np.floating]:
    """A point-spread function within a round field, its sum unchanged.

    The field ends smoothly between two shares of its radius n/2: the angle grows with the wavelength as all else. What
    lay outside is light that an FFT folds back from beyond the field, so it is none of the corners'.
    """
    inside = psf * _field(len(psf), taper, psf.dtype)
    inside *= _sum(psf) / _sum(inside)
    return inside


def _sum(psf: NDArray[np.floating]) -> float:
    """By rows, pairwise, then in float64."""
    return float(psf.sum(axis=1).sum(dtype=np.float64))


@functools.lru_cache(maxsize=8)
def _field(n: int, taper: tuple[float, float], kind: np.dtype[np.floating]) -> NDArray[np.floating]:
    low, high = taper
    x = (np.arange(n) - n // 2) / (n / 2)
    position = np.clip((high - np.hypot(x[:, None], x[None, :])) / (high - low), 0, 1)
    return (position * position * (3 - 2 * position)).astype(kind)


def _over_pixels(
    psf: NDArray[np.floating],
    nm: Float[np.ndarray, "wavelength"],
    weights: Float[np.ndarray, "wavelength *c"],
    pixels_per_deg: float,
    shift_px: tuple[float, float],
    k: int,
) -> Float[np.ndarray, "*c k k"]:
    """The light in k × k pixels, from a function that scales with the wavelength."""
    n, count = len(psf), len(nm)
    # A column of samples a power of two apart would fall into a few places of the cache, over and over.
    width = n + CACHE_LINE_BYTES // psf.itemsize
    samples = np.zeros((n, width), psf.dtype)
    samples[:, :n] = psf
    down, right = (_pixel_edges(n, nm, pixels_per_deg, shift, k) for shift in shift_px)
    by_column = _shares(right, n, psf.dtype, apart=width)
    of_channel = weights.reshape(count, -1).T.astype(psf.dtype)
    kernel = np.empty((len(of_channel), k, k))

    def make_rows(start: int) -> None:
        edges = down[:, start : start + ROWS + 1]
        rows = edges.shape[1] - 1
        light = (_shares(edges, n, psf.dtype) @ samples).reshape(count, rows, width)
        turned = np.ascontiguousarray(light.transpose(0, 2, 1)).reshape(count * width, rows)
        in_pixels = (by_column @ turned).reshape(count, k, rows)
        # Not a matrix product: BLAS is slow with so few channels and would start threads of its own.
        kernel[:, start : start + rows] = np.einsum("cl,lxy->cyx", of_channel, in_pixels)

    with ThreadPoolExecutor(os.cpu_count()) as threads:
        for done in [threads.submit(make_rows, start) for start in range(0, k, ROWS)]:
            done.result()
    return kernel.reshape(*weights.shape[1:], k, k)


def _pixel_edges(
    n: int, nm: Float[np.ndarray, "wavelength"], pixels_per_deg: float, shift_px: float, k: int
) -> Float[np.ndarray, "wavelength k+1"]:
    """Where pixels end, in samples from the lower edge of the first: sample i is i − ½ … i + ½ around its direction."""
    samples_px = 1 / (np.array([bin_deg(float(wavelength)) for wavelength in nm]) * pixels_per_deg)
    return (np.arange(k + 1) - k / 2 - shift_px) * samples_px[:, None] + n // 2 + 0.5


def _shares(
    edges: Float[np.ndarray, "wavelength k+1"], n: int, kind: np.dtype[np.floating], apart: int = 0
) -> scipy.sparse.csr_array:
    """Which share of each of n samples lies in each pixel, one row a pixel, all pixels of a wavelength together.

    With `apart` each wavelength has samples of its own, so many columns after those of the last.
    """
    count, pixels = edges.shape[0], edges.shape[1] - 1
    inside = np.clip(edges, 0, n)
    low, high = inside[:, :-1].ravel(), inside[:, 1:].ravel()
    first = low.astype(np.int32)
    touched = np.where(high > low, np.ceil(high).astype(np.int32) - first, 0)
    begins = np.concatenate([[0], np.cumsum(touched)]).astype(np.int32)
    sample = np.arange(begins[-1], dtype=np.int32) - np.repeat(begins[:-1] - first, touched)
    share = np.minimum(sample + 1, np.repeat(high, touched)) - np.maximum(sample, np.repeat(low, touched))
    block = np.repeat(np.arange(count, dtype=np.int32) * apart, touched.reshape(count, pixels).sum(axis=1))
    return scipy.sparse.csr_array(
        (share.astype(kind), sample + block, begins), shape=(count * pixels, count * apart or n)
    )
