"""Velocity of one eye's gaze, and the noise in it, sample by sample, at even and at uneven sampling."""

from __future__ import annotations

import collections
import math
from typing import NamedTuple

import numpy as np

MIN_HALF_WINDOW = 2
"""Samples on each side: the five-sample window of Engbert & Kliegl 2003 (Vision Res. 43, 1035)."""

_INTERVALS = 31
"""Whose median is the sampling interval. Engineering choice: enough for a few dropped frames among them."""

NOISE_WINDOW_NS = 2_000_000_000
MIN_NOISE_NS = 500_000_000
"""What the noise is estimated from, at most and at least. Engineering choice: movements take far less than the half of
2 s that a median bears, and a headset that slips is followed within a second."""

_NOISE_STEP_NS = 5_000_000
"""Velocities closer together share most of their samples: one of them is enough to tell the noise."""

_NOISE_UPDATE_NS = 100_000_000
"""How often the noise is estimated again. Engineering choice: a twentieth of what it is estimated from."""


class Place(NamedTuple):
    """Where an eye looks at a time."""

    t_ns: int
    azimuth_deg: float
    elevation_deg: float


class Velocity(NamedTuple):
    """How fast an eye turns at a time, in degrees of the sphere: to the right, and upwards."""

    t_ns: int
    azimuth_deg_s: float
    elevation_deg_s: float

    @property
    def speed_deg_s(self) -> float:
        """In whatever direction."""
        return math.hypot(self.azimuth_deg_s, self.elevation_deg_s)


class VelocityFilter:
    """Velocity at a sample from k samples on each side of it. Latency: k samples, 10 ms at 200 Hz.

    It is the sum of the places after less that of the places before, over the same of their times: at even sampling
    and k = 2 Engbert & Kliegl's (x₊₂ + x₊₁ − x₋₁ − x₋₂) / 6Δt, and exact for steady motion at any sampling. A degree
    of azimuth at an elevation ε is cos ε degrees of the sphere.
    """

    def __init__(self, half_window_ns: int, keep_ns: int) -> None:
        """k is as many samples as `half_window_ns` holds, two at least.

        The places of the last `keep_ns`, and at least those of the window, are kept for whoever wants to look back.
        """
        self._half_window_ns = half_window_ns
        self._keep_ns = keep_ns
        self._intervals_ns: collections.deque[int] = collections.deque(maxlen=_INTERVALS)
        self.places: list[Place] = []
        """In the order of their times."""
        self.half_window = MIN_HALF_WINDOW
        """k."""
        self.interval_ns = 0
        """Median of the sampling intervals; 0 until there were enough of them."""

    def restart(self) -> None:
        """Forgets the places, not the rate: what comes next does not follow on what was."""
        self.places.clear()

    def step(self, place: Place) -> Velocity | None:
        """The velocity k samples ago; None until the window is full. Times must rise."""
        if self.places:
            self._intervals_ns.append(place.t_ns - self.places[-1].t_ns)
        # Only at a start, so that a window in use keeps its length.
        if len(self._intervals_ns) == _INTERVALS and not (self.places and self.interval_ns):
            self.interval_ns = sorted(self._intervals_ns)[_INTERVALS // 2]
            self.half_window = max(MIN_HALF_WINDOW, round(self._half_window_ns / self.interval_ns))
        self.places.append(place)
        window = 2 * self.half_window + 1
        if len(self.places) > window and self.places[0].t_ns < place.t_ns - self._keep_ns:
            del self.places[0]
        return self._velocity() if len(self.places) >= window else None

    def _velocity(self) -> Velocity:
        k = self.half_window
        middle = self.places[-1 - k]
        azimuth = elevation = 0.0
        time_ns = 0
        for before, after in zip(self.places[-1 - 2 * k : -1 - k], self.places[-k:], strict=True):
            azimuth += after.azimuth_deg - before.azimuth_deg
            elevation += after.elevation_deg - before.elevation_deg
            time_ns += after.t_ns - before.t_ns
        per_s = 1e9 / time_ns
        across = math.cos(math.radians(middle.elevation_deg))
        return Velocity(middle.t_ns, azimuth * across * per_s, elevation * per_s)


class NoiseMeter:
    """σ of each axis over the last 2 s, from medians, so that the movements themselves hardly count: √median(v²).

    About 0, not about the median: while an eye pursues something, its own speed is part of what is usual.
    """

    def __init__(self) -> None:
        self._recent: collections.deque[Velocity] = collections.deque()
        self._updated_ns = 0
        self._sigma: tuple[float, float] | None = None

    def step(self, velocity: Velocity) -> tuple[float, float] | None:
        """σ in °/s of azimuth and of elevation; None for the first half second."""
        recent = self._recent
        if recent and velocity.t_ns - recent[-1].t_ns < _NOISE_STEP_NS:
            return self._sigma
        recent.append(velocity)
        while recent[0].t_ns < velocity.t_ns - NOISE_WINDOW_NS:
            recent.popleft()
        since_ns, wait_ns = (
            (recent[0].t_ns, MIN_NOISE_NS) if self._sigma is None else (self._updated_ns, _NOISE_UPDATE_NS)
        )
        if velocity.t_ns - since_ns >= wait_ns:
            speeds = np.array([(v.azimuth_deg_s, v.elevation_deg_s) for v in recent])
            azimuth, elevation = np.sqrt(np.median(speeds**2, axis=0)).tolist()
            self._sigma, self._updated_ns = (azimuth, elevation), velocity.t_ns
        return self._sigma
