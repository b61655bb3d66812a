"""What tone mapping makes of a range of values and of a change that came before it: rigorous, from tiles alone."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.display_gamut import WEIGHTS
from entoptic.pipeline.effects.tone import durand, filmic, own_curve, reinhard
from entoptic.pipeline.effects.tone.hue import Mapped, change_within, range_within, with_luminance
from entoptic.pipeline.effects.tone.settings import Hue, Operator, Tone
from entoptic.pipeline.effects.tone.show import coefficients
from entoptic.pipeline.frame import Display
from entoptic.pipeline.mesopic import HALF_CD_M2
from entoptic.pipeline.ranges import Change, Range

Tiles = NDArray[np.float64]


def shown(range_: Range, adapted_cd_m2: float, target_cd_m2: float, settings: Tone, display: Display) -> Range:
    """What may stand on the display where this stands in the scene (cd/m²)."""
    numbers = coefficients(adapted_cd_m2, target_cd_m2, settings, display)
    if _each_component(settings):
        scale = numbers[0]
        low, high = filmic.shown(range_.low[:3] * scale), filmic.shown(range_.high[:3] * scale)
    else:
        low, high = range_within(_mapped(range_, _gains(range_, settings, numbers)), settings.hue)
    return Range(with_luminance(low), with_luminance(high), range_.tile_px)


def propagate(
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
        return with_luminance(np.minimum(step, 1, out=step))
    range_ = range_.widened(change)
    gains = _gains(range_, settings, numbers)
    step, y_step = _mapped_change(change, range_, gains, settings, numbers)
    return change_within(step, y_step, _mapped(range_, gains), settings.hue)


@dataclasses.dataclass(frozen=True, eq=False)
class Gains:
    """What a tile's components are multiplied by between the scene and what brings them within the display's."""

    least: Tiles
    most: Tiles
    slope: Tiles
    """At most so much changes the gain for a change of luminance."""
    y_low: Tiles
    """Least luminance of the tile."""
    y_high: Tiles
    """Largest luminance of the tile."""
    whole: NDArray[np.bool_]
    """Where no component may lie below 0, to be clipped: luminance changes as it did before."""
    offset: float = 0.0
    """What is added after."""


def _each_component(settings: Tone) -> bool:
    return settings.operator is Operator.ACES and settings.hue is Hue.CLIP


def _gains(range_: Range, settings: Tone, numbers: tuple[float, ...]) -> Gains:
    low, high = np.tensordot(WEIGHTS, range_.low[:3], 1), np.tensordot(WEIGHTS, range_.high[:3], 1)
    # A range's 0 may stand for less than 0, which has less luminance. Clipping that can only raise it.
    whole = np.minimum(np.minimum(range_.low[0], range_.low[1]), range_.low[2]) > 0
    if settings.hue is Hue.OKLAB:
        np.maximum(low, range_.low[3], out=low, where=whole)
        np.copyto(low, range_.low[3], where=~whole)
        whole = np.ones_like(whole)
    else:
        np.maximum(low, range_.low[3], out=low)
    np.minimum(high, range_.high[3], out=high, where=whole)
    match settings.operator:
        case Operator.WARD:
            gain, offset = np.full_like(low, numbers[0]), numbers[1]
            return Gains(gain, gain, np.zeros_like(low), low, high, whole, offset)
        case Operator.ACES:
            bounds = *filmic.gains(low, high, *numbers), filmic.gain_slope(low, high, *numbers)
        case Operator.REINHARD:
            bounds = *reinhard.gains(low, high, *numbers), reinhard.steepest(low, *numbers)
        case Operator.DURAND:
            bounds = durand.gains(range_, low, high, *numbers)
        case Operator.CURVE:
            bounds = own_curve.gains(own_curve.read_curve(settings.curve), low, high, *numbers)
    return Gains(*bounds, low, high, whole)


def _mapped(range_: Range, gains: Gains) -> Mapped:
    """What stands between the operator and what brings it within the display's."""
    low, high = range_.low[:3] * gains.least, range_.high[:3] * gains.most
    low += gains.offset
    high += gains.offset
    y = np.array([gains.y_low * gains.least, gains.y_high * gains.most]) + gains.offset
    below = (range_.low[:3].min(0) <= 0) & (range_.high[:3].max(0) > 0)
    # With an offset, a colour below 0 takes from it.
    y[0] = np.where(below & (range_.low[3] <= 0), 0, y[0])
    return Mapped(low, high, y, below)


def _mapped_change(
    change: Change, range_: Range, gains: Gains, settings: Tone, numbers: tuple[float, ...]
) -> tuple[Tiles, Tiles]:
    """How much components and luminance change between the two: |c'·g' − c·g| ≤ |c' − c|·g' + c·|g' − g|."""
    step = change[:3] * gains.most
    y_change = np.tensordot(WEIGHTS, change[:3], 1)
    np.minimum(y_change, change[3], out=y_change, where=gains.whole)
    y_step = y_change * gains.most
    if settings.operator is Operator.WARD:
        return step, y_step
    moved = y_change * gains.slope
    turned, y_turned = range_.high[:3] * moved, gains.y_high * moved
    if settings.operator is Operator.DURAND:
        share = numbers[1] * HALF_CD_M2 / (HALF_CD_M2 + gains.y_low)
        by_ratio = share * durand.ratio_change(change[:3])
        turned += by_ratio
        y_turned += by_ratio.max(0)
    room = gains.most - gains.least
    step += np.minimum(turned, range_.high[:3] * room, out=turned)
    y_step += np.minimum(y_turned, gains.y_high * room)
    return step, y_step
