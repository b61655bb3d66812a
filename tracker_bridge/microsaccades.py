"""Saccades and microsaccades of both eyes as they happen, from the directions of gaze alone.

Theory of operation: saccade_of_one_eye.py finds the fast movements of each eye. The two eyes make saccades together; so
where both are seen, both must move, with onsets less than 20 ms apart and not against one another. Where one eye alone
is seen, or a source gives only the direction of both together, that is enough. The eyes may be sampled at different
times.

Latency, from the onset to the sample that shows it: the two samples on which the velocity looks ahead and the one or
two that a movement takes to pass the threshold, 13 ms at 200 Hz in the median; 15 ms more for movements downwards.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from entoptic.tracker_bridge.events import SaccadeKind, SaccadeOffset, SaccadeOnset
from entoptic.tracker_bridge.saccade_of_one_eye import LONG_AGO_NS, Movement, OneEye, SaccadeSettings
from entoptic.tracker_bridge.saccade_velocity import Place
from entoptic.tracker_bridge.samples import Eye, GazeSample, Phase

SaccadeEvent = SaccadeOnset | SaccadeOffset

MIN_CONFIDENCE = 0.6
"""As for pupils (Pupil Core's own recommendation): below it a direction is the detector's guess."""

MICROSACCADE_DEG = 1.0
"""The largest microsaccade: the usual bound (Martinez-Conde et al. 2009, Trends Neurosci. 32, 463)."""

AGREE_NS = 20_000_000
"""Between the two eyes' onsets. Engineering choice: both start within a few ms, and each is found to within 10."""

COVERED = frozenset({Phase.CLOSING, Phase.BLINK, Phase.OPENING, Phase.DROPOUT})
"""Phases of a pupil in which its direction is not to be believed. Not `lost`: so is a pupil without a diameter."""

OWN_DIRECTIONS_NS = 500_000_000
"""So long after a direction of one eye the direction of both together, which is made of it, is left aside."""


class SaccadeDetector:
    """Feed it all directions of gaze, in the order of time for each eye.

    Every SaccadeOnset is followed by one SaccadeOffset with the same `onset_ns`, before the next SaccadeOnset, unless
    the stream ends first; where a blink or a gap cuts a movement short, its offset is the last that was seen of it.
    """

    def __init__(self, settings: SaccadeSettings | None = None) -> None:
        chosen = settings or SaccadeSettings()
        self._eyes: dict[Eye | None, OneEye] = {eye: OneEye(chosen) for eye in (*Eye, None)}
        self._under_way: tuple[Movement, ...] = ()
        self._onset_ns = 0
        self._own_ns = LONG_AGO_NS

    def step(self, sample: GazeSample) -> tuple[SaccadeEvent, ...]:
        """What one more direction shows. One of low confidence counts as a blink at its time."""
        t_ns = sample.t_ns
        if sample.eye is not None:
            self._own_ns = t_ns
        elif t_ns - self._own_ns < OWN_DIRECTIONS_NS:
            return ()
        eye = self._eyes[sample.eye]
        if sample.confidence < MIN_CONFIDENCE:
            eye.blind(t_ns)
        else:
            eye.step(Place(t_ns, sample.azimuth_deg, sample.elevation_deg))
        return self.tick(t_ns)

    def blind(self, t_ns: int, eye: Eye) -> tuple[SaccadeEvent, ...]:
        """A lid covers part of this eye's pupil: no movement is believed until 100 ms after.

        Call it for every sample of a pupil in one of the phases `COVERED`, before the direction of the same time. The
        direction of both eyes together is not to be believed either.
        """
        self._eyes[eye].blind(t_ns)
        self._eyes[None].blind(t_ns)
        return self.tick(t_ns)

    def tick(self, t_ns: int) -> tuple[SaccadeEvent, ...]:
        """Time has come so far: ends a movement whose eye is silent."""
        for eye in self._eyes.values():
            if eye.is_silent(t_ns):
                eye.cut()
        events: list[SaccadeEvent] = []
        if not self._under_way:
            self._under_way = tuple(self._together(t_ns))
            if self._under_way:
                events.append(self._onset(t_ns))
        if self._under_way and all(movement.end is not None for movement in self._under_way):
            events.append(self._offset(t_ns))
            self._under_way = ()
        return tuple(events)

    def _together(self, t_ns: int) -> Iterable[Movement]:
        """The movements, not told yet, that all eyes which are seen make together."""
        if all(eye.movement is None or eye.movement.reported for eye in self._eyes.values()):
            return ()
        movements = [eye.movement for eye in self._eyes.values() if eye.sees(t_ns)]
        ready = [m for m in movements if m is not None and not m.reported and m.report_from_ns <= t_ns]
        if not ready or len(ready) < len(movements):
            return ()
        onsets_ns = [movement.onset_ns for movement in ready]
        right, up = ready[0].direction
        if max(onsets_ns) - min(onsets_ns) > AGREE_NS or any(
            m.direction[0] * right + m.direction[1] * up <= 0.0 for m in ready
        ):
            return ()
        return ready

    def _onset(self, t_ns: int) -> SaccadeOnset:
        n = len(self._under_way)
        for movement in self._under_way:
            movement.reported = True
        self._onset_ns = round(sum(m.onset_ns for m in self._under_way) / n)
        return SaccadeOnset(
            t_ns=t_ns,
            onset_ns=self._onset_ns,
            azimuth_velocity_deg_s=sum(m.velocity.azimuth_deg_s for m in self._under_way) / n,
            elevation_velocity_deg_s=sum(m.velocity.elevation_deg_s for m in self._under_way) / n,
        )

    def _offset(self, t_ns: int) -> SaccadeOffset:
        ended = [(m.start, m.end, m.peak_velocity_deg_s) for m in self._under_way if m.end is not None]
        n = len(ended)
        azimuth = sum(end.azimuth_deg - start.azimuth_deg for start, end, _ in ended) / n
        elevation = sum(end.elevation_deg - start.elevation_deg for start, end, _ in ended) / n
        amplitude = sum(angle_deg(start, end) for start, end, _ in ended) / n
        return SaccadeOffset(
            t_ns=t_ns,
            onset_ns=self._onset_ns,
            offset_ns=round(sum(end.t_ns for _, end, _ in ended) / n),
            kind=SaccadeKind.MICROSACCADE if amplitude <= MICROSACCADE_DEG else SaccadeKind.SACCADE,
            amplitude_deg=amplitude,
            peak_velocity_deg_s=sum(peak for *_, peak in ended) / n,
            azimuth_deg=azimuth,
            elevation_deg=elevation,
        )


def angle_deg(one: Place, other: Place) -> float:
    """The angle between two directions; exact for small ones too."""
    across = math.cos(math.radians(one.elevation_deg)) * math.cos(math.radians(other.elevation_deg))
    up = math.sin(math.radians(other.elevation_deg - one.elevation_deg) / 2.0)
    aside = math.sin(math.radians(other.azimuth_deg - one.azimuth_deg) / 2.0)
    return math.degrees(2.0 * math.asin(min(math.sqrt(up**2 + across * aside**2), 1.0)))
