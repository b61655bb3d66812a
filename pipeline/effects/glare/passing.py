"""A part that serves for one frame: what an eye's motion adds to eyes at rest, prepared in a third of the time."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import jax
import numpy as np
import scipy.fft
from jaxtyping import Array
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare import kernel
from entoptic.pipeline.effects.glare.kernel import CORE_PER_PX, FALLS, FINE_PER_PX, Mixed, Part, Prepared, Sampled
from entoptic.pipeline.effects.glare.plane import Plane
from entoptic.pipeline.effects.glare.pyramid import around
from entoptic.pipeline.optics import whole

Reals = NDArray[np.float64]


class Passing(Part):
    """Such a part, without a veil. It is a few per cent of the light: its windows are looked up once a pixel, and not
    kept; its cells are few, and only their rows of the plane are transformed, in float32.
    """

    def kept(self, what: Any, make: Callable[[], Any]) -> Any:
        """What was made of it, made now if it was not."""
        if what[0] == "plane" and what[1].pool > 1:
            make = functools.partial(_prepare, self, what[1])
        return super().kept(what, make)


def _prepare(part: Part, plane: Plane) -> Prepared:
    """As kernel.prepared has it where pixels are pooled."""
    far = kernel.far_deg(plane)
    wider = max(1.0, far[1] / whole.VEIL_DEG[0])
    pixel_deg = plane.step_deg / plane.pool
    fine, fine_deg = kernel.near_cells(part, pixel_deg / FINE_PER_PX, far, wider)
    core, core_deg = kernel.core_cells(part, pixel_deg / CORE_PER_PX, far, wider)
    profile = kernel.profile_of(pixel_deg, core, core_deg, fine, fine_deg, far[1])
    stencils = kernel.levels(plane)
    bounds = [tuple(pixel_deg * edge * kernel.THEN**k for edge in kernel.FIRST_PX) for k in range(len(stencils))]
    taps = [kernel.taps_of(profile, plane, k, stencil, bounds) for k, stencil in enumerate(stencils)]
    leaves = sum(
        len(around(tap)) * of_tap
        for stencil, of_level in zip(stencils, taps, strict=True)
        for tap, of_tap in zip(stencil, of_level, strict=True)
    )
    fine_sr, core_sr = (np.radians(pixel_deg / per_px) ** 2 for per_px in (FINE_PER_PX, CORE_PER_PX))
    all_near = _on_device(fine.sum(axis=(2, 3)))
    return Prepared(
        *_far(part, plane, wider),
        None,
        Sampled(_on_device(fine / fine_sr), _on_device(core / core_sr)),
        Mixed(all_near, all_near, tuple(_on_device(of_level) for of_level in taps), _on_device(leaves)),
    )


def _on_device(values: Any) -> Array:
    return jax.device_put(np.float32(values))


def _far(part: Part, plane: Plane, wider: float) -> tuple[Array, Array]:
    """Transforms of A and B."""
    least = plane.least_scale
    # As far as they reach where angles are smallest.
    reach = whole.kernel_radius_px(1 / (plane.step_deg * least), wider)
    reach = min(reach, plane.height - 1, plane.width - 1)
    ends = []
    for scale in (1.0, least):
        side_deg = plane.step_deg * scale
        offset = np.arange(-reach, reach + 1) * side_deg
        density = part.cells(1 / side_deg, reach, wider) / (plane.step * scale) ** 2
        ends.append(density * kernel.smooth_step(np.hypot(offset[:, None], offset), *kernel.far_deg(plane)))
    high, turning = kernel.parted(ends[0], ends[1] * least**FALLS, np.ones(()), least)
    return transformed(high, plane), transformed(turning, plane)


def transformed(cells: Reals, plane: Plane) -> Array:
    """The FFT of cells around a point, with what is taken from them raised again as kernel.py does."""
    reach = cells.shape[-1] // 2
    at = np.arange(-reach, reach + 1)
    lit = np.zeros((*cells.shape[:3], plane.fft_width), np.float32)
    lit[..., at] = cells
    spectrum = np.zeros((*cells.shape[:2], plane.fft_height, plane.fft_width // 2 + 1), np.complex64)
    spectrum[:, :, at] = scipy.fft.rfft(lit)
    spectrum = scipy.fft.fft(spectrum, axis=-2, overwrite_x=True)
    spectrum *= _raising(plane)
    return jax.device_put(spectrum)


@functools.lru_cache(maxsize=8)
def _raising(plane: Plane) -> NDArray[np.float32]:
    """What kernel.py multiplies the transform of a point with."""
    point = np.zeros((1, 1, plane.fft_height, plane.fft_width))
    point[..., 0, 0] = 1
    return np.asarray(kernel.transform(point, plane, kernel.GAIN)).real.astype(np.float32)[0, 0]
