"""What the last seconds of states and frames come to: rates, lost eyes, frames left out, latency."""

from __future__ import annotations

import collections
import statistics

import numpy as np

from entoptic.services.console.protocol import Latency
from entoptic.services.ipc.messages import LatencyMs, Shown
from entoptic.tracker_bridge.wire import Eye, EyeState, Phase

RATE_S = 2.0
DROPS_S = 10.0
LATENCY_FRAMES = 1500
"""A minute's at 24 frames a second."""
BIN_MS, BINS = 10.0, 41
"""The last bar holds 400 ms and more."""


class Figures:
    """Of one session; for one thread. Times are `time.monotonic`'s."""

    def __init__(self) -> None:
        self.state_s: float | None = None
        """When the newest state came."""
        self.shown: Shown | None = None
        self.shown_s: float | None = None
        self._came_s: collections.deque[float] = collections.deque(maxlen=10_000)
        self._lost_since_s: dict[str, float] = {}
        self._frames: collections.deque[tuple[float, int, int]] = collections.deque(maxlen=10_000)
        self._latencies: collections.deque[LatencyMs] = collections.deque(maxlen=LATENCY_FRAMES)

    def add_state(self, state: EyeState, now_s: float) -> None:
        """One that came now."""
        self.state_s = now_s
        self._came_s.append(now_s)
        for eye in Eye:
            name = eye.name.lower()
            if state.of(eye).phase is not Phase.LOST:
                self._lost_since_s.pop(name, None)
            else:
                self._lost_since_s.setdefault(name, now_s)

    def add_shown(self, shown: Shown, now_s: float) -> None:
        """A frame that came now."""
        if self.shown is not None and shown.frame < self.shown.frame:
            self._frames.clear()  # another worker, which counts again
        self.shown, self.shown_s = shown, now_s
        self._frames.append((now_s, shown.frame, shown.dropped))
        if shown.latency is not None:
            self._latencies.append(shown.latency)

    def states_hz(self, now_s: float) -> float:
        """States that came in the last two seconds, each second."""
        came_s = list(self._came_s)
        return sum(one > now_s - RATE_S for one in came_s) / RATE_S

    def lost_s(self, now_s: float) -> dict[str, float]:
        """For how long each lost eye has been lost."""
        return {eye: now_s - since_s for eye, since_s in dict(self._lost_since_s).items()}

    def dropped_share(self, now_s: float) -> float:
        """Of the frames that were due in the last ten seconds."""
        recent = [one for one in list(self._frames) if one[0] > now_s - DROPS_S]
        if len(recent) < 2:
            return 0.0
        (_, first, dropped_before), (_, last, dropped) = recent[0], recent[-1]
        return max(dropped - dropped_before, 0) / max(last - first, 1)

    def latency(self) -> Latency | None:
        """Over the last minute's frames; None where none of them had one."""
        kept = list(self._latencies)
        if not kept:
            return None
        totals = np.array([one.total for one in kept])
        bars = np.clip(totals / BIN_MS, 0, BINS - 1).astype(int)
        return Latency(
            p50_ms=float(np.percentile(totals, 50)),
            p95_ms=float(np.percentile(totals, 95)),
            bin_ms=BIN_MS,
            counts=[int(count) for count in np.bincount(bars, minlength=BINS)],
            sample_to_state_ms=statistics.median(one.sample_to_state for one in kept),
            state_to_frame_ms=statistics.median(one.state_to_frame for one in kept),
            frame_to_sink_ms=statistics.median(one.frame_to_sink for one in kept),
        )
