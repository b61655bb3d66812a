"""Lights that the pixels do not show, drawn with their glare, exact to parts of a pixel.

A light is a point or a disc with a spectrum of its own. What its kernel puts into each pixel is known for lights in the
middle of each of SUBPIXELS² parts of a pixel, and interpolated in between: so a light that moves by a tenth of a pixel,
or from one pixel into the next, changes smoothly and its light stays the same. Discs are the kernel convolved with
discs of 1 … LARGEST_LAYER pixels, interpolated in between (KRI 4.2.6).

It is instant: a frame depends on no other.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.described import DescribedEnum
from entoptic.pipeline.effects.glare import splat
from entoptic.pipeline.frame import Light, View

SUBPIXELS = 5
"""Parts of a pixel along each side. Odd, so that a light in the middle of a pixel is what that pixel would be."""
LARGEST_LAYER = 8
"""Radius of the largest disc that is prepared, in pixels (KRI shows 4). Engineering choice: larger ones have no
sub-pixel detail that is seen, and each of these takes 10 MB at 10 pixels per degree."""


SUMMED_PX = 64
"""Discs up to this radius have their pixels summed; of larger ones the sum is the area within 1e-5."""


class Falloff(DescribedEnum):
    """What light scattered to a distance weighs; what it takes stays in the centre, so that no light is lost.

    `x` is the distance over the kernel's radius. KRI has these for kernels that are cut short (4.2.5, equations 4.11
    and 4.12); here they are 1 in the centre.
    """

    NONE = "none", "All of it counts, up to the edge."
    EPANECHNIKOV = "epanechnikov", "1 − x²."
    SILVERMAN = "silverman", "(1 − x²)²."

    def weight(self, x_squared: NDArray[np.float64]) -> NDArray[np.float64]:
        """At the squared distance, 0 from 1 on."""
        power = {Falloff.NONE: 0, Falloff.EPANECHNIKOV: 1, Falloff.SILVERMAN: 2}[self]
        return np.maximum(1 - x_squared, 0) ** power


@dataclasses.dataclass(frozen=True, eq=False)
class PointKernel:
    """What becomes of a point's light, in squares of 1/SUBPIXELS of a pixel."""

    rgb: Float[np.ndarray, "3 k k"]
    """Light in each square, k odd. Its luminance adds up to 1, less what the veil takes."""


LightMixture = tuple[tuple[PointKernel, float], ...]
"""The kernel of a spectrum: prepared kernels and their weights, which add up to 1."""


@dataclasses.dataclass(frozen=True)
class Place:
    """Where a light falls on the image plane and how bright it is there."""

    x_px: float
    y_px: float
    radius_px: float
    cd_m2: float
    """Luminance if all its light were in one pixel: its illuminance over the solid angle of the pixel there."""


def place(light: Light, view: View) -> Place | None:
    """A light's place, which may lie outside the frame; None behind the image plane."""
    forward = math.cos(math.radians(light.azimuth_deg)) * math.cos(math.radians(light.elevation_deg))
    if forward <= 1e-3:
        return None
    # A pixel's solid angle falls with the cube of the cosine; so do a disc's pixels become more.
    steradians = forward**3 / view.focal_px**2
    radius_px = math.radians(light.radius_deg) / math.sqrt(steradians)
    return Place(*view.pixel_of(light.azimuth_deg, light.elevation_deg), radius_px, light.illuminance_lx / steradians)


def draw_lights(
    onto: Float[Array, "3 y x"],
    lights: Sequence[Light],
    view: View,
    kernel_of_spectrum: Callable[[str], LightMixture],
    falloff: Falloff = Falloff.NONE,
) -> Float[Array, "3 y x"]:
    """A frame in cd/m² with lights added, each with the glare of its kernel, but for the veil.

    A disc of more than LARGEST_LAYER pixels is convolved on its own: exact, but it takes a second where it covers a
    frame.
    """
    splats: dict[tuple[PointKernel, int], list[tuple[Place, float]]] = defaultdict(list)
    large: list[tuple[PointKernel, Place, float]] = []
    for light in lights:
        at = place(light, view)
        if at is None:
            continue
        for kernel, weight in kernel_of_spectrum(light.spectrum):
            if at.radius_px > LARGEST_LAYER:
                large.append((kernel, at, at.cd_m2 * weight))
            else:
                for layer, share in _layers(at.radius_px):
                    splats[kernel, layer].append((at, at.cd_m2 * weight * share))
    image = jnp.array(onto, copy=True)
    for (kernel, layer), parts in splats.items():
        image = _splatted(image, parts, phases(kernel, layer, falloff))
    for kernel, at, cd_m2 in large:
        image = image + cd_m2 * _large_disc(at, kernel, falloff, image.shape[1:])
    return image


def _layers(radius_px: float) -> list[tuple[int, float]]:
    """The prepared discs on either side of a radius and their shares.

    KRI interpolates in the radius; in its square instead, the light far from the disc is right to second order.
    """
    low = min(int(radius_px), LARGEST_LAYER - 1)
    share = (radius_px**2 - low**2) / ((low + 1) ** 2 - low**2)
    return [(layer, weight) for layer, weight in ((low, 1 - share), (low + 1, share)) if weight > 0]


def _splatted(
    image: Float[Array, "3 y x"], parts: Sequence[tuple[Place, float]], kernels: Float[Array, "s 3 1 j k"]
) -> Float[Array, "3 y x"]:
    """Lights between the four sub-pixels whose middles lie around each of them."""
    radius = kernels.shape[3] // 2
    # A light further out reaches nothing, however far that is.
    limit = np.array(image.shape[1:]) + radius
    position = np.array([[at.y_px, at.x_px] for at, _ in parts])
    reaches = ((position > -radius - 1) & (position < limit + 1)).all(axis=1)
    part, share = np.divmod(position[reaches] * SUBPIXELS - 0.5, 1)
    cd_m2 = np.array([value for _, value in parts])[reaches]
    for down, right in np.ndindex(2, 2):
        pixel, phase = np.divmod(part.astype(np.int64) + np.array([down, right]), SUBPIXELS)
        weight = np.abs(1 - down - share[:, 0]) * np.abs(1 - right - share[:, 1])
        inside = ((pixel >= -radius) & (pixel < limit)).all(axis=1)
        which = phase[:, 0] * SUBPIXELS + phase[:, 1]
        value = (cd_m2 * weight).astype(np.float32)[:, None]
        image = splat.splat(image, pixel[inside], which[inside], value[inside], kernels)
    return image


@functools.lru_cache(maxsize=16)
def phases(kernel: PointKernel, layer: int, falloff: Falloff) -> Float[Array, "s 3 1 j k"]:
    """What a light in the middle of each sub-pixel puts into the pixels around: a disc of `layer` pixels or a point."""
    fine = _weighed(kernel, falloff).astype(np.float64)
    if layer:
        fine = _convolved(fine, disc(layer * SUBPIXELS, 0.0, 0.0)[None])
    side = fine.shape[1]
    radius = -(-(side // 2) // SUBPIXELS)
    summed = np.pad(fine, ((0, 0), (1, 0), (1, 0))).cumsum(axis=1).cumsum(axis=2)
    result = np.empty((SUBPIXELS, SUBPIXELS, 3, 1, 2 * radius + 1, 2 * radius + 1), np.float32)
    edges = (np.arange(2 * radius + 2) - radius) * SUBPIXELS + side // 2
    for down, right in np.ndindex(SUBPIXELS, SUBPIXELS):
        rows, columns = np.clip(edges - down, 0, side), np.clip(edges - right, 0, side)
        result[down, right, :, 0] = np.diff(np.diff(summed[:, rows[:, None], columns], axis=1), axis=2)
    return jnp.asarray(result.reshape(-1, *result.shape[2:]))


def _weighed(kernel: PointKernel, falloff: Falloff) -> Float[np.ndarray, "3 k k"]:
    middle = kernel.rgb.shape[1] // 2
    offset_squared = ((np.arange(2 * middle + 1) - middle) / (middle + 1)) ** 2
    if falloff is Falloff.NONE:
        return kernel.rgb
    weighed = kernel.rgb * falloff.weight(offset_squared[:, None] + offset_squared)
    weighed[:, middle, middle] += (kernel.rgb - weighed).sum(axis=(1, 2))
    return weighed


def disc(radius: float, down: float, right: float) -> Float[np.ndarray, "j k"]:
    """Shares of a disc's light in squares of side 1 around a middle one; its centre lies `down` and `right` of that.

    Squares on the edge get their part by its distance from them, within 2 % of a square of the exact area.
    """
    reach = math.ceil(radius) + 1
    offset = np.arange(-reach, reach + 1)
    away = np.hypot((offset - down)[:, None], offset - right)
    covered = np.clip(radius + 0.5 - away, 0, 1)
    return covered / covered.sum()


def _volume(at: Place) -> float:
    """Of a disc with a ramp of one pixel for an edge, summed over the pixels it covers."""
    if at.radius_px > SUMMED_PX:
        return math.pi * (at.radius_px**2 + 1 / 12)
    offset = np.arange(-SUMMED_PX - 2, SUMMED_PX + 3) + 0.5
    away = np.hypot((offset - at.y_px % 1)[:, None], offset - at.x_px % 1)
    return float(np.clip(at.radius_px + 0.5 - away, 0, 1).sum())


def _large_disc(at: Place, kernel: PointKernel, falloff: Falloff, size: tuple[int, ...]) -> Float[np.ndarray, "3 y x"]:
    """What a large disc of luminance 1 puts into a frame, float32: no more of it is made than reaches the frame."""
    middle = np.asarray(phases(kernel, 0, falloff)[SUBPIXELS**2 // 2, :, 0], np.float64)
    reach = middle.shape[1] // 2
    y, x = (np.arange(-reach, side + reach) + 0.5 for side in size)
    covered = np.clip(at.radius_px + 0.5 - np.hypot((y - at.y_px)[:, None], x - at.x_px), 0, 1)
    if not covered.any():
        return np.zeros((3, *size), np.float32)
    covered /= _volume(at)
    return _convolved(covered[None], middle, "valid").astype(np.float32)


def _convolved(
    one: NDArray[np.float64], two: NDArray[np.float64], mode: Literal["full", "valid"] = "full"
) -> NDArray[np.float64]:
    # Imported here, since it takes a second and most frames have no discs.
    from scipy.signal import fftconvolve

    return np.asarray(fftconvolve(one, two, mode=mode, axes=(1, 2)))
