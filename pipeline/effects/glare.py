"""Light that the eye scatters away from where it belongs.

The kernel is the eye's point-spread function over display pixels. Of its central pixel, what stands above its
neighbours is light that stays where it belongs: it multiplies the frame and is kept out of the FFT, whose rounding
would spread a part of every light over the whole frame.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import scipy.fft
from jaxtyping import Array, Complex, Float

from pipeline.frame import View
from pipeline.observer import Observer
from pipeline.optics import analytic, aperture, diffraction, spectrum

WINDOW_PX = 1024
"""Side of the gaze window's FFT on LUI's display (LUI §5.2.3)."""
WINDOW_FOCAL_PX = 720 / math.tan(math.radians(52))
"""That display's focal length: 1440 px over 104°. On others the window covers the same angle, 42° around the gaze."""
GRID = 2048
"""Samples along the pupil plane: the least power of two that resolves the lens fibres."""
PUPIL_STEP_MM = 0.25
"""Kernels are computed at these diameters and blended in between: a pupil in motion costs no FFT of its plane."""


@dataclasses.dataclass(frozen=True)
class Scattering:
    """Bounds of a kernel: all that planning needs to know of it."""

    share: float
    """No pixel's luminance changes by more than this share of the frame's largest.

    A pixel loses what it scatters itself and gets what the others scatter to it. Both are positive, so the change is no
    more than the larger of the two, whatever the frame, the light beyond its edges and the window's falloff.
    """
    stays: float
    """Least share of a point's light that stays in its pixel."""


@dataclasses.dataclass(frozen=True)
class Kernel:
    """A point-spread function over pixels, taken apart into what stays and what scatters. c channels, 1 or 3."""

    stays: Float[Array, "c"]
    """Share of the light that stays in its pixel."""
    scatters: Float[Array, "c j k"]
    """Where the rest goes; with `stays` it adds up to 1 or, for a kernel cut at the frame, to less."""

    @functools.cached_property
    def bounds(self) -> Scattering:
        """How much light this kernel can move."""
        scatters = np.asarray(self.scatters, np.float64)
        middle = scatters[:, scatters.shape[1] // 2, scatters.shape[2] // 2]
        stays = float((np.asarray(self.stays, np.float64) + middle).min())
        # A pixel gets at most the brightest luminance from all others, each time in the colour that scatters most.
        gets = float(scatters.max(axis=0).sum() - middle.max())
        return Scattering(max(1 - stays, gets), stays)


@dataclasses.dataclass(frozen=True)
class Window:
    """The part of a frame that the window covers, and the FFT that holds it without wrapping round."""

    rows: int
    columns: int
    fft_rows: int
    fft_columns: int
    reach_px: float
    """How far from the gaze light still scatters."""
    kernel_rows: int
    kernel_columns: int
    """The kernel's sides: no more of it than reaches from one end of the window to the other."""


def split(kernel: Float[Array, "c j k"]) -> Kernel:
    """Takes the light that stays out of a kernel of odd sides: what its centre has above its brightest neighbour."""
    _, high, wide = kernel.shape
    y, x = high // 2, wide // 2
    around = kernel[:, max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
    neighbours = jnp.where(jnp.arange(around[0].size).reshape(around.shape[1:]) == around[0].size // 2, 0, around)
    middle = jnp.minimum(neighbours.max(axis=(1, 2)), kernel[:, y, x])
    scatters = kernel.at[:, y, x].set(middle).astype(jnp.float32)
    return Kernel((kernel[:, y, x] - middle).astype(jnp.float32), scatters)


@functools.lru_cache(maxsize=16)
def wave_kernel(observer: Observer, step: int, pixels_per_deg: float) -> Kernel:
    """The kernel of an observer's eye with a pupil of `step` × PUPIL_STEP_MM, by wave optics."""
    structure = aperture.eye_structure(observer, GRID)
    plane = aperture.pupil_plane(structure, jnp.float32(step * PUPIL_STEP_MM * 1e-3), GRID)
    return split(spectrum.rgb_kernel(diffraction.point_spread(plane), pixels_per_deg))


@functools.lru_cache(maxsize=16)
def _wave_transform(observer: Observer, step: int, pixels_per_deg: float, window: Window) -> Complex[Array, "3 u v"]:
    scatters = wave_kernel(observer, step, pixels_per_deg).scatters
    y = (scatters.shape[1] - window.kernel_rows) // 2
    x = (scatters.shape[2] - window.kernel_columns) // 2
    reaching = scatters[:, y : y + window.kernel_rows, x : x + window.kernel_columns]
    return transform(reaching, window.fft_rows, window.fft_columns)


def pupil_steps(pupil_mm: float) -> tuple[int, int, float]:
    """The two kernels on either side of a pupil diameter, clamped to 2–8 mm, and the share of the second."""
    low, high = aperture.PUPIL_RANGE_MM
    position = min(max(pupil_mm, low), high) / PUPIL_STEP_MM
    step = min(int(position), round(high / PUPIL_STEP_MM) - 1)
    return step, step + 1, position - step


def wave_bounds(observer: Observer, pupil_mm: float, view: View) -> Scattering:
    """How much light wave-optics glare can move, at this pupil."""
    low, high, _ = pupil_steps(pupil_mm)
    bounds = [wave_kernel(observer, step, view.ppd_centre).bounds for step in (low, high)]
    return Scattering(max(bound.share for bound in bounds), min(bound.stays for bound in bounds))


def window_of(view: View, radius_px: int) -> Window:
    """The window of a kernel of this radius in a view."""
    side = max(round(WINDOW_PX * view.focal_px / WINDOW_FOCAL_PX) - radius_px, 3 * radius_px)
    rows, columns = min(view.height_px, side), min(view.width_px, side)
    radius_y, radius_x = min(radius_px, rows - 1), min(radius_px, columns - 1)
    return Window(
        rows=rows,
        columns=columns,
        # What scatters out of the window is dropped, so one radius of padding keeps it from wrapping round into it.
        fft_rows=scipy.fft.next_fast_len(rows + radius_y, real=True),
        fft_columns=scipy.fft.next_fast_len(columns + radius_x, real=True),
        reach_px=side / 2 - radius_px,
        kernel_rows=2 * radius_y + 1,
        kernel_columns=2 * radius_x + 1,
    )


def wave_glare(
    rgb: Float[Array, "3 y x"], view: View, observer: Observer, pupil_mm: float, gaze_px: tuple[float, float]
) -> Float[Array, "3 y x"]:
    """A frame in cd/m² with wave-optics glare of the lights in the window around the gaze.

    Light scatters in full within half the window's reach of the gaze and less and less further out (LUI §5.2.3). The
    falloff weighs the light that is scattered, not the result: so no light is lost or made, and a lamp that crosses
    the window's edge has no glare there to jump.
    """
    low, high, share = pupil_steps(pupil_mm)
    pixels_per_deg = view.ppd_centre
    window = window_of(view, spectrum.kernel_radius_px(GRID, pixels_per_deg))
    stays = [wave_kernel(observer, step, pixels_per_deg).stays for step in (low, high)]
    transforms = [_wave_transform(observer, step, pixels_per_deg, window) for step in (low, high)]
    x, y = gaze_px
    corner = (_corner(y, window.rows, view.height_px), _corner(x, window.columns, view.width_px))
    return _scatter_window(rgb, transforms, stays, share, (y, x), corner, window)


def _corner(gaze_px: float, side_px: int, frame_px: int) -> int:
    return round(min(max(gaze_px - side_px / 2, 0), frame_px - side_px))


@functools.partial(jax.jit, static_argnames=("rows", "columns"))
def transform(scatters: Float[Array, "c j k"], rows: int, columns: int) -> Complex[Array, "c u v"]:
    """A kernel's FFT, its centre at the origin."""
    channels, high, wide = scatters.shape
    padded = jnp.zeros((channels, rows, columns), jnp.float32).at[:, :high, :wide].set(scatters)
    return jnp.fft.rfft2(jnp.roll(padded, (-(high // 2), -(wide // 2)), (1, 2)))


@functools.partial(jax.jit, static_argnames="window")
def _scatter_window(
    rgb: Float[Array, "3 y x"],
    transforms: list[Complex[Array, "3 u v"]],
    stays: list[Float[Array, "3"]],
    share: float,
    gaze_yx: tuple[float, float],
    corner: tuple[int, int],
    window: Window,
) -> Float[Array, "3 y x"]:
    share = jnp.float32(share)
    kernel = transforms[0] * (1 - share) + transforms[1] * share
    staying = stays[0] * (1 - share) + stays[1] * share
    start = (0, *corner)
    light = jax.lax.dynamic_slice(rgb, start, (3, window.rows, window.columns))
    dy = jnp.arange(window.rows, dtype=jnp.float32) + 0.5 + (corner[0] - jnp.float32(gaze_yx[0]))
    dx = jnp.arange(window.columns, dtype=jnp.float32) + 0.5 + (corner[1] - jnp.float32(gaze_yx[1]))
    away = jnp.sqrt(dy[:, None] ** 2 + dx[None, :] ** 2) / np.float32(window.reach_px)
    weighed = light * _falloff(away)
    result = light - (1 - staying)[:, None, None] * weighed + convolve(weighed, kernel, window.fft_columns)
    return jax.lax.dynamic_update_slice(rgb, result, start)


def _falloff(share_of_reach: Float[Array, "y x"]) -> Float[Array, "y x"]:
    """1 within half the reach, 0 from the reach on, a smooth step in between."""
    position = jnp.clip(2 - 2 * share_of_reach, 0, 1)
    return position * position * (3 - 2 * position)


def convolve(light: Float[Array, "3 y x"], kernel: Complex[Array, "3 u v"], columns: int) -> Float[Array, "3 y x"]:
    """Convolution with a kernel transformed at a padded size of `columns` columns, cropped to the light's own size.

    Where there is neither light nor a negative kernel, rounding must not make negative light.
    """
    spectrum_of_light = jnp.fft.rfft2(light, s=(kernel.shape[1], columns))
    spread = jnp.fft.irfft2(spectrum_of_light * kernel, s=(kernel.shape[1], columns))
    return jnp.maximum(spread[:, : light.shape[1], : light.shape[2]], 0)


@functools.lru_cache(maxsize=2)
def _analytic_parts(view: View) -> tuple[list[Kernel], list[Complex[Array, "c u v"]], int]:
    """SPE's components, one channel each or three for the halo, their transforms, and the FFT's columns.

    The kernel reaches from any pixel to any other: light that lands beyond it leaves the frame.
    """
    radii = view.height_px - 1, view.width_px - 1
    rows, columns = (scipy.fft.next_fast_len(2 * radius + 1, real=True) for radius in radii)
    kernels = [split(jnp.asarray(part)) for part in analytic.spe_components(view.ppd_centre, *radii)]
    transforms = [transform(kernel.scatters, rows, columns) for kernel in kernels]
    return kernels, transforms, columns


def analytic_bounds(view: View, adapted_cd_m2: float, age_years: float) -> Scattering:
    """How much light SPE's glare can move."""
    weights = analytic.spe_weights(adapted_cd_m2, age_years)
    bounds = [kernel.bounds for kernel in _analytic_parts(view)[0]]
    return Scattering(
        sum(float(weight) * bound.share for weight, bound in zip(weights, bounds, strict=True)),
        sum(float(weight) * bound.stays for weight, bound in zip(weights, bounds, strict=True)),
    )


def analytic_glare(
    rgb: Float[Array, "3 y x"], view: View, adapted_cd_m2: float, age_years: float
) -> Float[Array, "3 y x"]:
    """A frame in cd/m² with SPE's glare of all its lights, wherever the eye looks."""
    kernels, transforms, columns = _analytic_parts(view)
    weights = analytic.spe_weights(adapted_cd_m2, age_years)
    return _scatter_frame(rgb, [kernel.stays for kernel in kernels], transforms, weights, columns)


@functools.partial(jax.jit, static_argnames="columns")
def _scatter_frame(
    rgb: Float[Array, "3 y x"],
    stays: list[Float[Array, "c"]],
    transforms: list[Complex[Array, "c u v"]],
    weights: Float[Array, "4"],
    columns: int,
) -> Float[Array, "3 y x"]:
    weights = weights.astype(jnp.float32)
    staying = jnp.asarray(sum(weights[k] * stays[k] for k in range(4)))
    kernel = jnp.asarray(sum(weights[k] * transforms[k] for k in range(4)))
    return rgb * staying[:, None, None] + convolve(rgb, kernel, columns)
