"""From point-spread functions at single wavelengths to a colour kernel over display pixels.

At a focused pupil plane the function only scales with the wavelength: F_λ(θ) = (λ0/λ)²·F_λ0(θ·λ0/λ) (equations E9,
E10). So one function serves all wavelengths, its samples λ/W wide at each. The light of a pixel is the sum of the
samples that it covers, wholly or in part: B·F·Bᵀ with a sparse matrix B of the shares of samples in pixels. It is exact
for any wavelength, pixel size and position, only adds what is positive, and keeps each wavelength's energy.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse
from jaxtyping import Array, Complex, Float
from numpy.typing import NDArray

from pipeline.optics.diffraction import bin_deg, point_spread
from pipeline.optics.light_spectra import RANGE_NM

BATCH = 8
"""Wavelengths whose light is held at once. Engineering choice: enough for one product with their weights, and 32 MB for
a kernel of 1024² pixels."""


def kernel_radius_px(n: int, pixels_per_deg: float) -> int:
    """How far a kernel of an n × n point-spread function reaches at the longest wavelength, shifts included."""
    return int(np.ceil((n + 1) / 2 * bin_deg(RANGE_NM[1]) * pixels_per_deg))


def scaled_kernel(
    psf: Float[Array, "n n"] | Float[np.ndarray, "n n"],
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
    light = np.asarray(psf)
    if taper is not None:
        light = tapered(light, taper)
    radius = kernel_radius_px(light.shape[0], pixels_per_deg) if radius_px is None else radius_px
    return _summed(lambda _: light, nm, weights, pixels_per_deg, shift_px, radius)


def fresh_kernel(
    plane: Callable[[float], Complex[Array, "n n"]],
    nm: Float[np.ndarray, "wavelength"],
    weights: Float[np.ndarray, "wavelength *c"],
    pixels_per_deg: float,
    shift_px: tuple[float, float] = (0.0, 0.0),
    taper: tuple[float, float] | None = None,
    radius_px: int | None = None,
) -> Float[np.ndarray, "*c k k"]:
    """The same from an FFT in float64 for each wavelength: the reference, and exact out of focus too.

    `plane` is the pupil plane at a wavelength in nm, of the same size at each.
    """

    def light(wavelength_nm: float) -> NDArray[np.floating]:
        psf = np.asarray(point_spread(np.asarray(plane(wavelength_nm), np.complex128)))
        return psf if taper is None else tapered(psf, taper)

    if radius_px is None:
        radius_px = kernel_radius_px(plane(float(nm[0])).shape[0], pixels_per_deg)
    return _summed(light, nm, weights, pixels_per_deg, shift_px, radius_px)


def tapered(psf: NDArray[np.floating], taper: tuple[float, float]) -> NDArray[np.floating]:
    """A point-spread function within a round field, its sum unchanged.

    The field ends smoothly between two shares of its radius n/2: the angle grows with the wavelength as all else. What
    lay outside (`share_outside`) is light that an FFT folds back from beyond the field, so it is none of the corners'.
    """
    inside = psf * _field(psf.shape[0], taper).astype(psf.dtype)
    return np.asarray(inside * (psf.sum(dtype=np.float64) / inside.sum(dtype=np.float64)), psf.dtype)


def share_outside(psf: NDArray[np.floating], taper: tuple[float, float]) -> float:
    """The share of the light that a taper takes from the field's edge and spreads over the rest."""
    inside = (psf * _field(psf.shape[0], taper)).sum(dtype=np.float64)
    return float(1 - inside / psf.sum(dtype=np.float64))


def _field(n: int, taper: tuple[float, float]) -> Float[np.ndarray, "n n"]:
    low, high = taper
    x = (np.arange(n) - n // 2) / (n / 2)
    position = np.clip((high - np.hypot(x[:, None], x[None, :])) / (high - low), 0, 1)
    return position * position * (3 - 2 * position)


def _summed(
    light_at: Callable[[float], NDArray[np.floating]],
    nm: Float[np.ndarray, "wavelength"],
    weights: Float[np.ndarray, "wavelength *c"],
    pixels_per_deg: float,
    shift_px: tuple[float, float],
    radius_px: int,
) -> Float[np.ndarray, "*c k k"]:
    k = 2 * radius_px + 1
    flat = np.asarray(weights, np.float64).reshape(len(nm), -1)
    kernel = np.zeros((flat.shape[1], k * k))
    for start in range(0, len(nm), BATCH):
        batch = slice(start, start + BATCH)
        light = np.stack(
            [_over_pixels(light_at(float(at)), float(at), pixels_per_deg, shift_px, k) for at in nm[batch]]
        )
        kernel += flat[batch].T.astype(light.dtype) @ light.reshape(len(light), -1)
    return kernel.reshape(*weights.shape[1:], k, k)


def _over_pixels(
    psf: NDArray[np.floating], wavelength_nm: float, pixels_per_deg: float, shift_px: tuple[float, float], k: int
) -> NDArray[np.floating]:
    """The light of one wavelength in k × k pixels."""
    sample_px = bin_deg(wavelength_nm) * pixels_per_deg
    down, right = (_shares(len(psf), sample_px, shift, k).astype(psf.dtype) for shift in shift_px)
    # Twice from the left: whole rows are added up, and the transpose between is small where pixels are wide.
    by_row = np.ascontiguousarray((down @ psf).T)
    return (right @ by_row).T


def _shares(n: int, sample_px: float, shift_px: float, k: int) -> scipy.sparse.csr_array:
    """Which share of each of n samples, n//2 of them before the light itself, lies in each of k pixels."""
    # Sample i covers i − ½ … i + ½ around its direction. In samples from the first one's lower edge:
    pixel_edges = (np.arange(k + 1) - k / 2 - shift_px) / sample_px + n // 2 + 0.5
    cuts = np.sort(np.concatenate([pixel_edges[(pixel_edges > 0) & (pixel_edges < n)], np.arange(n + 1.0)]))
    middles, lengths = (cuts[1:] + cuts[:-1]) / 2, np.diff(cuts)
    pixels = np.searchsorted(pixel_edges, middles) - 1
    seen = (pixels >= 0) & (pixels < k) & (lengths > 0)
    places = (pixels[seen], middles[seen].astype(np.int64))
    return scipy.sparse.csr_array((lengths[seen], places), shape=(k, n))
