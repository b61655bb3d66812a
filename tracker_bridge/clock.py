"""How a source's clock stands to the bridge's: offset, drift, and how far to trust both.

Theory of operation: the offset is the bridge's clock less the source's. Every measurement of it is a point with a
known error: a question and its answer bracket it to half the round trip; a sample that merely arrives bounds it from
above, and the least of a second's bounds is taken. A line through the points of the last minute, each weighted by the
inverse square of its error, gives offset and drift. A point that lies further off the line than its own error and
10 ms is no noise: somebody set the source's clock, and the line starts again from that point.
"""

from __future__ import annotations

import collections
import dataclasses
import time

from entoptic.tracker_bridge.events import ClockEstimated, ClockJumped
from entoptic.tracker_bridge.samples import NS_PER_S

ClockEvent = ClockEstimated | ClockJumped

WINDOW_NS = 60 * NS_PER_S
"""Drift is fitted over a minute: quartz wanders with temperature over longer times."""
MIN_DRIFT_SPAN_NS = 10 * NS_PER_S
"""Over less, an error of 0.1 ms at either end would look like 20 ppm."""
MAX_DRIFT_PPM = 200.0
"""What is allowed for where the drift is not known yet. Engineering choice: cheap quartz is within 100 ppm, two
clocks may err in opposite directions."""
JUMP_NS = 10_000_000
"""A change of the offset by more is a new timebase, less is noise or drift."""
SETTLED_AFTER = 4
"""Round trips before times are converted. Engineering choice: the first ones of a connection are the slowest."""
BEST_OF = 8
"""Of so many round trips the shortest bounds the uncertainty: a mean would take in the slow ones."""
REPORT_EVERY_NS = NS_PER_S
_LEAST_ERROR_NS = max(1_000, round(time.get_clock_info("monotonic").resolution * NS_PER_S))
"""No clock is read more finely across two processes, nor than it ticks: in steps of 16 ms on some systems."""


@dataclasses.dataclass(frozen=True, slots=True)
class _Point:
    at_ns: int
    """On the source's clock."""
    offset_ns: int
    error_ns: int


class _Line:
    """Offset against the source's time."""

    def __init__(self) -> None:
        self._points: collections.deque[_Point] = collections.deque()
        self._origin = _Point(0, 0, _LEAST_ERROR_NS)
        self._level_ns = self._slope = 0.0
        self._slope_error = MAX_DRIFT_PPM * 1e-6

    def __len__(self) -> int:
        return len(self._points)

    def restart(self, point: _Point) -> None:
        self._points.clear()
        self.add(point)

    def add(self, point: _Point) -> None:
        while self._points and point.at_ns - self._points[0].at_ns > WINDOW_NS:
            self._points.popleft()
        self._points.append(point)
        self._fit()

    def _fit(self) -> None:
        """Weighted least squares, in numbers relative to the first point so that no digit is lost."""
        self._origin = first = self._points[0]
        weights = [1.0 / point.error_ns**2 for point in self._points]
        total = sum(weights)
        x = [float(point.at_ns - first.at_ns) for point in self._points]
        y = [float(point.offset_ns - first.offset_ns) for point in self._points]
        x_mean = sum(w * at for w, at in zip(weights, x, strict=True)) / total
        y_mean = sum(w * at for w, at in zip(weights, y, strict=True)) / total
        self._slope, self._slope_error = 0.0, MAX_DRIFT_PPM * 1e-6
        if x[-1] >= MIN_DRIFT_SPAN_NS:
            xx = sum(w * (at - x_mean) ** 2 for w, at in zip(weights, x, strict=True))
            xy = sum(w * (at - x_mean) * (to - y_mean) for w, at, to in zip(weights, x, y, strict=True))
            self._slope = min(max(xy / xx, -self._slope_error), self._slope_error)
            self._slope_error = min(xx**-0.5, self._slope_error)
        self._level_ns = y_mean - self._slope * x_mean

    def offset_ns(self, at_ns: int) -> int:
        past_first_ns = at_ns - self._origin.at_ns
        return self._origin.offset_ns + round(self._level_ns + self._slope * past_first_ns)

    @property
    def drift_ppm(self) -> float:
        return self._slope * 1e6

    def uncertainty_ns(self, at_ns: int) -> int:
        """The shortest of the last bounds, how far the line leaves its middle, and what drift may have done since."""
        latest = [self._points[-1 - k] for k in range(min(BEST_OF, len(self._points)))]
        return min(
            point.error_ns
            + abs(self.offset_ns(point.at_ns) - point.offset_ns)
            + round(self._slope_error * abs(at_ns - point.at_ns))
            for point in latest
        )


class _Clock:
    def __init__(self) -> None:
        self._line = _Line()
        self._reported_ns: int | None = None

    def bridge_ns(self, source_ns: int) -> int | None:
        """A source's time on the bridge's clock; None before the clock is known."""
        return source_ns + self._line.offset_ns(source_ns) if self._settled else None

    @property
    def _settled(self) -> bool:
        return len(self._line) > 0

    def _report(self, source_ns: int, now_ns: int) -> tuple[ClockEvent, ...]:
        if not self._settled or (self._reported_ns is not None and now_ns - self._reported_ns < REPORT_EVERY_NS):
            return ()
        self._reported_ns = now_ns
        line = self._line
        return (ClockEstimated(now_ns, line.offset_ns(source_ns), line.drift_ppm, line.uncertainty_ns(source_ns)),)

    def _jump(self, point: _Point, now_ns: int) -> tuple[ClockEvent, ...]:
        """Starts again. A source's clock that went forwards leaves less of the bridge's over it."""
        jump_ns = self._line.offset_ns(point.at_ns) - point.offset_ns
        self._line.restart(point)
        self._reported_ns = None
        return (ClockJumped(now_ns, jump_ns), *self._report(point.at_ns, now_ns))


class RoundTripClock(_Clock):
    """A clock that answers when asked for its time, such as Pupil Remote's."""

    def __init__(self) -> None:
        super().__init__()
        self._asked = 0

    def add(self, sent_ns: int, source_ns: int, received_ns: int) -> tuple[ClockEvent, ...]:
        """One question: asked and answered at these times of the bridge's clock, the answer between them.

        The very first answer is left out: it waits for the connection.
        """
        self._asked += 1
        if self._asked == 1:
            return ()
        error_ns = max((received_ns - sent_ns) // 2, _LEAST_ERROR_NS)
        point = _Point(source_ns, (sent_ns + received_ns) // 2 - source_ns, error_ns)
        if self._settled and abs(point.offset_ns - self._line.offset_ns(source_ns)) - error_ns > JUMP_NS:
            return self._jump(point, received_ns)
        self._line.add(point)
        return self._report(source_ns, received_ns)

    @property
    def _settled(self) -> bool:
        return self._asked > SETTLED_AFTER


class ArrivalClock(_Clock):
    """A clock that is only seen in the samples that arrive, such as a USB device's.

    What a sample needs at least from the eye to here cannot be told from arrivals; `least_delay_ns` says it, and counts
    as uncertainty.
    """

    def __init__(self, least_delay_ns: int = 1_000_000) -> None:
        super().__init__()
        self._least_delay_ns = least_delay_ns
        self._least: _Point | None = None
        self._greatest_ns = 0
        self._until_ns = 0
        self._is_first = True
        self._last_source_ns: int | None = None

    def add(self, source_ns: int, received_ns: int) -> tuple[ClockEvent, ...]:
        """One sample: taken at this time of its source's clock, here at this time of the bridge's.

        A clock set forwards shows at once, or when its times run backwards; one set back otherwise only looks late,
        and is taken for set when a second of samples was equally late. After a pause that second is one of its own.
        """
        bound_ns = received_ns - source_ns - self._least_delay_ns
        point = _Point(source_ns, bound_ns, max(self._least_delay_ns, _LEAST_ERROR_NS))
        backwards = self._last_source_ns is not None and source_ns < self._last_source_ns - JUMP_NS
        self._last_source_ns = source_ns
        if not self._settled:
            self._line.restart(point)
            self._begin(received_ns, is_first=True)
            return self._report(source_ns, received_ns)
        earlier_ns = self._line.offset_ns(source_ns) - bound_ns
        if self._is_first and not backwards and earlier_ns > 0:
            # The sample it all began with was late.
            self._line.restart(point)
            return ()
        if backwards or earlier_ns > JUMP_NS:
            self._begin(received_ns, is_first=True)
            return self._jump(point, received_ns)
        if self._least is None and received_ns >= self._until_ns:
            self._begin(received_ns)
        if self._least is None or bound_ns < self._least.offset_ns:
            self._least = point
        self._greatest_ns = max(self._greatest_ns, bound_ns)
        if received_ns < self._until_ns:
            return ()
        least, spread_ns = self._least, self._greatest_ns - self._least.offset_ns
        self._begin(received_ns)
        if least.offset_ns - self._line.offset_ns(least.at_ns) > JUMP_NS:
            # Late by the same for a second: another clock. Late by ever less: a queue that empties.
            if spread_ns >= JUMP_NS:
                return ()
            self._is_first = True
            return self._jump(point, received_ns)
        self._line.add(least)
        return self._report(source_ns, received_ns)

    def _begin(self, now_ns: int, *, is_first: bool = False) -> None:
        """A new second; the first one of a timebase only finds the offset."""
        self._is_first = is_first
        self._least, self._greatest_ns, self._until_ns = None, -(2**63), now_ns + NS_PER_S
