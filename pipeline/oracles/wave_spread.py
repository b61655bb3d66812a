"""Wave optics of one eye's pupil plane as a function over the sphere, with azimuth and colours, in float64.

The pupil plane, its fine particles and the spectra of the display's primaries are given. From there on it is worked out
anew: one FFT of 2048² samples, in focus exact for every wavelength by scaling, no pixels and no cut between kernel and
veil. Light is read off by sums over rectangles of samples, so that it may be averaged over a pixel or a part of one.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import aperture, fine_scatter, light_spectra, straylight, whole
from entoptic.pipeline.optics.aperture import PLANE_M, Pose
from entoptic.pipeline.optics.diffraction import WAVELENGTH_NM
from entoptic.pipeline.oracles.point_spread import Density, cie135, per_panel
from entoptic.pipeline.oracles.sphere import Directed

Reals = NDArray[np.float64]

SAMPLES = 2048
PIGMENTATION = {"dark": 0.0, "brown": 0.5, "green": 1.0, "blue": 1.2}
"""CIE 135's p; its 0 is a very dark eye's."""


def wave(observer: Observer, pose: Pose, wavelengths: int, box_deg: float) -> Directed:
    """The function of an eye in focus, averaged over squares of a width in degrees.

    Raises ValueError for an eye out of focus, whose function does not scale with the wavelength.
    """
    if pose.defocus_d:
        raise ValueError(f"{pose.defocus_d:g} D out of focus: the function is scaled from one wavelength, give 0 D")
    nm, weights = light_spectra.primary_weights(wavelengths)
    beyond = [_beyond_field(observer, float(one)) for one in nm]
    in_core = [1 - float(per_panel(density).sum()) for density in beyond]
    corner = _sums_to_corners(_in_round_field(_light(observer, pose)))

    def density(angle_deg: Reals, azimuth_rad: Reals) -> Reals:
        x, y = angle_deg * np.cos(azimuth_rad), angle_deg * np.sin(azimuth_rad)
        total = np.zeros((3, 3, *np.shape(angle_deg)))
        for one, weight, share, outside in zip(nm, weights, in_core, beyond, strict=True):
            bin_deg = math.degrees(float(one) * 1e-9 / PLANE_M)
            half, down, right = box_deg / bin_deg / 2, y / bin_deg, x / bin_deg
            core = _rectangles(corner, down - half, down + half, right - half, right + half)
            light = share * core / math.radians(box_deg) ** 2 + outside(angle_deg)
            total += np.multiply.outer(weight, light)
        return total

    return density


def _light(observer: Observer, pose: Pose) -> Reals:
    """|FFT|² of the plane and its fine particles at 575 nm, sum 1, the light's own direction in the middle."""
    plane = np.asarray(aperture.pupil_box(observer, pose, SAMPLES), np.complex128)
    points = np.asarray(fine_scatter.points(observer, pose, SAMPLES), np.complex128)
    frequency = np.fft.fftfreq(SAMPLES) * SAMPLES
    deg = np.hypot(frequency[:, None], frequency) * math.degrees(WAVELENGTH_NM * 1e-9 / PLANE_M)
    field = np.fft.fft2(plane, (SAMPLES, SAMPLES))
    wanted = _fine(observer, WAVELENGTH_NM)(deg) * math.radians(math.degrees(WAVELENGTH_NM * 1e-9 / PLANE_M)) ** 2
    wanted[np.hypot(frequency[:, None], frequency) > SAMPLES / 2] = 0
    core = 1 - float(per_panel(_beyond_field(observer, WAVELENGTH_NM)).sum())
    share = float(wanted.sum()) / core
    if share and points.any():
        # A point spread over four samples has (2 + cos k)/3 of its power left along each axis, on average 2/3.
        line = (2 + np.cos(2 * np.pi * frequency / SAMPLES)) / 3
        power = float(np.sum(np.abs(points) ** 2)) * 9 / 4
        bare = float(np.sum(np.abs(plane) ** 2)) * SAMPLES**2
        weight = np.sqrt(wanted / wanted.sum() / (line[:, None] * line) * bare * share / (1 - share) / power)
        field = field + np.fft.fft2(points, (SAMPLES, SAMPLES)) * weight
    light = field.real**2 + field.imag**2
    return np.asarray(np.fft.fftshift(light / light.sum()))


def _in_round_field(light: Reals) -> Reals:
    """Ended between 0.88 and 1 of the field's radius by a cubic, the sum kept."""
    index = np.arange(SAMPLES) - SAMPLES // 2
    light = light * (1 - _rise(np.hypot(index[:, None], index) / (SAMPLES / 2), *whole.FIELD_TAPER))
    return np.asarray(light / light.sum())


def _beyond_field(observer: Observer, nm: float) -> Density:
    """CIE's light where the plane has none: beyond its field, and the retina's and the fine particles' rest within."""
    cie, fine = _cie(observer), _fine(observer, nm)
    field_deg = SAMPLES / 2 * math.degrees(nm * 1e-9 / PLANE_M)
    smooth = sum(_shares(observer))

    def density(deg: Reals) -> Reals:
        outside = _rise(deg / field_deg, *whole.FIELD_TAPER)
        within = smooth * _onset(deg) * cie(deg) - fine(deg)
        return np.asarray(cie(deg) * outside + within * (1 - outside))

    return density


def _fine(observer: Observer, nm: float) -> Density:
    """What fine particles scatter: their share of CIE's at 575 nm, scaled with the wavelength."""
    cie, scale, share = _cie(observer), WAVELENGTH_NM / nm, _shares(observer)[0]
    return lambda deg: np.asarray(share * scale**2 * cie(deg * scale) * _onset(deg * scale))


def _shares(observer: Observer) -> tuple[float, float]:
    scatter = observer.scatter
    particles = scatter.cornea + scatter.lens + scatter.vitreous
    whole_light = particles + scatter.retina
    return particles / whole_light * (1 - straylight.RESOLVED), scatter.retina / whole_light


def _cie(observer: Observer) -> Density:
    return cie135(observer.age_years, PIGMENTATION[observer.iris.value])


def _onset(deg: Reals) -> Reals:
    return np.asarray(1 / (1 + (straylight.ONSET_DEG / np.maximum(deg, 1e-9)) ** 2))


def _rise(x: Reals, low: float, high: float) -> Reals:
    t = np.clip((x - low) / (high - low), 0, 1)
    return np.asarray(3 * t**2 - 2 * t**3)


def _sums_to_corners(light: Reals) -> Reals:
    """Of all samples above and left of each corner."""
    sums = np.zeros((SAMPLES + 1, SAMPLES + 1))
    sums[1:, 1:] = light.cumsum(axis=0).cumsum(axis=1)
    return sums


def _rectangles(corner: Reals, top: Reals, bottom: Reals, left: Reals, right: Reals) -> Reals:
    """The light between positions in samples from the middle one's centre, parts of samples included."""

    def upto(row: Reals, column: Reals) -> Reals:
        row, column = (np.clip(at + SAMPLES // 2 + 0.5, 0, SAMPLES - 1e-6) for at in (row, column))
        y, x = row.astype(np.intp), column.astype(np.intp)
        v, u = row - y, column - x
        above = corner[y, x] * (1 - u) + corner[y, x + 1] * u
        return np.asarray(above * (1 - v) + (corner[y + 1, x] * (1 - u) + corner[y + 1, x + 1] * u) * v)

    return upto(bottom, right) - upto(top, right) - upto(bottom, left) + upto(top, left)
