"""Pupil Capture's own blink detector, so that a client meets the blinks that it would meet there.

The 2-D confidences of both eyes in one window of 0.2 s are weighted +1/n in its first half and −1/n in its second, the
middle one of an odd number not at all, and the sum is divided by 0.45: above 0.5 an onset, below −0.5 an offset. The
recorded events of Capture 3.6.14 follow this to the last bit. Latency: an event has the time of the pupil in the middle
of its window, so it comes 0.1 s after its own time, and it comes again each world frame while the sum stays large.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from entoptic.tracker_bridge.sources.pupil_core.form import Map

WINDOW_S = 0.2
_SCALE = 0.45
_THRESHOLD = 0.5


class BlinkFilter:
    """Takes in 2-D pupil datums, both eyes', as they come; gives a blink datum or none each world frame."""

    def __init__(self) -> None:
        self._window: deque[Map] = deque()

    def frame(self, arrived: Iterable[Map]) -> Map | None:
        """What the detector says now, after these datums."""
        self._window.extend(arrived)
        if not self._window:
            return None
        newest_s = float(self._window[-1]["timestamp"])
        span_s = newest_s - float(self._window[0]["timestamp"])
        if not span_s >= 0.0:
            # The clock was set back, or to no number.
            self._window.clear()
        if not span_s >= WINDOW_S:
            return None
        # The window is the shortest that is not shorter than 0.2 s.
        while newest_s - float(self._window[1]["timestamp"]) >= WINDOW_S:
            self._window.popleft()
        response = filter_response([float(datum["confidence"]) for datum in self._window])
        if abs(response) <= _THRESHOLD:
            return None
        return {
            "topic": "blinks",
            "type": "onset" if response > 0.0 else "offset",
            "confidence": min(abs(response), 1.0),
            "base_data": list(self._window),
            "timestamp": self._window[len(self._window) // 2]["timestamp"],
            "record": True,
        }


def filter_response(confidences: list[float]) -> float:
    """How much more confident the first half of the window is than the second, 1 for a whole blink's edge."""
    n = len(confidences)
    half = n // 2
    return (sum(confidences[:half]) - sum(confidences[n - half :])) / n / _SCALE
