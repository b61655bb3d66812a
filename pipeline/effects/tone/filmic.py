"""The ACES filmic curve, of each component or of luminance alone."""

from __future__ import annotations

import functools
import math
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.fast_math import clip, smaller

REFERENCE_PEAK_CD_M2 = 100.0
"""The peak that the ACES fit is made for."""
MIDDLE_GREY = 0.18
"""What a brighter display shows at the same luminance as the reference, 1 being reference white (Reinhard 2002)."""
FLAT = 1e4
"""Exposed values end here: the curve is flat, and its square would overflow for a sun."""
FULL = (0.56 + math.sqrt(0.56**2 + 4 * 0.08 * 0.14)) / (2 * 0.08)
"""Where the curve reaches 1: x·(2.51·x + 0.03) = x·(2.43·x + 0.59) + 0.14."""

Values = TypeVar("Values", Array, NDArray[np.float64])


def curve(x: Values) -> Values:
    """The ACES filmic curve as real-time renderers fit it (Narkowicz 2016): 0 at 0, monotonic, towards 1.033."""
    return x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)


def display_scale(peak_cd_m2: float | Array) -> Float[Array, ""]:
    """What exposed values are multiplied by for a display of this peak.

    Above the reference, such that middle grey keeps its luminance and what is brighter has the room up to the peak.
    Contrast rises around it; the foot of the curve is straight, so what is nearly black becomes lighter. Below it 1:
    the whole picture is as much darker as the peak is.
    """
    y = jnp.minimum(curve(jnp.asarray(MIDDLE_GREY)), 1) * jnp.minimum(REFERENCE_PEAK_CD_M2 / peak_cd_m2, 1)
    # The curve solved for x: (2.51 − 2.43y)·x² + (0.03 − 0.59y)·x − 0.14y = 0.
    square, linear = 2.51 - 2.43 * y, 0.03 - 0.59 * y
    return (jnp.sqrt(linear * linear + 0.56 * y * square) - linear) / (2 * square * MIDDLE_GREY)


@functools.cache
def display_scale_of(peak_cd_m2: float) -> float:
    """The same as a number, kept: a call of JAX for one number takes longer than a bound may."""
    return float(display_scale(peak_cd_m2))


def shown(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """The curve as a display ends it, at 1, of a frame's tiles."""
    # In place, as `slope`: new arrays of a frame's tiles cost more than what is computed in them.
    x = np.minimum(x, FLAT)
    bottom = 2.43 * x
    bottom += 0.59
    bottom *= x
    bottom += 0.14
    top = 2.51 * x
    top += 0.03
    top *= x
    top /= bottom
    return np.minimum(top, 1, out=top)


def slope(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """The curve's derivative: rises from 0.21 at 0 to 1.80 at INFLECTION, and falls from there."""
    root = 2.43 * x
    root += 0.59
    root *= x
    root += 0.14
    top = 1.408 * x
    top += 0.7028
    top *= x
    top += 0.0042
    top /= root
    top /= root
    return top


def _inflection() -> float:
    numerator, denominator = np.poly1d([1.408, 0.7028, 0.0042]), np.poly1d([2.43, 0.59, 0.14])
    bend = numerator.deriv() * denominator - 2 * numerator * denominator.deriv()
    return float(max(bend.roots.real))


INFLECTION = _inflection()
"""Where the curve is steepest, 0.120."""


def steepest(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """The largest slope between two places."""
    # Quicker than `clip` with arrays for limits.
    return slope(np.minimum(np.maximum(low, INFLECTION), high))


def gain(y: Float[Array, "eye y x"], scale: Float[Array, "eye 1 1"]) -> Float[Array, "eye y x"]:
    """The curve of luminance over luminance, for hues that are kept: L_d/L, finite at 0."""
    x = y * scale
    # From FULL on the curve lies above 1 and the second is the smaller.
    return scale * smaller(_per_x(smaller(x, np.float32(FLAT))), 1 / x)


def _per_x(x: Values) -> Values:
    """The curve over its argument."""
    return (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)


def gains(
    low: NDArray[np.float64], high: NDArray[np.float64], scale: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The least and the largest gain between two luminances: it rises to a crest and falls from there."""
    low, high = low * scale, high * scale
    ends = _gain_at(low), _gain_at(high)
    return scale * np.minimum(*ends), scale * _gain_at(np.minimum(np.maximum(low, _CREST), high))


def gain_slope(low: NDArray[np.float64], high: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    """No less than the largest slope of the gain between two luminances, up or down.

    Up it is steepest at the low end, down at _TURN or what lies nearest to it. From FULL on the gain is 1/x, whose
    slope is 1.034 times that of the curve over x at most.
    """
    low, high = low * scale, high * scale
    fall = _per_x_slope(np.minimum(np.maximum(low, _TURN), high))
    return np.asarray(1.035 * scale * scale * np.maximum(np.abs(fall), _per_x_slope(low)))


def _gain_at(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.minimum(_per_x(np.minimum(x, FLAT)), 1 / np.maximum(x, 1e-30))


def _per_x_slope(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return (0.3337 - x * (6.0993 * x + 0.1458)) / (x * (2.43 * x + 0.59) + 0.14) ** 2


_CREST, _TURN = 0.22225723, 0.42618832
"""Where the curve over its argument is largest, and where it falls fastest; tests find both by search."""


@jax.jit
def aces(rgb: Float[Array, "eye 3 y x"], exposure: Float[Array, "eye"], peak_cd_m2: float) -> Float[Array, "eye 3 y x"]:
    """A frame in cd/m² as the display shows it, linear, 1 = the display's peak.

    `exposure` in 1/(cd/m²) brings each eye's frame to where 1 is the reference white of 100 cd/m².
    """
    scale = (exposure * display_scale(peak_cd_m2)).astype(jnp.float32)
    # Spectral colours of glare lie outside the display's, below 0.
    return component(rgb * scale[:, None, None, None])


def component(exposed: Float[Array, "..."]) -> Float[Array, "..."]:
    """What the display shows of a component by itself."""
    return smaller(curve(clip(exposed, 0, FLAT)), np.float32(1))


def ceiling_cd_m2(exposure: float, peak_cd_m2: float) -> float:
    """The scene's luminance from which on the display shows its peak."""
    return FULL / (float(exposure) * display_scale_of(float(peak_cd_m2)))
