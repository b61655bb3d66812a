"""What tone mapping makes of a range of values and of a change that came before it: rigorous, from tiles alone."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pipeline.effects.adaptation import exposure
from pipeline.effects.tone import filmic
from pipeline.effects.tone.seen import black_share, seen_peak_cd_m2
from pipeline.effects.tone.settings import Tone
from pipeline.frame import LUMINANCE_WEIGHTS, Display, Encoding
from pipeline.ranges import Change, Range

WEIGHTS = np.array(LUMINANCE_WEIGHTS)


def shown(range_: Range, adapted_cd_m2: float, target_cd_m2: float, settings: Tone, display: Display) -> Range:
    """What may stand on the display where this stands in the scene (cd/m²)."""
    scale = exposure(adapted_cd_m2) * filmic.display_scale_of(seen_peak_cd_m2(display))
    return Range(
        _with_luminance(_filmic(range_.low[:3] * scale)),
        _with_luminance(_filmic(range_.high[:3] * scale)),
        range_.tile_px,
    )


def passed_on(
    change: Change, range_: Range, adapted_cd_m2: float, target_cd_m2: float, settings: Tone, display: Display
) -> Change:
    """How much the display may change where the scene changes by `change` cd/m², both within `range_` widened by it."""
    scale = exposure(adapted_cd_m2) * filmic.display_scale_of(seen_peak_cd_m2(display))
    step = np.minimum(change[:3] * scale, filmic.FLAT)
    low = np.maximum(range_.low[:3] * scale - step, 0)
    high = range_.high[:3] * scale + step
    bound = step * filmic.steepest(low, high)
    # No two values of the range lie further apart than its ends; and from the foot on, steps shrink upwards.
    np.minimum(bound, _filmic(high) - _filmic(low), out=bound)
    np.minimum(bound, filmic.concave(low + step) - filmic.concave(low), out=bound)
    return _with_luminance(bound)


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


def _filmic(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.minimum(filmic.curve(np.minimum(x, filmic.FLAT)), 1)


def _with_luminance(rgb: NDArray[np.float64]) -> NDArray[np.float64]:
    """Three components and the luminance they make together."""
    return np.concatenate([rgb, np.einsum("c,cyx->yx", WEIGHTS, rgb)[None]])
