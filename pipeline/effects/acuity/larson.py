"""What an eye resolves at a luminance (Larson 1997), and the blur that takes the rest away (Krawczyk 2005)."""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike, NDArray

from entoptic.pipeline.fast_math import arctan

FLOOR_CD_M2 = 1e-6
"""Starlight. The fit is below 0 from 6e-10 cd/m² down; here it still resolves 0.76 cycles per degree."""
PER_CYCLE = 1.86
"""σ of a Gaussian of pixels is ppd/(1.86·R) where R cycles per degree are just lost (Krawczyk 2005; LUI 5.15)."""
SHARP_PX = 1 / 6
"""A Gaussian of this σ weighs its neighbours 1e-8: no blur in float32."""


def resolved_cpd(y_cd_m2: ArrayLike) -> NDArray[np.float64]:
    """R(Y): the highest frequency in cycles per degree that an eye resolves at a luminance (LUI 5.14)."""
    y = np.maximum(np.asarray(y_cd_m2, np.float64), FLOOR_CD_M2)
    return np.asarray(17.25 * np.arctan(1.4 * np.log10(y) + 0.35) + 25.72)


def variance_px2(y_cd_m2: ArrayLike, pixels_per_deg: float, display_limit: bool) -> NDArray[np.float64]:
    """σ² of the blur at a luminance.

    With the display's limit, σ² of the eye less σ² of a display that just shows its Nyquist frequency of ppd/2, by the
    same formula 1.08 px: Gaussian blurs one after the other add their σ², and the display's own is there already.
    Engineering choice: a plain switch at Nyquist would jump from 0 to 1.08 px there.
    """
    eye = (pixels_per_deg / (PER_CYCLE * resolved_cpd(y_cd_m2))) ** 2
    return np.asarray(np.maximum(eye - display_px2(display_limit), 0))


def display_px2(display_limit: bool) -> float:
    """σ² in px² that needs no blur: what the display itself does, or what no float32 shows."""
    return (2 / PER_CYCLE) ** 2 if display_limit else SHARP_PX**2


def limit_cd_m2(pixels_per_deg: float, display_limit: bool) -> float:
    """From this luminance on nothing is blurred; infinite where the display shows more than any eye resolves."""
    # R at which the eye's σ² is the display's, and the luminance of that R.
    resolved = pixels_per_deg / (PER_CYCLE * math.sqrt(display_px2(display_limit)))
    angle = (resolved - 25.72) / 17.25
    if angle >= math.pi / 2:
        return math.inf
    # Below the floor, no pixel counts as darker than it.
    if resolved <= float(resolved_cpd(0.0)):
        return 0.0
    return float(10 ** ((math.tan(angle) - 0.35) / 1.4))


def variance_map(
    y_cd_m2: Float[Array, "eye y x"], pixels_per_deg: Float[Array, ""], least_px2: Float[Array, ""]
) -> Float[Array, "eye y x"]:
    """variance_px2 of whole frames in float32; `least_px2` is what needs no blur."""
    log10 = jnp.log(jnp.maximum(y_cd_m2, np.float32(FLOOR_CD_M2))) * np.float32(1 / math.log(10))
    resolved = np.float32(17.25) * arctan(np.float32(1.4) * log10 + np.float32(0.35)) + np.float32(25.72)
    sigma = pixels_per_deg / (np.float32(PER_CYCLE) * resolved)
    return jnp.maximum(sigma * sigma - least_px2, 0)
