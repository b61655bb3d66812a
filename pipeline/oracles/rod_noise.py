"""Photons and heat counted by rods: the same draws of the same hash, in float64 (after Anscombe 1948).

What is random has no truth but its own numbers: this is the formula, written down once more.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.effects.rod_noise import (
    INTEGRATION_S,
    ISOMERISATIONS,
    RODS_PER_DEG2,
    THERMAL_PER_S,
    RodNoise,
)
from entoptic.pipeline.mesopic import SCOTOPIC_WEIGHTS, WHITE_RATIO
from entoptic.pipeline.oracles.adaptation import luminance

Reals = NDArray[np.float64]


def noisy(
    rgb: Reals, time_s: float, pupil_diameter_mm: float, pixels_per_deg: float, settings: RodNoise, eye: int, eyes: int
) -> Reals:
    """An image in cd/m², (3, y, x), as the rods of one of so many eyes count it."""
    grain_px = max(1, round(settings.grain_deg * pixels_per_deg))
    height, width = rgb.shape[1:]
    rows, columns = -(-height // grain_px) + 1, -(-width // grain_px) + 1
    slot, fraction = divmod(time_s / INTEGRATION_S, 1.0)
    early, late = (_draws((eyes, rows, columns), int(slot) + k, settings.seed)[eye] for k in (0, 1))
    nodes = _mean_of_two(early, late, fraction)
    y, x = np.arange(height) / grain_px, np.arange(width) / grain_px
    top, left = y.astype(int)[:, None], x.astype(int)
    down, across = (y % 1)[:, None], x % 1
    upper, lower = (_mean_of_two(nodes[row, left], nodes[row, left + 1], across) for row in (top, top + 1))
    # Rows are mixed before columns; both are linear, so it does not matter.
    z = _mean_of_two(upper, lower, down)
    rods = RODS_PER_DEG2 * settings.grain_deg**2 * INTEGRATION_S
    trolands_per_cd_m2 = math.pi / 4 * pupil_diameter_mm**2
    light = np.maximum(np.einsum("c,cyx->yx", np.array(SCOTOPIC_WEIGHTS), rgb), 0)
    per_cd_m2, heat = rods * ISOMERISATIONS * trolands_per_cd_m2, rods * THERMAL_PER_S
    events = per_cd_m2 * light + heat
    counted = (z / 2 + np.sqrt(events - 0.25)) ** 2
    fade = np.clip(1 - luminance(rgb) / settings.below_cd_m2, 0, 1)
    own = fade * heat / (per_cd_m2 * WHITE_RATIO) if settings.own_light else 0.0
    return np.asarray((rgb + own) * (1 + fade * (counted / events - 1)))


def _mean_of_two(one: Reals, other: Reals, share: float | Reals) -> Reals:
    """Of `share` of the other, weighed to keep the variance of 1."""
    return np.asarray((one * (1 - share) + other * share) / np.sqrt((1 - share) ** 2 + share**2))


def _draws(shape: tuple[int, int, int], slot: int, seed: int) -> Reals:
    """Sums of the halves of 32 hashed bits, of mean 0 and variance 1."""
    with np.errstate(over="ignore"):
        start = _hash(np.uint32(slot % 2**32) ^ _hash(np.uint32(seed)))
        bits = _hash(np.arange(math.prod(shape), dtype=np.uint32).reshape(shape) ^ start)
    total = (bits & 0xFFFF).astype(np.float64) + (bits >> 16)
    return np.asarray((total - 65535) * math.sqrt(6 / (65536**2 - 1)))


def _hash(bits: NDArray[np.uint32] | np.uint32) -> NDArray[np.uint32]:
    """`lowbias32` (Wellons 2018)."""
    bits = (bits ^ (bits >> np.uint32(16))) * np.uint32(0x7FEB352D)
    bits = (bits ^ (bits >> np.uint32(15))) * np.uint32(0x846CA68B)
    return np.asarray(bits ^ (bits >> np.uint32(16)), np.uint32)
