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
from typing import NamedTuple

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


def veil_part(deg: Angles, wider: float = 1.0) -> Angles:
    """The share of the function at an angle that belongs to the veil, which begins `wider` times as far out."""
    return smooth_step(np.asarray(deg, np.float64) / wider, *VEIL_DEG)


def kernel_radius_px(pixels_per_deg: float, wider: float = 1.0) -> int:
    """How far a kernel reaches."""
    return int(np.ceil(VEIL_DEG[1] * wider * pixels_per_deg))


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
    nm: float,
    n: int,
    age_years: float,
    pigmentation: float,
    wider: float = 1.0,
    *,
    scatter: ScatterShares = RIT_SHARES,
) -> tuple[float, float, float]:
    """Of one wavelength's light: how much lies in the core, in CIE's part of the kernel, and in the veil. Sum 1.

    The field of the longest waves reaches 0.5° into the veil's first rise, where the veil is 4 % of itself.
    """

    def beyond(deg: Angles) -> Angles:
        return beyond_core(deg, (nm,), (1.0,), n, age_years, pigmentation, scatter=scatter) * (
            1 - veil_part(deg, wider)
        )

    near, veil = radial.hemisphere_volume(beyond), _veil_share(age_years, pigmentation, wider)
    return 1 - near - veil, near, veil


@functools.lru_cache(maxsize=64)
def _veil_share(age_years: float, pigmentation: float, wider: float) -> float:
    return radial.hemisphere_volume(lambda deg: analytic.cie135(deg, age_years, pigmentation) * veil_part(deg, wider))


def wave_kernel(
    psf: Float[np.ndarray, "n n"],
    nm: NDArray[np.float64],
    weights: NDArray[np.float64],
    pixels_per_deg: float,
    age_years: float,
    pigmentation: float,
    *,
    radius_px: int | None = None,
    wider: float = 1.0,
    scatter: ScatterShares = RIT_SHARES,
) -> tuple[NDArray[np.float64], float]:
    """A kernel over display pixels and the veil's share, from a monochromatic function at 575 nm.

    `weights` (wavelength, …) says what each wavelength contributes to each channel (light_spectra.py); the kernel has
    the shape (…, k, k), k = 2·`radius_px` + 1, by default as far as a veil that begins `wider` times as far out leaves
    anything. It then adds up, with the veil's share, to the weights' sum but for 1e-4: it lies on a flat plane.
    """
    cells = Cells(tuple(nm.tolist()), weights.tobytes(), weights.shape, pixels_per_deg, radius_px, wider)
    eye = Straylight(age_years, pigmentation, scatter)
    return joined(core_kernel(psf, cells, eye), len(psf), cells, eye)


def fresh_wave_kernel(
    light: Callable[[float], Float[np.ndarray, "n n"]],
    n: int,
    nm: NDArray[np.float64],
    weights: NDArray[np.float64],
    pixels_per_deg: float,
    age_years: float,
    pigmentation: float,
    *,
    radius_px: int | None = None,
    wider: float = 1.0,
    scatter: ScatterShares = RIT_SHARES,
) -> tuple[NDArray[np.float64], float]:
    """The same with an FFT for each wavelength: `light` is the n × n function at a wavelength in nm."""
    cells = Cells(tuple(nm.tolist()), weights.tobytes(), weights.shape, pixels_per_deg, radius_px, wider)
    eye = Straylight(age_years, pigmentation, scatter)
    used, taper = _field(n)
    radius_px = min(spectrum.kernel_radius_px(used, pixels_per_deg), cells.reach_px)
    of_core = core_weights(n, cells, eye)
    core = spectrum.fresh_kernel(light, nm, of_core, pixels_per_deg, taper=taper, radius_px=radius_px)
    return joined(core, n, cells, eye)


class Straylight(NamedTuple):
    """What of an eye its straylight depends on."""

    age_years: float
    pigmentation: float
    scatter: ScatterShares


class Cells(NamedTuple):
    """What a kernel is for: the light's spectra, and the cells, pixels or others, over which it spreads; hashable."""

    nm: tuple[float, ...]
    weights_bytes: bytes
    weights_shape: tuple[int, ...]
    pixels_per_deg: float
    radius_px: int | None
    wider: float

    @property
    def weights(self) -> NDArray[np.float64]:
        """(wavelength, …)."""
        return np.frombuffer(self.weights_bytes).reshape(self.weights_shape)

    @property
    def reach_px(self) -> int:
        """How far the kernel reaches to each side."""
        return kernel_radius_px(self.pixels_per_deg, self.wider) if self.radius_px is None else self.radius_px


def core_kernel(
    psf: Float[np.ndarray, "size size"], cells: Cells, eye: Straylight, n: int | None = None
) -> NDArray[np.float64]:
    """What of a kernel is wave optics', as far as the field of an n × n plane reaches, by default of size × size."""
    n = len(psf) if n is None else n
    used, taper = _field(n)
    radius_px = min(spectrum.kernel_radius_px(used, cells.pixels_per_deg), cells.reach_px)
    of_core, scale = core_weights(n, cells, eye), cells.pixels_per_deg * n / len(psf)
    return spectrum.scaled_kernel(psf, np.array(cells.nm), of_core, scale, taper=taper, radius_px=radius_px)


def core_weights(n: int, cells: Cells, eye: Straylight) -> NDArray[np.float64]:
    """The weights, each less what its wavelength has beyond the core of an n × n plane."""
    used, _ = _field(n)
    in_core = np.array(
        [shares(nm, used, eye.age_years, eye.pigmentation, cells.wider, scatter=eye.scatter)[0] for nm in cells.nm]
    )
    return cells.weights * in_core.reshape(-1, *[1] * (cells.weights.ndim - 1))


def joined(core: NDArray[np.float64], n: int, cells: Cells, eye: Straylight) -> tuple[NDArray[np.float64], float]:
    """The kernel, with CIE's part around and under the core of an n × n plane, and the veil's share."""
    used, _ = _field(n)
    kernel = _cie_near(used, cells, eye).copy()
    margin = (kernel.shape[-1] - core.shape[-1]) // 2
    inner = slice(margin, kernel.shape[-1] - margin)
    kernel[..., inner, inner] += core
    return kernel, _veil_share(eye.age_years, eye.pigmentation, cells.wider)


def _field(n: int) -> tuple[int, tuple[float, float]]:
    """How many samples of an n × n plane's function are used, and the taper in shares of n/2."""
    used = min(n, straylight.FIELD_SAMPLES)
    return used, (FIELD_TAPER[0] * used / n, FIELD_TAPER[1] * used / n)


@functools.lru_cache(maxsize=32)
def _cie_near(n: int, cells: Cells, eye: Straylight) -> NDArray[np.float64]:
    """CIE's part of the kernel, beyond the core's field and unresolved within: the same for every pupil."""
    radius = cells.reach_px
    flat = cells.weights.reshape(len(cells.nm), -1)
    channels = np.empty((flat.shape[1], 2 * radius + 1, 2 * radius + 1))
    for channel in range(flat.shape[1]):

        def density(deg: Angles, of_channel: tuple[float, ...] = tuple(flat[:, channel])) -> Angles:
            beyond = beyond_core(deg, cells.nm, of_channel, n, eye.age_years, eye.pigmentation, scatter=eye.scatter)
            return beyond * (1 - veil_part(deg, cells.wider))

        channels[channel] = radial.pixel_integrated(density, cells.pixels_per_deg, radius, radius)
    return channels.reshape(*cells.weights_shape[1:], *channels.shape[1:])
