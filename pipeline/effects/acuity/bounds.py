"""The most that acuity changes a tile's pixels, and what it makes of a change that came before it.

Both rest on this: what a pixel is blurred to lies between the least and the largest lightness in reach, and the
luminance it changes by is added to all channels alike. In float64; lightness and luminance are CIELAB's.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.effects.acuity import fit, krawczyk, larson
from entoptic.pipeline.effects.acuity.cielab import EPSILON, KAPPA, LINEAR_END, WHITE_CD_M2
from entoptic.pipeline.effects.acuity.settings import Acuity, AcuityMethod
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.oracles.acuity import REACH
from entoptic.pipeline.ranges import Change, Range
from entoptic.pipeline.ranges import around as change_around

ROUNDING = 1e-3
"""Of a luminance: that close above the limit a pixel may count as darker in float32."""
STEEPEST_FIT = 1.38
"""Half of Σ|∂w/∂σ| over a pass's weights w, at its largest, σ = 0.47 px. The true filter's is 2.34 at once: two passes
may do more."""

Reals = NDArray[np.float64]


def limit_cd_m2(pixels_per_deg: float, settings: Acuity) -> float:
    """Pixels of this luminance or more stay as they are, whatever is around them."""
    if settings.method is AcuityMethod.FIT:
        return fit.LIMIT_CD_M2
    return larson.limit_cd_m2(pixels_per_deg, settings.display_limit)


def dark_tiles(range_: Range, pixels_per_deg: float, settings: Acuity) -> NDArray[np.bool_]:
    """Tiles (rows, columns) where acuity changes anything at all: some pixel may be below the limit."""
    return np.asarray(range_.low[3] < limit_cd_m2(pixels_per_deg, settings) * (1 + ROUNDING))


def skip_bound(range_: Range, pixels_per_deg: float, settings: Acuity) -> Change:
    """The most that leaving acuity out changes any pixel of each tile; 0 where it is bright, or even to its reach."""
    dark = dark_tiles(range_, pixels_per_deg, settings)
    if not dark.any():
        return np.zeros_like(range_.low)
    grey = _grey(range_, _near(range_, pixels_per_deg, settings), pixels_per_deg, settings)
    return np.broadcast_to(np.where(dark, grey, 0), range_.low.shape)


def _grey(range_: Range, near: Range, pixels_per_deg: float, settings: Acuity) -> Reals:
    """The most that a dark pixel's luminance changes by."""
    low, high = range_.low[3], np.minimum(range_.high[3], limit_cd_m2(pixels_per_deg, settings) * (1 + ROUNDING))
    given = _given_away(range_, near, pixels_per_deg, settings)
    darkest, brightest = lightness(low), lightness(high)
    # A pixel keeps its own share, and gets no more than the rest of the brightest in reach, or of the darkest.
    brighter = luminance_of(darkest + given * (lightness(near.high[0]) - darkest)) - low
    darker = high - luminance_of(brightest - given * (brightest - lightness(near.low[0])))
    return np.maximum(brighter, darker)


def propagate(change: Change, range_: Range, pixels_per_deg: float, settings: Acuity) -> Change:
    """What acuity makes of a change of its input at most. Bright tiles pass it on as it is."""
    wide = range_.widened(change)
    dark = dark_tiles(wide, pixels_per_deg, settings)
    if not dark.any():
        return change
    near = _near(wide, pixels_per_deg, settings)
    least, most = lightness(near.low[0]), lightness(near.high[0])
    # Lightness is concave, so a change of luminance changes it most at the low end; luminance convex, at the high end.
    moved = lightness(wide.low[3] + change[3]) - lightness(wide.low[3])
    reached = change_around(moved[None], _reach_px(wide, pixels_per_deg, settings), range_.tile_px)[0]
    blurred = _lightness_moved(moved, reached, most - least, wide, change, pixels_per_deg, settings)
    blurred = np.minimum(blurred, most - least)
    luminance = change[3] + luminance_of(most) - luminance_of(most - blurred)
    # Both frames' own blur is no more than a skip would take from them.
    grey = np.minimum(luminance, 2 * _grey(wide, near, pixels_per_deg, settings))
    # A channel held at 0 makes the luminance follow the channels.
    before = change.copy()
    before[3] = np.maximum(change[3], np.tensordot(np.asarray(LUMINANCE_WEIGHTS), change[:3], 1))
    return np.where(dark, before + grey, change)


def _lightness_moved(
    moved: Reals,
    reached: Reals,
    spread: Reals,
    wide: Range,
    change: Change,
    pixels_per_deg: float,
    settings: Acuity,
) -> Reals:
    """How far the blurred lightness moves: a mean moves no further than what it is of, besides by its own σ."""
    if settings.method is AcuityMethod.FIT:
        # Each pass adds to the largest move in reach what σ, which moves as lightness does, makes of the spread.
        return reached * (1 + STEEPEST_FIT * spread) ** 2
    floor = np.maximum(wide.low[3], larson.FLOOR_CD_M2)
    steps = _steepest(pixels_per_deg, settings.display_limit) * np.log1p(change[3] / floor)
    # The true filter changes faster by σ² than from rung to rung of the ladder; past one the spread bounds it.
    return reached + np.minimum(2 * steps, 1) * spread


@functools.lru_cache(maxsize=16)
def _steepest(pixels_per_deg: float, display_limit: bool) -> float:
    """Most rungs of the ladder for each unit of ln Y, at any luminance."""
    log = np.linspace(math.log(larson.FLOOR_CD_M2), math.log(1e6), 20001)
    variance = larson.variance_px2(np.exp(log), pixels_per_deg, display_limit)
    places = np.array([krawczyk.place_of(value) for value in variance.tolist()])
    # The ladder's kink at the first rung lies between two of these: it is no steeper than they are.
    return float(np.abs(np.diff(places)).max() / (log[1] - log[0])) * 1.02


def _given_away(range_: Range, near: Range, pixels_per_deg: float, settings: Acuity) -> Reals:
    """The largest share of its lightness that a pixel gives up to others."""
    if settings.method is AcuityMethod.FIT:
        sigma = np.clip(1 - lightness(near.low[0]), math.sqrt(fit.LEAST_VARIANCE), 1)
        first = np.exp(-0.5 / sigma**2)
        own = 1 / (1 + 2 * (first + first**4 + first**9 + first**16))
        return np.asarray(1 - own**2)
    variance = larson.variance_px2(range_.low[3] * (1 - ROUNDING), pixels_per_deg, settings.display_limit)
    return np.minimum(variance / krawczyk.FIRST_PX2, 1)


def _near(range_: Range, pixels_per_deg: float, settings: Acuity) -> Range:
    """Luminance alone, in reach of each tile."""
    luminance = Range(range_.low[3:], range_.high[3:], range_.tile_px)
    return luminance.around(_reach_px(range_, pixels_per_deg, settings))


def _reach_px(range_: Range, pixels_per_deg: float, settings: Acuity) -> int:
    if settings.method is AcuityMethod.FIT:
        return REACH if settings.reference else fit.RADIUS_PX
    widest = float(larson.variance_px2(range_.low[3].min(), pixels_per_deg, settings.display_limit))
    return max(krawczyk.reach_px(widest), math.ceil(REACH * math.sqrt(widest)))


def lightness(y_cd_m2: Reals) -> Reals:
    """L* of CIELAB."""
    relative = y_cd_m2 / WHITE_CD_M2
    return np.where(relative > EPSILON, 116 * np.cbrt(relative) - 16, KAPPA * relative)


def luminance_of(lightness_: Reals) -> Reals:
    """The luminance in cd/m² of an L*."""
    root = (lightness_ + 16) / 116
    return WHITE_CD_M2 * np.where(lightness_ > LINEAR_END, root * root * root, lightness_ / KAPPA)
