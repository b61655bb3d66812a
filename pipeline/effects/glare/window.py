"""Glare of all light in a window around the gaze, or of the whole frame, by FFT.

The window is LUI's (5.2.3): an FFT of 1024 pixels on a display of 1440 px over 104°, 42° to either side in the middle
of the view; the same angle on other displays. Light scatters in full within half the window's reach of the gaze and
less and less further out. The falloff weighs the light that is scattered, not the result: no light is lost or made, and
a lamp that crosses the window's edge has no glare there to jump.

The window needs no padding: light scatters up to its reach, lands up to one kernel's radius further, and there the
window ends. What wraps round lands in the window outside the square that light can land in, and is dropped.

**Rounding.** An FFT spreads its rounding, a share of the brightest light, over everything it covers: in float32 the sun
would veil the darkest corner with noise. So of a frame that holds light too bright for that, what lies above the limit
is laid down pixel by pixel; and where that is too many pixels, all light is transformed in float64.

Both are instant: a frame depends on no other.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare import convolve, splat
from entoptic.pipeline.effects.glare.kernel import Mixture
from entoptic.pipeline.fft_length import fft_length
from entoptic.pipeline.frame import View
from entoptic.pipeline.measure import Measurement, luminance

WINDOW_PX = 1024
"""Side of the gaze window's FFT on LUI's display (LUI 5.2.3)."""
WINDOW_FOCAL_PX = 720 / math.tan(math.radians(52))
"""That display's focal length: 1440 px over 104°."""

ROUNDING = 1e-9
"""Largest rounding of a float32 convolution where it should be 0, as a share of the light's brightest pixel. Measured
in 1024²: 4e-11·√n for n lit pixels; many more than 600 of them have a veil that drowns it."""
UNSEEN_CD_M2, UNSEEN_SHARE = 1e-5, 1e-4
"""Noise that no eye sees: in cd/m², and as a share of the luminance that half the frame has. Engineering choice: below
the absolute threshold of rods, and a hundredth of the least contrast that is seen."""
MOST_LAID_DOWN = 256
"""Pixels laid down at most. Engineering choice: more take longer than transforming all light in float64."""


@dataclasses.dataclass(frozen=True)
class Window:
    """The part of a frame that is convolved, and the FFT that holds it."""

    rows: int
    columns: int
    fft_rows: int
    fft_columns: int
    reach_px: float
    """How far from the gaze light still scatters; infinite for a whole frame."""
    lands_px: float
    """Half the square around the gaze that it can land in."""
    radius_px: int


def window_of(view: View, radius_px: int) -> Window:
    """The gaze window of a kernel of this radius."""
    # Never less than two radii either side of the gaze: a frame of a few pixels has a window too.
    side = fft_length(max(round(WINDOW_PX * view.focal_px / WINDOW_FOCAL_PX), 4 * radius_px), "real")
    rows, columns = min(view.height_px, side), min(view.width_px, side)
    whole = frame_window(view, radius_px)
    return Window(
        rows,
        columns,
        min(fft_length(side, "complex64"), whole.fft_rows),
        min(side, whole.fft_columns),
        side / 2 - radius_px,
        side / 2,
        radius_px,
    )


def frame_window(view: View, radius_px: int) -> Window:
    """The whole frame, padded by a kernel's radius or by what of it reaches from one edge to the other."""
    rows, columns = view.height_px, view.width_px
    return Window(
        rows,
        columns,
        fft_length(rows + min(radius_px, rows - 1), "complex64"),
        fft_length(columns + min(radius_px, columns - 1), "real"),
        math.inf,
        math.inf,
        radius_px,
    )


def glare_window(
    rgb: Float[Array, "3 y x"],
    view: View,
    mixture: Mixture,
    gaze_px: tuple[float, float],
    measured: Measurement,
    *,
    ceiling_cd_m2: float | None = None,
    onto: Float[Array, "3 y x"] | None = None,
) -> Float[Array, "3 y x"]:
    """A frame in cd/m² with what a kernel makes of the light in the window around the gaze (x, y) px.

    The gaze may lie anywhere. Above a `ceiling_cd_m2`, only the light above it spreads. The change is added to `onto`,
    whose memory the result takes over; to a copy of the frame if None.
    """
    return _glare(rgb, view, mixture, window_of(view, _radius(mixture)), gaze_px, measured, ceiling_cd_m2, onto)


def glare_frame(
    rgb: Float[Array, "3 y x"],
    view: View,
    mixture: Mixture,
    measured: Measurement,
    *,
    ceiling_cd_m2: float | None = None,
    onto: Float[Array, "3 y x"] | None = None,
) -> Float[Array, "3 y x"]:
    """A frame in cd/m² with what a kernel makes of all its light, wherever the eye looks; as glare_window."""
    whole = frame_window(view, _radius(mixture))
    return _glare(rgb, view, mixture, whole, (0.0, 0.0), measured, ceiling_cd_m2, onto)


def rectangle_px(view: View, mixture: Mixture, gaze_px: tuple[float, float]) -> tuple[int, int, int, int]:
    """Left, top, width and height of the part of a frame that the gaze window convolves."""
    window = window_of(view, _radius(mixture))
    left, top = _corner(gaze_px[0], window.columns, view.width_px), _corner(gaze_px[1], window.rows, view.height_px)
    return left, top, window.columns, window.rows


def _radius(mixture: Mixture) -> int:
    return mixture[0][0].scatters.shape[2] // 2


def _glare(
    rgb: Float[Array, "3 y x"],
    view: View,
    mixture: Mixture,
    window: Window,
    gaze_px: tuple[float, float],
    measured: Measurement,
    ceiling_cd_m2: float | None,
    onto: Float[Array, "3 y x"] | None,
) -> Float[Array, "3 y x"]:
    limit_cd_m2 = float32_limit_cd_m2(measured)
    dtype: convolve.Precision = "float32"
    apart = None
    if measured.max_cd_m2 > limit_cd_m2:
        at, light = splat.bright_pixels(rgb, limit_cd_m2)
        if len(at) > MOST_LAID_DOWN:
            dtype = "float64"
        else:
            apart = at
    corner = (_corner(gaze_px[1], window.rows, view.height_px), _corner(gaze_px[0], window.columns, view.width_px))
    reach = window.rows - 1, window.columns - 1
    rows = window.fft_rows if dtype == "float32" else fft_length(window.fft_rows, "complex128")
    size = rows, window.fft_columns
    gaze_yx = np.array([gaze_px[1], gaze_px[0]], np.float32)
    # Three steps compiled apart: in one, XLA makes some of their passes on one core alone, for half as long again.
    scattering = _scattering(
        rgb,
        gaze_yx,
        corner,
        None if ceiling_cd_m2 is None else np.float32(ceiling_cd_m2),
        None if apart is None else _inside(apart, corner, window),
        window,
        dtype,
    )
    transforms = tuple(convolve.transform(component, *size, reach, dtype) for component, _ in mixture)
    arrives = convolve.spread(scattering, transforms, convolve.weights(mixture, dtype), window.fft_columns)
    result = _land(
        jnp.array(rgb, copy=True) if onto is None else onto,
        scattering,
        arrives,
        convolve.staying(mixture).astype(dtype),
        gaze_yx,
        corner,
        window,
    )
    if apart is None:
        return result
    away_px = np.hypot(at[:, 0] + 0.5 - gaze_px[1], at[:, 1] + 0.5 - gaze_px[0])
    share = falloff(away_px / window.reach_px)
    if ceiling_cd_m2 is not None:
        share = share * convolve.spill_share(splat.luminances(light), ceiling_cd_m2)
    scatters = share > 0
    return splat.lay_down(result, at[scatters], (light * share[:, None])[scatters].astype(np.float32), mixture)


def float32_limit_cd_m2(measured: Measurement) -> float:
    """The luminance up to which light may be convolved in float32."""
    typical_cd_m2 = float(np.median(measured.tile_mean_cd_m2))
    return max(UNSEEN_CD_M2, UNSEEN_SHARE * typical_cd_m2) / ROUNDING


def _corner(gaze_px: float, side_px: int, frame_px: int) -> int:
    return round(min(max(gaze_px - side_px / 2, 0), frame_px - side_px))


def _inside(at: NDArray[np.intp], corner: tuple[int, int], window: Window) -> NDArray[np.int64]:
    """The pixels within the window, padded to one number by places that lie outside it."""
    places = np.full((MOST_LAID_DOWN, 2), window.rows + window.columns)
    places[: len(at)] = at - np.array(corner)
    places[(places < 0).any(axis=1)] = window.rows + window.columns
    return places


@functools.partial(jax.jit, static_argnames=("window", "dtype"))
def _scattering(
    rgb: Float[Array, "3 y x"],
    gaze_yx: Float[Array, "2"],
    corner: tuple[int, int],
    ceiling_cd_m2: float | None,
    apart: Int[Array, "n 2"] | None,
    window: Window,
    dtype: convolve.Precision,
) -> Float[Array, "3 rows columns"]:
    """The light within the window that is convolved: weighed by the falloff, above the ceiling, without that apart."""
    light = jax.lax.dynamic_slice(rgb, (0, *corner), (3, window.rows, window.columns))
    if ceiling_cd_m2 is not None:
        light = light * convolve.spill_share(luminance(light), ceiling_cd_m2)
    if apart is not None:
        light = light.at[:, apart[:, 0], apart[:, 1]].set(0, mode="drop")
    if math.isfinite(window.reach_px):
        dy, dx = _away(gaze_yx, corner, window)
        light = light * falloff(jnp.sqrt(dy[:, None] ** 2 + dx[None, :] ** 2) / np.float32(window.reach_px))
    return light.astype(dtype)


@functools.partial(jax.jit, static_argnames="window", donate_argnames="onto")
def _land(
    onto: Float[Array, "3 y x"],
    scattering: Float[Array, "3 rows columns"],
    arrives: Float[Array, "3 v u"],
    staying: Float[Array, "3 3"],
    gaze_yx: Float[Array, "2"],
    corner: tuple[int, int],
    window: Window,
) -> Float[Array, "3 y x"]:
    """Adds what scattering changes: where the light came from and where it arrives."""
    arrives = arrives[:, : window.rows, : window.columns]
    dy, dx = _away(gaze_yx, corner, window)
    lands = (jnp.abs(dy) < window.lands_px)[:, None] & (jnp.abs(dx) < window.lands_px)[None, :]
    # Where rounding leaves less than nothing, nothing arrives.
    lands = lands & (luminance(arrives) > 0)
    change = convolve.through(staying[:, :, None, None], scattering) + jnp.where(lands, arrives, 0)
    start = (0, *corner)
    now = jax.lax.dynamic_slice(onto, start, (3, window.rows, window.columns))
    return jax.lax.dynamic_update_slice(onto, (now + change).astype(jnp.float32), start)


def _away(
    gaze_yx: Float[Array, "2"], corner: tuple[int, int], window: Window
) -> tuple[Float[Array, "rows"], Float[Array, "columns"]]:
    """How far the window's rows and columns lie from the gaze, in pixels."""
    dy = jnp.arange(window.rows, dtype=jnp.float32) + 0.5 + (corner[0] - gaze_yx[0])
    dx = jnp.arange(window.columns, dtype=jnp.float32) + 0.5 + (corner[1] - gaze_yx[1])
    return dy, dx


def falloff(share_of_reach: convolve.Values) -> convolve.Values:
    """1 within half the reach, 0 from the reach on, a smooth step in between."""
    position = (2 - 2 * share_of_reach).clip(0, 1)
    return position * position * (3 - 2 * position)
