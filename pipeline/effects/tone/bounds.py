"""What tone mapping makes of a range of values and of a change that came before it: rigorous, from tiles alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.effects.tone import durand, filmic, own_curve, reinhard
from pipeline.effects.tone.hue import WEIGHTS, change_within, range_within
from pipeline.effects.tone.settings import Hue, Operator, Tone
from pipeline.effects.tone.show import coefficients
from pipeline.frame import Display
from pipeline.ranges import Change, Range

Tiles = NDArray[np.float64]


def shown(range_: Range, adapted_cd_m2: float, target_cd_m2: float, settings: Tone, display: Display) -> Range:
    """What may stand on the display where this stands in the scene (cd/m²)."""
    numbers = coefficients(adapted_cd_m2, target_cd_m2, settings, display)
    if _each_component(settings):
        scale = numbers[0]
        low, high = _filmic(range_.low[:3] * scale), _filmic(range_.high[:3] * scale)
    else:
        low, high = range_within(*_mapped(range_, settings, numbers), settings.hue)
    return Range(_with_luminance(low), _with_luminance(high), range_.tile_px)


def passed_on(
    change: Change, range_: Range, adapted_cd_m2: float, target_cd_m2: float, settings: Tone, display: Display
) -> Change:
    """How much the display may change where the scene changes by `change` cd/m², both within `range_` widened by it."""
    numbers = coefficients(adapted_cd_m2, target_cd_m2, settings, display)
    if _each_component(settings):
        step, low, high = (values[:3] * numbers[0] for values in (change, range_.low, range_.high))
        low -= step
        np.maximum(low, 0, out=low)
        high += step
        step *= filmic.steepest(low, high)
        return _with_luminance(np.minimum(step, 1, out=step))
    range_ = range_.widened(change)
    step = _mapped_change(change, range_, settings, numbers)
    return _with_luminance(change_within(step, *_mapped(range_, settings, numbers), settings.hue))


def _each_component(settings: Tone) -> bool:
    return settings.operator is Operator.ACES and settings.hue is Hue.CLIP


def _filmic(x: Tiles) -> Tiles:
    x = np.minimum(x, filmic.FLAT)
    bottom = 2.43 * x
    bottom += 0.59
    bottom *= x
    bottom += 0.14
    top = 2.51 * x
    top += 0.03
    top *= x
    top /= bottom
    return np.minimum(top, 1, out=top)


def _mapped(range_: Range, settings: Tone, numbers: tuple[float, ...]) -> tuple[Tiles, Tiles]:
    """Least and largest components between the operator and what brings them within the display's."""
    if settings.operator is Operator.WARD:
        gain, offset = numbers
        return range_.low[:3] * gain + offset, range_.high[:3] * gain + offset
    y_low, y_high = _luminances(range_)
    least, most, _ = _gains(range_, y_low, y_high, settings, numbers)
    return range_.low[:3] * least, range_.high[:3] * most


def _mapped_change(change: Change, range_: Range, settings: Tone, numbers: tuple[float, ...]) -> Tiles:
    """How much components change between the two: |c'·g' − c·g| ≤ |c' − c|·g' + c·|g' − g|."""
    if settings.operator is Operator.WARD:
        return change[:3] * numbers[0]
    y_low, y_high = _luminances(range_)
    least, most, slope = _gains(range_, y_low, y_high, settings, numbers)
    y_change = np.tensordot(WEIGHTS, change[:3], 1)
    # Where a component may be clipped at 0, luminance changes otherwise than it did before.
    y_change = np.where(range_.low[:3].min(0) > 0, np.minimum(y_change, change[3]), y_change)
    turned = range_.high[:3] * (slope * y_change)
    if settings.operator is Operator.DURAND:
        _, rods = numbers
        share = rods * durand.SEMISATURATION_CD_M2 / (durand.SEMISATURATION_CD_M2 + y_low)
        turned += share * durand.ratio_change(change[:3])
    return change[:3] * most + np.minimum(turned, range_.high[:3] * (most - least))


def _gains(
    range_: Range, y_low: Tiles, y_high: Tiles, settings: Tone, numbers: tuple[float, ...]
) -> tuple[Tiles, Tiles, Tiles]:
    """The least and the largest L_d/L of a tile, and its largest slope over luminance."""
    match settings.operator:
        case Operator.REINHARD:
            return *reinhard.gains(y_low, y_high, *numbers), reinhard.steepest(y_low, *numbers)
        case Operator.DURAND:
            return durand.gains(range_, y_low, y_high, *numbers)
        case Operator.CURVE:
            return own_curve.gains(own_curve.read_curve(settings.curve), y_low, y_high, *numbers)
        case _:
            return *filmic.gains(y_low, y_high, *numbers), filmic.gain_slope(y_low, y_high, *numbers)


def _luminances(range_: Range) -> tuple[Tiles, Tiles]:
    """Least and largest luminance of a tile once components below 0 are clipped: that can only raise it."""
    low, high = np.tensordot(WEIGHTS, range_.low[:3], 1), np.tensordot(WEIGHTS, range_.high[:3], 1)
    # A range's 0 may stand for less than 0.
    whole = range_.low[:3].min(0) > 0
    return np.maximum(low, range_.low[3]), np.where(whole, np.minimum(high, range_.high[3]), high)


def _with_luminance(rgb: Tiles) -> Tiles:
    """Three components and the luminance they make together."""
    both = np.empty((4, *rgb.shape[1:]))
    both[:3] = rgb
    np.matmul(WEIGHTS, rgb.reshape(3, -1), out=both[3].reshape(-1))
    return both
