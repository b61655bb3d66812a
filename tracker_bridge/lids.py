"""What lids do to a pupil: how far an eye is open, and blinks that leave the pupil to see.

Openness is told from how much of its pupil a lid leaves to see. Latency: none. What it can tell ends where the lid does
not touch the pupil, and where the pupil is no longer found: an eye of 4 mm pupil looks wholly open until it is 0.7
open. Only openness shows a lid that comes down quickly, part of the way, and goes up again. Latency: a dip is reported
when it is half over, two samples late; its times are right.
"""

from __future__ import annotations

import collections
import statistics

import numpy as np

FISSURE_MM = 10.0
"""Height of the open lids' gap (9–11 mm in healthy adults)."""
PUPIL_HEIGHT_MM = 5.0
"""Height of the pupil's centre in it: the light reflex lies 4–5 mm below the upper lid's edge in healthy adults (the
"margin reflex distance" of eyelid surgery)."""
USUAL_DIAMETER_MM = 4.0
"""Of a pupil whose diameter in mm nobody knows. Engineering choice."""
FALL_NS = 150_000_000
"""A blinking lid comes down within it. Engineering choice: a person's squints took 200–500 ms to close."""
DEPTH = 0.2
"""How far it comes down, of openness. Engineering choice: of 55 lid dips of 0.15 and more by a person who was told to
blink partially it finds 49 with one eye and 44 with the other; 0.15 finds more, but also dips in slow closures."""
BACK_SHARE = 0.5
"""It counts as up again at this share of its depth."""
LONGEST_NS = 700_000_000
"""What takes longer is no blink but a lid that stays down. Engineering choice: a person's partial blinks took up to
0.5 s; the closures that follow one another in squints and slow blinks, a second and more."""
TOP_NOISE = 0.03
"""The fall begins where openness was last this near to its top. Engineering choice: a tracker's noise."""

_HEIGHTS = np.linspace(0.0, 1.0, 201)
# The diameter of a circle with the area that is left below a chord at this share of a circle's height.
_SIZES = np.sqrt((np.arccos(1 - 2 * _HEIGHTS) - 2 * (1 - 2 * _HEIGHTS) * np.sqrt(_HEIGHTS - _HEIGHTS**2)) / np.pi)


def estimated_openness(apparent_share: float, pupil_diameter_mm: float | None) -> float:
    """Openness, 0 … 1, of an eye whose pupil of `pupil_diameter_mm` looks as small as this share of it, from 0 up.

    Assumes that the tracker reports the diameter of the circle with the area that is to see. 1 where it is whole.
    """
    if apparent_share >= 1.0:
        return 1.0
    whole_mm = USUAL_DIAMETER_MM if pupil_diameter_mm is None else pupil_diameter_mm
    height_mm = float(np.interp(apparent_share, _SIZES, _HEIGHTS)) * whole_mm
    return min(max((height_mm + PUPIL_HEIGHT_MM - whole_mm / 2) / FISSURE_MM, 0.0), 1.0)


class LidDips:
    """Feed it all openness of one eye in the order of its time."""

    def __init__(self) -> None:
        self._newest: collections.deque[float] = collections.deque(maxlen=5)
        self._recent: collections.deque[tuple[int, float]] = collections.deque()
        self._onset_ns: int | None = None
        self._top = self._lowest = 1.0

    def add(self, t_ns: int, openness: float) -> tuple[int, int] | None:
        """Onset and end of a dip, where one is over with this sample."""
        self._newest.append(openness)
        smooth = statistics.median_low(self._newest)
        # Of the last FALL_NS those that nothing later overtops: the first is the top.
        while self._recent and self._recent[-1][1] <= smooth:
            self._recent.pop()
        self._recent.append((t_ns, smooth))
        while self._recent[0][0] < t_ns - FALL_NS:
            self._recent.popleft()
        if self._onset_ns is None:
            self._top = self._recent[0][1]
            if self._top - smooth >= DEPTH:
                self._onset_ns = max(at_ns for at_ns, height in self._recent if height >= self._top - TOP_NOISE)
                self._lowest = smooth
            return None
        self._lowest = min(self._lowest, smooth)
        onset_ns = self._onset_ns
        is_back = smooth >= self._lowest + BACK_SHARE * (self._top - self._lowest)
        is_long = t_ns - onset_ns > LONGEST_NS
        if is_back or is_long:
            self._onset_ns = None
            self._recent.clear()
        return (onset_ns, t_ns) if is_back and not is_long else None
