"""Where a pupil is while nobody can see it: it goes on as it went, ever slower.

A light reflex goes on behind a lid. Held still, a pupil that constricts at 2 mm/s as a blink begins would be shown
0.4 mm too wide when it ends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from entoptic.tracker_bridge.trust import IRIS_SPEED_PER_S

FADE_S = 0.2
"""How long the pupil goes on, e-fold. Engineering choice; see docs/bridge.md for what half and double it do."""
BASELINE_NS = 100_000_000
"""The speed is that over this time. Engineering choice: 150 ms are late when a reflex has just begun."""
_FEWEST = 4
"""Samples that a speed is told from."""


class Extrapolation:
    """A diameter from the last one that counts onwards."""

    def __init__(self, trusted: Sequence[tuple[int, float]]) -> None:
        """From trusted diameters (t_ns, size) in the order of their time, at least one."""
        self._from_ns, self._last = trusted[-1]
        near = [(t_ns, size) for t_ns, size in trusted if t_ns >= self._from_ns - BASELINE_NS]
        self._from, self._speed = self._last, 0.0
        if len(near) >= _FEWEST:
            mean_s = sum(t_ns - self._from_ns for t_ns, _ in near) / len(near) * 1e-9
            mean = sum(size for _, size in near) / len(near)
            away = [((t_ns - self._from_ns) * 1e-9 - mean_s, size - mean) for t_ns, size in near]
            spread = sum(t * t for t, _ in away)
            speed = sum(t * d for t, d in away) / spread
            # The variance of the speed, from what a straight line leaves over: noise alone is no movement.
            variance = sum((d - speed * t) ** 2 for t, d in away) / (len(near) - 2) / spread
            power = speed**2
            speed *= 1.0 - min(variance / power, 1.0) if power > 0.0 else 0.0
            limit = IRIS_SPEED_PER_S * mean
            self._speed = min(max(speed, -limit), limit)
            self._from = mean - self._speed * mean_s

    def at(self, t_ns: int) -> float:
        """The diameter to suppose at t_ns."""
        elapsed_s = max(t_ns - self._from_ns, 0) * 1e-9
        return self._from - self._speed * FADE_S * math.expm1(-elapsed_s / FADE_S)
