"""By how many code values a change on the display may show."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pipeline.effects.tone.seen import black_share, seen_peak_cd_m2
from pipeline.frame import Display, Encoding
from pipeline.ranges import Change, Range


def code_values(change: Change, shown_: Range, display: Display) -> NDArray[np.float64]:
    """By how many of the display's code values a pixel of each tile changes at most, in its worst component.

    Before rounding; (rows, columns). A transfer function is concave: a change shows most at the low end of the range.
    Of 255 for 8 bits, of 1023 for HDR10; for a linear output, which has no code values, of 255 as sRGB.
    """
    primaries, transfer, codes = _encoding_of(display)
    step = np.einsum("oi,iyx->oyx", primaries, change[:3])
    low = np.einsum("oi,iyx->oyx", primaries, shown_.low[:3]) - step
    black = black_share(display)
    step, low = step / (1 - black), np.clip((low - black) / (1 - black), 0, 1)
    return np.asarray(codes * (transfer(np.minimum(low + step, 1)) - transfer(low)).max(0))


def _srgb(u: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(u <= 0.0031308, 12.92 * u, 1.055 * np.maximum(u, 0.0031308) ** (1 / 2.4) - 0.055)


def _pq(peak_cd_m2: float, u: NDArray[np.float64]) -> NDArray[np.float64]:
    """SMPTE ST 2084 of a share of the peak."""
    power = (u * (peak_cd_m2 / 1e4)) ** (2610 / 16384)
    return np.asarray(((3424 + 2413 * 32 * power) / (4096 + 2392 * 32 * power)) ** (2523 / 32))


def _encoding_of(
    display: Display,
) -> tuple[NDArray[np.float64], Callable[[NDArray[np.float64]], NDArray[np.float64]], int]:
    """From Rec.709 to the display's primaries, its transfer function, and its largest code value."""
    match display.encoding:
        case Encoding.DISPLAY_P3:
            return _primaries("Display P3"), _srgb, 255
        case Encoding.HDR10:
            return _primaries("ITU-R BT.2020"), functools.partial(_pq, seen_peak_cd_m2(display)), 1023
        case Encoding.SRGB | Encoding.LINEAR:
            return np.eye(3), _srgb, 255


@functools.cache
def _primaries(name: str) -> NDArray[np.float64]:
    """From linear Rec.709 to linear light of a wider colour space; no entry is below 0."""
    # Imported here: colour-science takes seconds, and few displays need it.
    from colour import RGB_COLOURSPACES, matrix_RGB_to_RGB

    matrix = matrix_RGB_to_RGB(RGB_COLOURSPACES["ITU-R BT.709"], RGB_COLOURSPACES[name])
    # Entries that are 0 but for the rounding of published primaries.
    return np.maximum(np.asarray(matrix, np.float64), 0)
