"""HDR10 as films hold it: Y'CbCr of ITU-R BT.2020 at 10 bits, and what the stream says of the display behind it."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt16

from entoptic.pipeline.effects.encode import PQ_CODES, PQ_PEAK_CD_M2, REC2020, WHITE
from entoptic.pipeline.frame import Display

WEIGHTS = (0.2627, 0.6780, 0.0593)
"""Luma of red, green and blue (BT.2020, non-constant luminance)."""
BLUE_SPAN, RED_SPAN = 1.8814, 1.4746
"""What B' − Y' and R' − Y' are divided by (BT.2020)."""
LUMA_ZERO, LUMA_CODES = 64, 876
CHROMA_ZERO, CHROMA_CODES = 512, 896
"""Narrow range at 10 bits (BT.2100)."""


def planes(codes: UInt16[np.ndarray, "y x 3"]) -> UInt16[np.ndarray, "_ x"]:
    """4:2:0 of full-range code values of even sides: all rows of Y', then Cb, then Cr, two of their rows in one.

    A chroma sample stands where the upper left of its four pixels does, as HDR10 wants it (BT.2100), and weighs its
    neighbours 1 : 2 : 1 along both sides. Our own arithmetic: swscale 9 puts white at 943 instead of 940.
    """
    height, width = codes.shape[:2]
    samples = np.concatenate([np.asarray(plane).ravel() for plane in _planes(jnp.asarray(codes))])
    return samples.reshape(height * 3 // 2, width)


def parameters(display: Display) -> str:
    """What x265 is told: colours, and the mastering display (SMPTE ST 2086) and content light level (CTA-861.3).

    Nothing is known of the display's primaries, so those of the encoding are named. No pixel is brighter than the
    display's peak; the frames' mean is not known before they are written, which a 0 says.
    """
    red, green, blue, white = (f"({round(x * 50000)},{round(y * 50000)})" for x, y in (*REC2020, WHITE))
    peak, black = min(display.peak_cd_m2, PQ_PEAK_CD_M2), display.black_cd_m2
    volume = f"G{green}B{blue}R{red}WP{white}L({round(peak * 10000)},{round(black * 10000)})"
    return ":".join(
        (
            "colorprim=9:transfer=16:colormatrix=9:range=limited:chromaloc=2",
            "hdr10=1:repeat-headers=1:hdr10-opt=1",
            f"master-display={volume}:max-cll={round(peak)},0",
            # A film of one or two frames has no time stamps with B-frames: x265 4.2 leaves them unset.
            "bframes=0",
            # The output must not depend on how busy the machine is.
            "frame-threads=1:pools=2:log-level=error",
        )
    )


@jax.jit
def _planes(codes: UInt16[Array, "y x 3"]) -> tuple[Array, Array, Array]:
    signal = codes.astype(jnp.float32) / np.float32(PQ_CODES)
    red, blue = signal[..., 0], signal[..., 2]
    luma = sum(np.float32(weight) * signal[..., k] for k, weight in enumerate(WEIGHTS))
    coded_luma = jnp.round(LUMA_ZERO + np.float32(LUMA_CODES) * luma).astype(jnp.uint16)
    return coded_luma, _chroma((blue - luma) / np.float32(BLUE_SPAN)), _chroma((red - luma) / np.float32(RED_SPAN))


def _chroma(difference: Float[Array, "y x"]) -> UInt16[Array, "y/2 x/2"]:
    padded = jnp.pad(difference, ((1, 0), (1, 0)), mode="edge")
    rows = (padded[:-2:2] + 2 * padded[1:-1:2] + padded[2::2]) / 4
    both = (rows[:, :-2:2] + 2 * rows[:, 1:-1:2] + rows[:, 2::2]) / 4
    return jnp.round(CHROMA_ZERO + np.float32(CHROMA_CODES) * both).astype(jnp.uint16)
