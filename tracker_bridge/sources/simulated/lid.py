"""Simulated blinks, and how much of a pupil a lid leaves to see."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from entoptic.tracker_bridge.lids import FISSURE_MM, PUPIL_HEIGHT_MM

Floats = NDArray[np.float64]

DURATION_S = (0.3, 0.4)
"""Shortest and longest blink (Luidolt 2020: 300–400 ms)."""

_CLOSING, _SHUT = 0.3, 0.15
"""Shares of a blink's duration; the rest is the opening. The lid falls about twice as fast as it rises (VanderWerf et
al. 2003, J. Neurophysiol. 89, 2784); the exact shares are an engineering choice."""

_SHORTEST_GAP_S = 0.6
"""From the end of one blink to the next. Engineering choice: the pupil is trusted for a while between any two."""


class Blink(NamedTuple):
    """A blink of both eyes."""

    onset_s: float
    duration_s: float

    @property
    def end_s(self) -> float:
        """When the lid is open again."""
        return self.onset_s + self.duration_s


def draw_blinks(rng: np.random.Generator, seconds: float, per_minute: float) -> list[Blink]:
    """Blinks at random times, all of them whole within the time given; the gaps between them are exponential."""
    if per_minute == 0.0:
        return []
    mean_gap_s = 60.0 / per_minute - sum(DURATION_S) / 2
    blinks: list[Blink] = []
    t_s = 0.0
    while True:
        onset_s = t_s + _SHORTEST_GAP_S + rng.exponential(max(mean_gap_s - _SHORTEST_GAP_S, 0.0))
        blink = Blink(onset_s, rng.uniform(*DURATION_S))
        if blink.end_s >= seconds:
            return blinks
        blinks.append(blink)
        t_s = blink.end_s


def openness_at(t_s: Floats, blinks: Sequence[Blink]) -> Floats:
    """How far the lids are open, 0 … 1, at rising times; the lid starts and stops softly, as a cosine."""
    openness = np.ones_like(t_s)
    for blink in blinks:
        inside = slice(*np.searchsorted(t_s, (blink.onset_s, blink.end_s)))
        phase = (t_s[inside] - blink.onset_s) / blink.duration_s
        closing = np.clip(phase / _CLOSING, 0.0, 1.0)
        opening = np.clip((phase - _CLOSING - _SHUT) / (1.0 - _CLOSING - _SHUT), 0.0, 1.0)
        openness[inside] = (1.0 + np.cos(np.pi * closing) + 1.0 - np.cos(np.pi * opening)) / 2
    return openness


def visible_height(openness: Floats, pupil_diameter_mm: Floats) -> Floats:
    """The share of the pupil's height that the upper lid leaves to see, 0 … 1."""
    below_lid_mm = openness * FISSURE_MM - PUPIL_HEIGHT_MM + pupil_diameter_mm / 2
    return np.clip(below_lid_mm / pupil_diameter_mm, 0.0, 1.0)


def visible_area(height: Floats) -> Floats:
    """The share of a circle's area below a chord at this share of its height."""
    return (np.arccos(1 - 2 * height) - 2 * (1 - 2 * height) * np.sqrt(height - height**2)) / np.pi
