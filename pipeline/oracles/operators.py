"""Tone mapping beside ACES: luminance to the display's share of its peak, and what keeps colours on the display.

For a display of the reference's peak, without black and surround, and an eye that is adapted.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from entoptic.pipeline.effects.tone.settings import Hue, Operator, Tone
from entoptic.pipeline.frame import Display
from entoptic.pipeline.oracles import adaptation, gamut, tone
from entoptic.pipeline.oracles.adaptation import luminance
from entoptic.pipeline.oracles.night_colour import RGB_TO_XYZ
from entoptic.pipeline.threshold import cone_threshold_cd_m2, rod_threshold_cd_m2, threshold_cd_m2

Reals = NDArray[np.float64]

PEAK_CD_M2 = tone.REFERENCE_PEAK_CD_M2
X_WEIGHTS, _, Z_WEIGHTS = RGB_TO_XYZ


def shown(rgb: Reals, adapted_cd_m2: float, settings: Tone, display: Display) -> Reals:
    """An image in cd/m² as the display shows it, by these settings.

    Displays of another peak than the reference's with ACES alone.
    """
    if settings.operator is Operator.ACES and settings.hue is Hue.CLIP:
        return tone.aces(rgb, adaptation.exposure(adapted_cd_m2), display.peak_cd_m2)
    if settings.hue is not Hue.OKLAB:
        rgb = np.maximum(rgb, 0)
    match settings.operator:
        case Operator.ACES:
            mapped = filmic(rgb, adapted_cd_m2, display.peak_cd_m2)
        case Operator.REINHARD:
            mapped = reinhard(rgb, adapted_cd_m2, settings.white)
        case Operator.WARD:
            mapped = ward(rgb, adapted_cd_m2)
        case Operator.DURAND:
            mapped = durand(rgb, adapted_cd_m2)
        case Operator.CURVE:
            log10, shares = np.loadtxt(settings.curve, delimiter=",", skiprows=1, unpack=True)
            mapped = own_curve(rgb, adapted_cd_m2, log10.tolist(), shares.tolist())
    within = {Hue.OKLAB: gamut.to_white, Hue.CLIP: clipped, Hue.RGB: divided, Hue.XYY: same_chromaticity}
    return within[settings.hue](mapped)


def filmic(rgb: Reals, adapted_cd_m2: float, peak_cd_m2: float = PEAK_CD_M2) -> Reals:
    """The ACES curve of luminance."""
    scale = adaptation.exposure(adapted_cd_m2) * tone.display_scale(peak_cd_m2)
    return _by_luminance(rgb, lambda y: tone.curve(np.clip(y * scale, 0, 1e4)))


def reinhard(rgb: Reals, adapted_cd_m2: float, white: float = 2.0) -> Reals:
    """KRI 4.18–4.20."""

    def share(y: Reals) -> Reals:
        exposed = y * adaptation.exposure(adapted_cd_m2)
        return exposed * (1 + exposed / white**2) / (1 + exposed)

    return _by_luminance(rgb, share)


def ward(rgb: Reals, adapted_cd_m2: float) -> Reals:
    """BAR 9: the threshold of the scene becomes that of the display."""
    return rgb * cone_threshold_cd_m2(PEAK_CD_M2 / 2) / threshold_cd_m2(adapted_cd_m2) / PEAK_CD_M2


def durand(rgb: Reals, adapted_cd_m2: float) -> Reals:
    """KRI 4.21–4.26: that of cones and that of rods apart; scotopic luminance as Larson has it (E4)."""
    viewer = cone_threshold_cd_m2(PEAK_CD_M2 / 2)
    cones = viewer / cone_threshold_cd_m2(adapted_cd_m2)
    rods = viewer / rod_threshold_cd_m2(adapted_cd_m2)
    y = luminance(np.maximum(rgb, 0))
    x, z = (np.einsum("c,cyx->yx", weights, np.maximum(rgb, 0)) for weights in (X_WEIGHTS, Z_WEIGHTS))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(x > 0, 1.33 * (1 + (y + z) / x) - 1.68, 0)
    return _by_luminance(rgb, lambda y: (cones * y + 0.04 / (0.04 + y) * rods * ratio * y) / PEAK_CD_M2)


def own_curve(rgb: Reals, adapted_cd_m2: float, log10_of_adapted: list[float], shares: list[float]) -> Reals:
    """A person's points, PCHIP between them, below in proportion to luminance."""
    first = 10 ** log10_of_adapted[0]

    def share(y: Reals) -> Reals:
        relative = y / adapted_cd_m2
        at = np.clip(np.log10(np.maximum(relative, first)), None, log10_of_adapted[-1])
        return np.asarray(PchipInterpolator(log10_of_adapted, shares)(at) * np.minimum(relative / first, 1))

    return _by_luminance(rgb, share)


def clipped(mapped: Reals) -> Reals:
    """Each component ends at the peak."""
    return np.clip(mapped, 0, 1)


def divided(mapped: Reals) -> Reals:
    """All three by the largest, where that is above the peak (KRI 4.30)."""
    return np.asarray(mapped / np.maximum(1, mapped.max(axis=0)))


def same_chromaticity(mapped: Reals) -> Reals:
    """Luminance ends at the peak's (KRI 4.28, E5)."""
    y = luminance(mapped)
    return clipped(mapped / np.maximum(1, y))


def _by_luminance(rgb: Reals, share: Callable[[Reals], Reals]) -> Reals:
    y = luminance(rgb)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(y > 0, rgb * (share(y) / y), 0))
