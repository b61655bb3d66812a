"""The glare of lights with spectra of their own: their kernels, and their veil at its exact angles.

Their kernel is always that of wave optics, whatever the frame's own light uses: a formula knows no spectrum.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare import models
from entoptic.pipeline.effects.glare.kernel import Veil
from entoptic.pipeline.effects.glare.lights import SUBPIXELS, Falloff, LightMixture, PointKernel, draw_lights
from entoptic.pipeline.frame import Light, View
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import light_spectra, whole
from entoptic.pipeline.optics.aperture import Pose

STRIDE_DEG = 0.6
"""The veil of a light is computed at points this far apart, 8 pixels at most, and linear between. Engineering choice: a
seventh of the angle at which it begins."""


def add_lights(
    onto: Float[Array, "3 y x"],
    lights: Sequence[Light],
    view: View,
    observer: Observer,
    pose: Pose,
    falloff: Falloff = Falloff.NONE,
) -> Float[Array, "3 y x"]:
    """A frame in cd/m² with its lights and all their glare, of lights beyond its edges too."""

    @functools.cache
    def kernel_of(spectrum: str) -> LightMixture:
        if pose.lens_m is not None:
            return ((_point_kernel(observer, pose, view.ppd_centre, spectrum), 1.0),)
        return tuple(
            (
                _held(
                    observer, dataclasses.replace(pose, pupil_diameter_mm=pupil_diameter_mm), view.ppd_centre, spectrum
                ),
                weight,
            )
            for pupil_diameter_mm, weight in models.pupil_steps(pose.pupil_diameter_mm)
        )

    image = draw_lights(onto, lights, view, kernel_of, falloff)
    return image + jnp.asarray(_veil(lights, view, models.cie_veil(observer)), jnp.float32)


def _point_kernel(observer: Observer, pose: Pose, pixels_per_deg: float, spectrum: str) -> PointKernel:
    nm, weights = light_spectra.light_weights(spectrum)
    psf = models.monochromatic(observer, pose)
    kernel, share = whole.wave_kernel(
        psf, nm, weights, pixels_per_deg * SUBPIXELS, *models.cie_veil(observer).parameters
    )
    middle = kernel.shape[-1] // 2
    # What the flat kernel's sum lacks, or has too much of.
    kernel[:, middle, middle] += weights.sum(axis=0) * (1 - share) - kernel.sum(axis=(1, 2))
    return PointKernel(kernel.astype(np.float32))


@functools.lru_cache(maxsize=8)
def _held(observer: Observer, pose: Pose, pixels_per_deg: float, spectrum: str) -> PointKernel:
    """Of an eye that holds still."""
    return _point_kernel(observer, pose, pixels_per_deg, spectrum)


def _veil(lights: Sequence[Light], view: View, veil: Veil) -> NDArray[np.float64]:
    """What lights scatter beyond their kernels: a point's illuminance times the density per steradian is luminance."""
    down, right = (_stations(size, view.ppd_centre) for size in (view.height_px, view.width_px))
    v, u = np.meshgrid(
        (down - view.height_px / 2) / view.focal_px, (right - view.width_px / 2) / view.focal_px, indexing="ij"
    )
    directions = np.stack([u, -v, np.ones_like(u)]) / np.sqrt(1 + u * u + v * v)
    low = np.zeros((3, len(down), len(right)))
    for light in lights:
        azimuth, elevation = math.radians(light.azimuth_deg), math.radians(light.elevation_deg)
        towards = (
            math.sin(azimuth) * math.cos(elevation),
            math.sin(elevation),
            math.cos(azimuth) * math.cos(elevation),
        )
        deg = np.degrees(np.arccos(np.clip(np.tensordot(towards, directions, 1), -1, 1)))
        low += _colour(light.spectrum)[:, None, None] * light.illuminance_lx * np.where(deg <= 90, veil.density(deg), 0)
    rows, columns = (_linear(at, size) for at, size in ((down, view.height_px), (right, view.width_px)))
    return np.asarray(rows @ low @ columns.T)


@functools.lru_cache(maxsize=64)
def _colour(spectrum: str) -> NDArray[np.float64]:
    """Linear RGB of a spectrum, of luminance 1."""
    return light_spectra.light_weights(spectrum)[1].sum(axis=0)


def _stations(size: int, pixels_per_deg: float) -> NDArray[np.float64]:
    """Places from the first pixel's centre to the last one's."""
    stride_px = max(1, min(8, int(STRIDE_DEG * pixels_per_deg)))
    return np.linspace(0.5, size - 0.5, -(-size // stride_px) + 1)


def _linear(at: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    """Weights (pixel, station) of linear interpolation."""
    place = np.arange(size) + 0.5
    return np.stack([np.interp(place, at, unit) for unit in np.eye(len(at))], axis=1)
