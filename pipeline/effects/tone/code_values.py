"""By how many code values a change on the display may show."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.display_light import black_share
from entoptic.pipeline.effects.encode import (
    P3,
    PQ_CODES,
    PQ_PEAK_CD_M2,
    REC709,
    REC2020,
    Primaries,
    matrix,
    pq_signal,
    srgb_signal,
)
from entoptic.pipeline.frame import Display, Encoding
from entoptic.pipeline.ranges import Change, Range


def code_values(change: Change, shown_: Range, display: Display) -> NDArray[np.float64]:
    """By how many of the display's code values a pixel of each tile changes at most, in its worst component.

    Before rounding; (rows, columns). A transfer function is concave: a change shows most at the low end of the range.
    Of 255 for 8 bits, of 1023 for HDR10; for a linear output, which has no code values, of 255 as sRGB.
    """
    primaries, transfer, codes = _encoding_of(display)
    step, low = change[:3], shown_.low[:3]
    if primaries is not None:
        step, low = np.tensordot(primaries, step, 1), np.tensordot(primaries, low, 1)
    black = black_share(display)
    low = low - (step + black)
    step = step / (1 - black)
    low /= 1 - black
    np.maximum(low, 0, out=low)
    step += low
    shows = transfer(np.minimum(step, 1, out=step))
    shows -= transfer(np.minimum(low, 1, out=low))
    return np.asarray(codes * shows.max(0))


def _pq(peak_cd_m2: float, share: NDArray[np.float64]) -> NDArray[np.float64]:
    return pq_signal(share * (peak_cd_m2 / PQ_PEAK_CD_M2))


def _encoding_of(
    display: Display,
) -> tuple[NDArray[np.float64] | None, Callable[[NDArray[np.float64]], NDArray[np.float64]], int]:
    """From Rec.709 to the display's primaries (None: they are the same), its transfer function, its last code."""
    match display.encoding:
        case Encoding.DISPLAY_P3:
            return _primaries(P3), srgb_signal, 255
        case Encoding.HDR10:
            return _primaries(REC2020), functools.partial(_pq, display.peak_cd_m2), PQ_CODES
        case Encoding.SRGB | Encoding.LINEAR:
            return None, srgb_signal, 255


@functools.cache
def _primaries(target: Primaries) -> NDArray[np.float64]:
    """From linear Rec.709 to wider primaries; no entry is below 0 but for rounding."""
    return np.maximum(matrix(REC709, target), 0)
