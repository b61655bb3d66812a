"""Thresholds of cones and rods mapped each for itself (Durand & Dorsey 2000; KRI 4.21–4.26)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.display_light import seen_peak_cd_m2, viewer_cd_m2
from entoptic.pipeline.effects.pointwise import weighted
from entoptic.pipeline.fast_math import larger
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, Display
from entoptic.pipeline.mesopic import HALF_CD_M2, LARSON, larson_ratio
from entoptic.pipeline.primaries import X_WEIGHTS, Z_WEIGHTS
from entoptic.pipeline.ranges import Range
from entoptic.pipeline.threshold import cone_threshold_cd_m2, rod_threshold_cd_m2

LEAST_RATIO, LARGEST_RATIO = 0.3978, 7.187
"""V/Y of red and of blue light, between which every other lies, rounded outwards."""
WHITE_RATIO = 2.573
"""V/Y of D65."""


def coefficients(adapted_cd_m2: float, display: Display) -> tuple[float, float]:
    """m_C and m_R over the display's peak (KRI 4.22): the viewer's cones serve both."""
    viewer = cone_threshold_cd_m2(viewer_cd_m2(display)) / seen_peak_cd_m2(display)
    return viewer / cone_threshold_cd_m2(adapted_cd_m2), viewer / rod_threshold_cd_m2(adapted_cd_m2)


def gain(
    planes: Sequence[Float[Array, "eye y x"]],
    y: Float[Array, "eye y x"],
    cones: Float[Array, "eye 1 1"],
    rods: Float[Array, "eye 1 1"],
) -> Float[Array, "eye y x"]:
    """L_d/L = m_C + σ(L)·m_R·V/L (KRI 4.26) of red, green and blue and their luminance.

    V/L is Larson's, of what is not below 0. A black pixel stays black whatever its ratio.
    """
    planes = [larger(plane, np.float32(0)) for plane in planes]
    x = weighted(planes, X_WEIGHTS)
    ratio = larson_ratio(weighted(planes, _rows()[0].tolist()) / larger(x, np.float32(1e-30)))
    return cones + rods * (np.float32(HALF_CD_M2) / (np.float32(HALF_CD_M2) + y)) * ratio


def ratios(low: NDArray[np.float64], high: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The least and the largest V/Y of colours between two, (3, rows, columns) each."""
    numerator, x = _rows()
    with np.errstate(divide="ignore", invalid="ignore"):
        least = larson_ratio(np.asarray(np.tensordot(numerator, low, 1) / np.tensordot(x, high, 1)))
        largest = larson_ratio(np.asarray(np.tensordot(numerator, high, 1) / np.tensordot(x, low, 1)))
    return (
        np.clip(np.nan_to_num(least, nan=LEAST_RATIO), LEAST_RATIO, LARGEST_RATIO),
        np.clip(np.nan_to_num(largest, nan=LARGEST_RATIO), LEAST_RATIO, LARGEST_RATIO),
    )


def gains(
    range_: Range, y_low: NDArray[np.float64], y_high: NDArray[np.float64], cones: float, rods: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """The least and the largest gain of a tile, and its largest slope over luminance for one and the same colour."""
    least, largest = ratios(range_.low[:3], range_.high[:3])
    s = HALF_CD_M2
    slope = rods * largest * s / (s + y_low) ** 2
    return cones + rods * least * s / (s + y_high), cones + rods * largest * s / (s + y_low), slope


def ratio_change(step: NDArray[np.float64]) -> NDArray[np.float64]:
    """The most that a component times the change of V/Y may be, where components change by `step`; any colour.

    With n = Y + Z and r = n/X, r' − r = ((n' − n) − r'·(X' − X))/X, and a component c is X/k_c at most.
    """
    numerator, x = _rows()
    factor, offset = LARSON
    largest = (LARGEST_RATIO + offset) / factor - 1
    moved = factor * (np.tensordot(numerator, step, 1) + largest * np.tensordot(x, step, 1))
    return np.asarray(moved / x[:, None, None])


def full_cd_m2(cones: float, rods: float) -> float:
    """The luminance of white light from which on the display shows its peak: cones·L + rods·r·s·L/(s + L) = 1."""
    s = HALF_CD_M2
    linear = cones * s + rods * WHITE_RATIO * s - 1
    return (math.sqrt(linear * linear + 4 * cones * s) - linear) / (2 * cones)


def _rows() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What makes Y + Z and X of RGB."""
    return np.add(LUMINANCE_WEIGHTS, Z_WEIGHTS), np.array(X_WEIGHTS)
