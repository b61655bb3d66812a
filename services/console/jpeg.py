"""A picture of the worker as a JPEG for a page.

A page shows sRGB. Code values of sRGB are taken as they are. Those of other encodings are turned into sRGB's: the
display's peak becomes white, and what lies outside of sRGB's gamut, or above the peak, is clipped: the picture is that
of a person who looks at a common monitor, not at the display that was rendered for. So bright parts of HDR10 and
saturated colours of Display P3 look duller here than there.

Pillow, since of 720×800 pixels it makes a JPEG in 4.8 ms of a processor; PyAV takes 13.1, OpenImageIO 28.9.
"""

from __future__ import annotations

import functools
import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from entoptic.pipeline.effects.encode import P3, PQ_CODES, REC709, REC2020, matrix, pq_cd_m2, srgb_signal
from entoptic.pipeline.frame import Encoding
from entoptic.services.ipc.messages import MessageError, Picture

QUALITY = 80
WIDEST_PX = 1600
"""Engineering choice: as wide as a page shows it; wider pictures are made smaller by a whole factor."""
_STEPS = 4096
"""Of the table from light to sRGB's code values, in the square root of light: a tenth of a code value at most."""


def jpeg(picture: Picture, peak_cd_m2: float) -> bytes:
    """`peak_cd_m2`: the display's, for encodings of absolute light. Raises MessageError."""
    values = picture.image
    factor = -(-picture.width_px // WIDEST_PX)
    if picture.encoding != Encoding.SRGB:
        # The fewer pixels the better: every factor'th is taken before the light of each is computed.
        values, factor = srgb(values[::factor, ::factor], picture.encoding, peak_cd_m2), 1
    if values.dtype != np.uint8:
        raise MessageError(f"a picture of {values.dtype} in {picture.encoding}")
    image = Image.fromarray(np.ascontiguousarray(values))
    if factor > 1:
        image = image.reduce(factor)
    out = io.BytesIO()
    image.save(out, "JPEG", quality=QUALITY)
    return out.getvalue()


def srgb(values: NDArray[np.generic], encoding: str, peak_cd_m2: float) -> NDArray[np.uint8]:
    """Code values of sRGB for those of another encoding, (y, x, 3). Raises MessageError for an unknown one."""
    match encoding:
        case Encoding.LINEAR:
            light = values.astype(np.float32)
        case Encoding.DISPLAY_P3 if values.dtype == np.uint8:
            light = _srgb_light()[values] @ _to_rec709(P3)
        case Encoding.HDR10 if values.dtype == np.uint16:
            codes = np.minimum(values.astype(np.uint16), PQ_CODES)
            light = _pq_light()[codes] @ _to_rec709(REC2020) / np.float32(peak_cd_m2)
        case _:
            raise MessageError(f"a picture of {values.dtype} in {encoding!r}, which is not known")
    share = np.clip(np.nan_to_num(light, nan=0.0), 0, 1)
    encoded: NDArray[np.uint8] = _codes()[np.rint(np.sqrt(share) * (_STEPS - 1)).astype(np.int32)]
    return encoded


@functools.cache
def _codes() -> NDArray[np.uint8]:
    root = np.linspace(0, 1, _STEPS)
    return np.rint(srgb_signal(root**2) * 255).astype(np.uint8)


@functools.cache
def _srgb_light() -> NDArray[np.float32]:
    """Light of each code value (IEC 61966-2-1, the inverse)."""
    signal = np.arange(256) / 255
    return np.where(signal <= 0.04045, signal / 12.92, ((signal + 0.055) / 1.055) ** 2.4).astype(np.float32)


@functools.cache
def _pq_light() -> NDArray[np.float32]:
    return pq_cd_m2(np.arange(PQ_CODES + 1) / PQ_CODES).astype(np.float32)


@functools.cache
def _to_rec709(source: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]) -> NDArray[np.float32]:
    return matrix(source, REC709).T.astype(np.float32)
