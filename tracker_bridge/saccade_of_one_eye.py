"""The fast movements of one eye, as they happen: threshold, onset, offset, blinks.

Theory of operation: a movement begins when the velocity has been beyond λσ for a while. Its onset is then found in
the places, which are sharper in time than the velocity over five of them. It ends when its velocity *along its own
direction* falls below the threshold; so what swings back after it, overshoot and post-saccadic oscillation, is not part
of it, and nothing that follows within 20 ms is a movement of its own. A lid that closes looks like a fast movement
downwards; so such a movement is held back for a moment and forgotten if the pupil goes meanwhile.
"""

from __future__ import annotations

import dataclasses
import math
import statistics
from collections.abc import Sequence

from entoptic.tracker_bridge.saccade_velocity import NoiseMeter, Place, Velocity, VelocityFilter

LONG_AGO_NS = -(2**62)


@dataclasses.dataclass(frozen=True)
class SaccadeSettings:
    """What counts as a movement. All measured, see docs/bridge.md."""

    threshold_sigmas: float = 6.0
    """λ: Engbert & Kliegl 2003."""
    run_ns: int = 5_000_000
    """From the first velocity beyond the threshold to the last: two samples at 200 Hz and below, more above."""
    floor_deg_s: float = 0.5
    """σ is never less: drift is no noise of the tracker, and a tracker without noise has no σ."""
    lid_wait_ns: int = 10_000_000
    """How long movements downwards are held back."""
    half_window_ns: int = 8_000_000
    """The velocity is taken from the samples within this before and after, but at least two and two: at 1000 Hz the
    five of Engbert & Kliegl span 4 ms, and their velocity is mostly noise."""


OVERSHOOT_NS = 20_000_000
"""What begins sooner after a movement is its overshoot (Engbert & Mergenthaler 2006, PNAS 103, 7192)."""

BLINK_MARGIN_NS = 100_000_000
"""Time after a blink, or after a gap, without movements: the lid still covers part of the pupil. Engineering choice:
reopening takes 150–200 ms, of which the pupil is covered for less than half."""

GAP_NS = 50_000_000
"""Samples further apart, and more than three intervals, do not follow on one another. Engineering choice: six at
124 Hz."""

LONGEST_NS = 250_000_000
"""What lasts longer is ended: a saccade of 50° takes 130–150 ms (Carpenter 1988, "Movements of the Eyes")."""

PEAK_NS = 4_000_000
"""Peak velocity is taken along the movement over this time, or from one sample to the next where they are further
apart: the window of the threshold would show a microsaccade of 0.2° at 200 Hz with a third of its velocity. Engineering
choice: half of the shortest movement."""

_RUN_SLACK = 0.9
"""Real sampling intervals jitter: a run may be so much shorter than it should be."""

_DOWNWARDS = -math.sqrt(0.5)
"""Within 45° of straight down."""

_ONSET = (0.02, 0.2, 1.0)
_OFFSET = (0.05, 0.2, 2.0)
"""An edge is found from when the eye crosses two shares of its way, as far as it is seen: where the line through them
meets the place of rest, or so many times as far. Twice is exact for an eye that brakes evenly. Measured on real and
simulated movements, see docs/bridge.md."""

_EDGE_SIGMAS = 2.0
"""The lower crossing is at least so many standard deviations of the noise of a place away from rest."""

_SIGMA_OF_MEDIAN = 1.4826
"""Standard deviation of normal noise over the square root of its median square."""

_STILL_AWAY = 0.5
"""Share of the way, as seen and as the velocity implies, at which the newest place must be: one wild sample comes and
goes, a movement stays."""


@dataclasses.dataclass
class Movement:
    """A fast movement of one eye; what is None is not known yet."""

    onset_ns: int
    start: Place
    velocity: Velocity
    """When it was found."""
    direction: tuple[float, float]
    """To the right and upwards, of length 1."""
    report_from_ns: int
    """Before this it may still turn out to be a lid."""
    end: Place | None = None
    """Its time is the offset."""
    peak_velocity_deg_s: float = 0.0
    """Known once it has ended."""
    reported: bool = False
    """It is part of a published event."""


class OneEye:
    """Feed it what is seen of one eye in the order of time, and look at `movement` after each step."""

    def __init__(self, settings: SaccadeSettings) -> None:
        self._settings = settings
        self._filter = VelocityFilter(settings.half_window_ns, LONGEST_NS)
        self._noise = NoiseMeter()
        self._run: list[Velocity] = []
        self._in_overshoot = False
        self._overshoot_until_ns = self._blind_until_ns = self._judged_ns = LONG_AGO_NS
        self._threshold = (math.inf, math.inf)
        self.last_ns = LONG_AGO_NS
        """Time of the last sample, good or bad."""
        self.movement: Movement | None = None
        """The newest one, ended or not."""

    def sees(self, t_ns: int) -> bool:
        """Whether a movement of this eye at this time would be noticed."""
        return not self._is_past(self._judged_ns, t_ns)

    def is_silent(self, t_ns: int) -> bool:
        """Whether its next sample is overdue at this time."""
        return self.last_ns > LONG_AGO_NS and self._is_past(self.last_ns, t_ns)

    def _is_past(self, then_ns: int, now_ns: int) -> bool:
        """Whether samples then and now are further apart than those of one stretch: GAP_NS, or three intervals."""
        return now_ns - then_ns > GAP_NS and now_ns - then_ns > 3 * self._filter.interval_ns

    def blind(self, t_ns: int) -> None:
        """At this time the direction is not to be trusted; nor is it for a while after."""
        self.last_ns = max(self.last_ns, t_ns)
        self._blind_until_ns = max(self._blind_until_ns, t_ns + BLINK_MARGIN_NS)
        self.cut()

    def cut(self) -> None:
        """Ends what is under way: the next place does not follow on the last. What was held back is forgotten."""
        movement = self.movement
        if movement is not None and movement.end is None:
            self._end(movement, max(movement.start, *self._filter.places[-1:]))
        if movement is not None and not movement.reported:
            self.movement = None
        self._run.clear()
        self._in_overshoot = False
        self._judged_ns = LONG_AGO_NS
        self._filter.restart()

    def step(self, place: Place) -> None:
        """One more place; times must rise."""
        if self.is_silent(place.t_ns):
            self.blind(place.t_ns)
        self.last_ns = place.t_ns
        if place.t_ns < self._blind_until_ns:
            return
        velocity = self._filter.step(place)
        sigma = None if velocity is None else self._noise.step(velocity)
        if velocity is None or sigma is None:
            return
        self._judged_ns = place.t_ns
        factor, floor = self._settings.threshold_sigmas, self._settings.floor_deg_s
        self._threshold = factor * max(sigma[0], floor), factor * max(sigma[1], floor)
        if self.movement is not None and self.movement.end is None:
            self._go_on(self.movement, velocity)
        else:
            self._look_for(velocity)

    def _fast(self, velocity: Velocity) -> bool:
        azimuth, elevation = self._threshold
        return math.hypot(velocity.azimuth_deg_s / azimuth, velocity.elevation_deg_s / elevation) > 1.0

    def _look_for(self, velocity: Velocity) -> None:
        if not self._fast(velocity):
            self._run.clear()
            self._in_overshoot = False
            return
        if not self._run and velocity.t_ns < self._overshoot_until_ns:
            self._in_overshoot = True
        if self._in_overshoot:
            self._overshoot_until_ns = velocity.t_ns + OVERSHOOT_NS
            return
        self._run.append(velocity)
        lasted_ns = velocity.t_ns - self._run[0].t_ns
        if len(self._run) > 1 and lasted_ns >= _RUN_SLACK * self._settings.run_ns:
            self._begin()

    def _begin(self) -> None:
        first = self._index(self._run[0].t_ns)
        places = self._filter.places
        start = _median(places[max(first + 1 - 2 * self._filter.half_window, 0) : first + 1])
        azimuth, elevation = (sum(velocity[axis] for velocity in self._run) for axis in (1, 2))
        speed = math.hypot(azimuth, elevation)
        direction = azimuth / speed, elevation / speed
        travel_deg = [_travel_deg(start, place, direction) for place in places[first:]]
        # What the run's velocity makes of a step between two places.
        implied = speed / len(self._run) * (self._filter.half_window + 1) * self._filter.interval_ns * 1e-9
        if travel_deg[-1] <= _STILL_AWAY * max(*travel_deg, implied):
            del self._run[0]
            return
        onset_ns = self._edge_ns([place.t_ns for place in places[first:]], travel_deg, *_ONSET)
        self.movement = Movement(
            onset_ns=onset_ns,
            start=start._replace(t_ns=onset_ns),
            velocity=self._run[-1],
            direction=direction,
            report_from_ns=places[-1].t_ns + (self._settings.lid_wait_ns if direction[1] < _DOWNWARDS else 0),
        )
        self._run.clear()

    def _go_on(self, movement: Movement, velocity: Velocity) -> None:
        right, up = movement.direction
        onwards = velocity.azimuth_deg_s * right + velocity.elevation_deg_s * up > 0.0
        if self._fast(velocity) and onwards and velocity.t_ns - movement.onset_ns < LONGEST_NS:
            return
        at = self._index(velocity.t_ns)
        places = self._filter.places
        end = _mean(places[at:])
        back = [place for place in places[at::-1] if place.t_ns >= movement.onset_ns]
        offset_ns = velocity.t_ns
        if back:
            travel_deg = [-_travel_deg(end, place, movement.direction) for place in back]
            offset_ns = self._edge_ns([place.t_ns for place in back], travel_deg, *_OFFSET)
        self._end(movement, end._replace(t_ns=max(offset_ns, movement.onset_ns)))
        self._overshoot_until_ns = offset_ns + OVERSHOOT_NS
        self._in_overshoot = self._fast(velocity)

    def _end(self, movement: Movement, end: Place) -> None:
        movement.end = end
        places = [p for p in self._filter.places if movement.start.t_ns - PEAK_NS < p.t_ns < end.t_ns + PEAK_NS]
        fastest = _peak_velocity_deg_s(places, movement.direction)
        movement.peak_velocity_deg_s = max(fastest, movement.velocity.speed_deg_s)

    def _index(self, t_ns: int) -> int:
        """Where in the places a velocity belongs: k or a little more from the end."""
        places = self._filter.places
        return next(at for at in range(len(places) - 1, -1, -1) if places[at].t_ns <= t_ns)

    def _edge_ns(
        self,
        times_ns: Sequence[int],
        travel_deg: Sequence[float],
        low_share: float,
        high_share: float,
        reach: float,
    ) -> int:
        """When a movement, 0 at first, began, or where the times run backwards, ended."""
        low = max(low_share * max(travel_deg), _EDGE_SIGMAS * self._place_noise_deg())
        high = max(high_share * max(travel_deg), 2.0 * low)
        if high <= low:
            return times_ns[0]
        low_ns, high_ns = (
            _crossing_ns(times_ns, travel_deg, low),
            _crossing_ns(times_ns, travel_deg, high),
        )
        return round(low_ns - reach * (high_ns - low_ns) * low / (high - low))

    def _place_noise_deg(self) -> float:
        """Standard deviation of a place, as the noise of the velocity tells it."""
        k = self._filter.half_window
        sigma_deg_s = sum(self._threshold) / (2.0 * self._settings.threshold_sigmas)
        times_s = k * (k + 1) * self._filter.interval_ns * 1e-9
        return _SIGMA_OF_MEDIAN * sigma_deg_s * times_s / math.sqrt(2.0 * k)


def _mean(places: Sequence[Place]) -> Place:
    n = len(places)
    return Place(places[-1].t_ns, sum(p.azimuth_deg for p in places) / n, sum(p.elevation_deg for p in places) / n)


def _median(places: Sequence[Place]) -> Place:
    return Place(
        places[-1].t_ns,
        statistics.median(place.azimuth_deg for place in places),
        statistics.median(place.elevation_deg for place in places),
    )


def _travel_deg(origin: Place, place: Place, direction: tuple[float, float]) -> float:
    """How far a place lies from another, in degrees of the sphere along a direction."""
    azimuth = (place.azimuth_deg - origin.azimuth_deg) * math.cos(math.radians(origin.elevation_deg))
    return azimuth * direction[0] + (place.elevation_deg - origin.elevation_deg) * direction[1]


def _peak_velocity_deg_s(places: Sequence[Place], direction: tuple[float, float]) -> float:
    """The fastest way between two places PEAK_NS apart, or neighbours where samples are rarer."""
    peak = 0.0
    later = 0
    for place in places:
        while later < len(places) and places[later].t_ns - place.t_ns < PEAK_NS:
            later += 1
        if later == len(places):
            break
        way_deg, time_ns = _travel_deg(place, places[later], direction), places[later].t_ns - place.t_ns
        peak = max(peak, way_deg / time_ns * 1e9)
    return peak


def _crossing_ns(times_ns: Sequence[int], travel_deg: Sequence[float], level: float) -> float:
    """When the travel rose above a level for good, between samples; the first or last time where it never does."""
    at = len(travel_deg) - 1
    while at > 0 and travel_deg[at - 1] > level:
        at -= 1
    if at == 0 or travel_deg[at] <= level:
        return times_ns[at]
    share = (level - travel_deg[at - 1]) / (travel_deg[at] - travel_deg[at - 1])
    return times_ns[at - 1] + share * (times_ns[at] - times_ns[at - 1])
