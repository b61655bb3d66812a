"""Pupil time: the monotonic clock of the machine that Capture runs on, less a timebase that any client may set."""

from __future__ import annotations

_PPM = 1e-6


class CaptureClock:
    """What Capture's clock shows, in s, at a time of this machine's monotonic clock.

    `offset_s` stands for another machine's clock, which started at another time.
    """

    def __init__(self, start_s: float, offset_s: float) -> None:
        self._anchor_s, self._host_anchor_s, self._rate = start_s, start_s + offset_s, 1.0
        self._timebase_s = 0.0

    def pupil_s(self, monotonic_s: float) -> float:
        """Pupil time at a monotonic time."""
        return self._host_s(monotonic_s) - self._timebase_s

    def set(self, monotonic_s: float, pupil_s: float) -> None:
        """Pupil time becomes `pupil_s` now: Pupil Remote's `T`."""
        self._timebase_s = self._host_s(monotonic_s) - pupil_s

    def jump(self, seconds: float) -> None:
        """Pupil time goes forwards at once."""
        self._timebase_s -= seconds

    def drift(self, monotonic_s: float, ppm: float) -> None:
        """From now on this clock runs faster than this machine's, by parts per million."""
        self._host_anchor_s = self._host_s(monotonic_s)
        self._anchor_s, self._rate = monotonic_s, 1.0 + ppm * _PPM

    def restart(self) -> None:
        """A new program on the same machine: what clients had set is forgotten."""
        self._timebase_s = 0.0

    def _host_s(self, monotonic_s: float) -> float:
        return self._host_anchor_s + (monotonic_s - self._anchor_s) * self._rate
