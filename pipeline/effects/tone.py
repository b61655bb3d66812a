"""From scene luminance to the display's, and the display's encoding."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt8

from pipeline.frame import Display

REFERENCE_PEAK_CD_M2 = 100.0
"""The peak that the ACES fit is made for."""
MIDDLE_GREY = 0.18
"""What a brighter display shows at the same luminance as the reference, 1 being reference white (Reinhard 2002)."""


def _aces(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """The ACES filmic curve as real-time renderers fit it (Narkowicz 2016): 0 at 0, monotonic, towards 1.033."""
    return jnp.minimum(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1)


def display_scale(peak_cd_m2: float | Array) -> Float[Array, ""]:
    """What exposed values are multiplied by for a display of this peak.

    Above the reference, such that middle grey keeps its luminance and what is brighter has the room up to the peak;
    contrast rises, so what is darker becomes darker. Below it 1: the whole picture is as much darker as the peak is.
    """
    y = _aces(jnp.asarray(MIDDLE_GREY)) * jnp.minimum(REFERENCE_PEAK_CD_M2 / peak_cd_m2, 1)
    # The curve solved for x: (2.51 − 2.43y)·x² + (0.03 − 0.59y)·x − 0.14y = 0.
    square, linear = 2.51 - 2.43 * y, 0.03 - 0.59 * y
    return (jnp.sqrt(linear * linear + 0.56 * y * square) - linear) / (2 * square * MIDDLE_GREY)


@jax.jit
def aces(rgb: Float[Array, "eye 3 y x"], exposure: Float[Array, "eye"], peak_cd_m2: float) -> Float[Array, "eye 3 y x"]:
    """A frame in cd/m² as the display shows it, linear, 1 = the display's peak.

    `exposure` in 1/(cd/m²) brings each eye's frame to where 1 is the reference white of 100 cd/m².
    """
    scale = (exposure * display_scale(peak_cd_m2)).astype(jnp.float32)
    # Spectral colours of glare lie outside the display's, below 0. Beyond 1e4 the curve is flat and its square would
    # overflow for a sun.
    return _aces(jnp.clip(rgb * scale[:, None, None, None], 0, np.float32(1e4)))


def ceiling_cd_m2(exposure: float, peak_cd_m2: float) -> float:
    """The scene's luminance from which on the display shows its peak."""
    # Where the curve reaches 1: x·(2.51·x + 0.03) = x·(2.43·x + 0.59) + 0.14.
    full = (0.56 + math.sqrt(0.56**2 + 4 * 0.08 * 0.14)) / (2 * 0.08)
    return full / (float(exposure) * float(display_scale(peak_cd_m2)))


@jax.jit
def encode(linear: Float[Array, "eye 3 y x"], black_share: float) -> UInt8[Array, "eye y x 3"]:
    """Code values for a display with the sRGB transfer function whose black is `black_share` of its peak."""
    shown = jnp.clip((linear - jnp.float32(black_share)) / (1 - jnp.float32(black_share)), 0, 1)
    # exp of log: XLA's power costs seven times as much, and 2 code values in a million differ by one.
    root = jnp.exp(jnp.log(jnp.maximum(shown, np.float32(1e-8))) * np.float32(1 / 2.4))
    power = np.float32(1.055) * root - np.float32(0.055)
    encoded = jnp.where(shown <= np.float32(0.0031308), np.float32(12.92) * shown, power)
    return jnp.round(encoded * 255).astype(jnp.uint8).transpose(0, 2, 3, 1)


def black_share(display: Display) -> float:
    """The display's black as a share of its peak."""
    return display.black_cd_m2 / display.peak_cd_m2
