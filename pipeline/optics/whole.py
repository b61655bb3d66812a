"""The whole point-spread function of one eye, from its central peak to 90°, and where it is cut for application.

Near the axis it is what wave optics makes of this person's pupil plane. A pupil plane of n samples holds no more than a
field of ±n/2 samples, which with n = 2048 ends at 1.23 times the angle of the fibres' halo at every wavelength; there
the core is tapered and CIE 135's total glare function goes on. Within the field too there is light that is not the
plane's, the retina's: it is smooth, and fills up to CIE's light what the particles scatter (straylight.py). The energy
is accounted for: what comes from CIE is taken from the core, so each wavelength's volume over the hemisphere is 1.

To be applied, it is cut in two by angle: the kernel, laid over display pixels, that ends at 9°; and the smooth veil
beyond, which needs no resolution but true angles.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from entoptic.pipeline.observer import ScatterShares
from entoptic.pipeline.optics import analytic, radial, spectrum, straylight
from entoptic.pipeline.optics.diffraction import bin_deg

FIELD_TAPER = (0.88, 1.0)
"""Shares of the field's radius between which the core gives way. Engineering choice: beyond the halo (0.81, its outer
flank ends at 0.87), within the circle that the square field holds."""
VEIL_DEG = (4.5, 9.0)
"""Angles between which the kernel gives way to the veil. Engineering choice: a rise that tiles of 2.4° can follow, and
a kernel that is still small."""

RIT_SHARES = ScatterShares()
"""RIT Table 1."""

Angles = NDArray[np.float64]


def smooth_step(x: Angles, low: float, high: float) -> Angles:
    """0 below `low`, 1 above `high`, a cubic with level ends between."""
    position = np.clip((x - low) / (high - low), 0, 1)
    return position * position * (3 - 2 * position)


def veil_part(deg: Angles) -> Angles:
    """The share of the function at an angle that belongs to the veil."""
    return smooth_step(np.asarray(deg, np.float64), *VEIL_DEG)


def kernel_radius_px(pixels_per_deg: float) -> int:
    """How far a kernel reaches."""
    return int(np.ceil(VEIL_DEG[1] * pixels_per_deg))


def beyond_core(
    deg: Angles,
    nm: tuple[float, ...],
    weights: tuple[float, ...],
    n: int,
    age_years: float,
    pigmentation: float,
    *,
    scatter: ScatterShares = RIT_SHARES,
) -> Angles:
    """What at an angle does not come from wave optics of an n × n pupil plane, in sr⁻¹: CIE's beyond
    its field and what particles do not scatter within.

    Of light with these weights at these wavelengths.
    """
    deg = np.asarray(deg, np.float64)
    outside, fine = np.zeros_like(deg), np.zeros_like(deg)
    for weight, wavelength in zip(weights, nm, strict=True):
        beyond = smooth_step(deg / (n / 2 * bin_deg(wavelength)), *FIELD_TAPER)
        outside += weight * beyond
        fine += weight * (1 - beyond) * straylight.fine_density(deg, wavelength, age_years, pigmentation, scatter)
    unresolved = sum(straylight.shares(scatter)) * straylight.onset(deg) * (sum(weights) - outside)
    return np.asarray(analytic.cie135(deg, age_years, pigmentation) * (outside + unresolved) - fine)


@functools.lru_cache(maxsize=1024)
def shares(
    nm: float, n: int, age_years: float, pigmentation: float, *, scatter: ScatterShares = RIT_SHARES
) -> tuple[float, float, float]:
    """Of one wavelength's light: how much lies in the core, in CIE's part of the kernel, and in the veil. Sum 1.

    The field of the longest waves reaches 0.5° into the veil's first rise, where the veil is 4 % of itself.
    """

    def beyond(deg: Angles) -> Angles:
        return beyond_core(deg, (nm,), (1.0,), n, age_years, pigmentation, scatter=scatter) * (1 - veil_part(deg))

    near, veil = radial.hemisphere_volume(beyond), _veil_share(age_years, pigmentation)
    return 1 - near - veil, near, veil


@functools.lru_cache(maxsize=8)
def _veil_share(age_years: float, pigmentation: float) -> float:
    return radial.hemisphere_volume(lambda deg: analytic.cie135(deg, age_years, pigmentation) * veil_part(deg))


def wave_kernel(
    psf: Float[np.ndarray, "n n"],
    nm: NDArray[np.float64],
    weights: NDArray[np.float64],
    pixels_per_deg: float,
    age_years: float,
    pigmentation: float,
    *,
    scatter: ScatterShares = RIT_SHARES,
) -> tuple[NDArray[np.float64], float]:
    """A kernel over display pixels and the veil's share, from a monochromatic function at 575 nm.

    `weights` (wavelength, …) says what each wavelength contributes to each channel (light_spectra.py); the kernel has
    the shape (…, k, k), k = 2·kernel_radius_px + 1, and with the veil's share adds up to the weights' sum but for
    1e-4: it lies on a flat plane.
    """
    used, taper = _field(psf.shape[0])
    of_core, veil_share = _core_weights(nm, weights, used, age_years, pigmentation, scatter)
    radius_px = spectrum.kernel_radius_px(used, pixels_per_deg)
    core = spectrum.scaled_kernel(psf, nm, of_core, pixels_per_deg, taper=taper, radius_px=radius_px)
    return _joined(core, nm, weights, used, pixels_per_deg, age_years, pigmentation, scatter), veil_share


def fresh_wave_kernel(
    light: Callable[[float], Float[np.ndarray, "n n"]],
    n: int,
    nm: NDArray[np.float64],
    weights: NDArray[np.float64],
    pixels_per_deg: float,
    age_years: float,
    pigmentation: float,
    *,
    scatter: ScatterShares = RIT_SHARES,
) -> tuple[NDArray[np.float64], float]:
    """The same with an FFT for each wavelength: `light` is the n × n function at a wavelength in nm."""
    used, taper = _field(n)
    of_core, veil_share = _core_weights(nm, weights, used, age_years, pigmentation, scatter)
    radius_px = spectrum.kernel_radius_px(used, pixels_per_deg)
    core = spectrum.fresh_kernel(light, nm, of_core, pixels_per_deg, taper=taper, radius_px=radius_px)
    return _joined(core, nm, weights, used, pixels_per_deg, age_years, pigmentation, scatter), veil_share


def _field(n: int) -> tuple[int, tuple[float, float]]:
    """How many samples of an n × n plane's function are used, and the taper in shares of n/2."""
    used = min(n, straylight.FIELD_SAMPLES)
    return used, (FIELD_TAPER[0] * used / n, FIELD_TAPER[1] * used / n)


def _core_weights(
    nm: NDArray[np.float64],
    weights: NDArray[np.float64],
    n: int,
    age_years: float,
    pigmentation: float,
    scatter: ScatterShares,
) -> tuple[NDArray[np.float64], float]:
    """The weights, each less what its wavelength has beyond the core, and the veil's share."""
    parts = np.array([shares(float(wavelength), n, age_years, pigmentation, scatter=scatter) for wavelength in nm])
    return weights * parts[:, 0].reshape(-1, *[1] * (weights.ndim - 1)), float(parts[0, 2])


def _joined(
    core: NDArray[np.float64],
    nm: NDArray[np.float64],
    weights: NDArray[np.float64],
    n: int,
    pixels_per_deg: float,
    age_years: float,
    pigmentation: float,
    scatter: ScatterShares,
) -> NDArray[np.float64]:
    kernel = _cie_near(
        tuple(nm), weights.tobytes(), weights.shape, n, pixels_per_deg, age_years, pigmentation, scatter
    ).copy()
    margin = (kernel.shape[-1] - core.shape[-1]) // 2
    inner = slice(margin, kernel.shape[-1] - margin)
    kernel[..., inner, inner] += core
    return kernel


@functools.lru_cache(maxsize=8)
def _cie_near(
    nm: tuple[float, ...],
    weights_bytes: bytes,
    weights_shape: tuple[int, ...],
    n: int,
    pixels_per_deg: float,
    age_years: float,
    pigmentation: float,
    scatter: ScatterShares,
) -> NDArray[np.float64]:
    """CIE's part of the kernel, beyond the core's field and unresolved within: the same for every pupil."""
    weights = np.frombuffer(weights_bytes).reshape(weights_shape)
    radius = kernel_radius_px(pixels_per_deg)
    flat = weights.reshape(len(nm), -1)
    channels = np.empty((flat.shape[1], 2 * radius + 1, 2 * radius + 1))
    for channel in range(flat.shape[1]):

        def density(deg: Angles, of_channel: tuple[float, ...] = tuple(flat[:, channel])) -> Angles:
            return beyond_core(deg, nm, of_channel, n, age_years, pigmentation, scatter=scatter) * (1 - veil_part(deg))

        channels[channel] = radial.pixel_integrated(density, pixels_per_deg, radius, radius)
    return channels.reshape(*weights_shape[1:], *channels.shape[1:])
