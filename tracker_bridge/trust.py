"""Which samples show a whole pupil, each judged by itself and the 25 ms before it.

Theory of operation: a lid that closes first covers part of the pupil, and the tracker reports, at good confidence, a
pupil that shrinks faster than any iris can; then it loses the pupil; then the same backwards. So a pupil counts as seen
when its confidence is good and its diameter is a pupil's, and as whole when it has not changed faster than an iris can.
All speeds are relative, so that they hold for diameters in mm and in pixels of any camera alike.
"""

from __future__ import annotations

import collections
import enum

from entoptic.tracker_bridge.samples import PupilSample

MIN_CONFIDENCE = 0.6
"""Pupil Core's own threshold for "useful" data (its user guide). Half-closed lids pass it, hence the speed gate."""
MIN_MODEL_CONFIDENCE = 0.5
"""Engineering choice: pye3d reports 0.1 for a lost eye model and 0.9–1 for a good one."""
DIAMETER_RANGE_MM = (1.0, 9.0)
"""No human pupil lies outside."""
MAX_SPEED_PER_S = 3.0
"""Diameters a second, of the larger of the two compared. Engineering choice: twice the fastest light reflex measured
(7.2 mm/s at 4.96 mm, so 1.46 a second: the mean response to a 1 µW flash, PLR-3000 data published with PyPlr, Martin
et al. 2022). Lids are faster: over the same 25 ms two people's blinks shrank the pupil by 15 and 17 a second at 500 Hz,
one person's by 3 to 10 (median of each of six series) at 120 Hz, simulated ones by 11."""
IRIS_SPEED_PER_S = 1.46
"""The fastest light reflex measured, of the diameter at that moment; source above."""
SPEED_WINDOW_NS = 25_000_000
"""A speed is that over this time: from sample to sample at 200 Hz noise alone would look like speed."""


class Sight(enum.Enum):
    """What one sample shows of the pupil."""

    HIDDEN = "hidden"
    """No pupil, or nothing that can be one."""
    SHRINKING = "shrinking"
    """A pupil that shrinks as only a lid makes it."""
    GROWING = "growing"
    """A pupil that grows as only a lid makes it."""
    JUMPING = "jumping"
    """A pupil whose millimetres jump while its image stays: the tracker's model of the eye has changed."""
    STEADY = "steady"
    """A pupil that changes no faster than an iris can."""


class Measure(enum.IntEnum):
    """What a stream's diameters are, the best that it ever gave."""

    NONE = 0
    PX = 1
    MM = 2


class Gate:
    """Judges one eye's samples in the order of their time."""

    def __init__(self) -> None:
        self.measure = Measure.NONE
        self._recent: collections.deque[tuple[int, float, float | None]] = collections.deque()

    def judge(self, sample: PupilSample) -> tuple[Sight, float | None]:
        """What the sample shows, and the diameter, in mm or px, where a pupil is seen and measured at all."""
        given = _measure(sample)
        if given > self.measure:
            self.measure = given
            self._recent.clear()
        size = self._size(sample)
        if not _is_sure(sample) or (size is None and self.measure is not Measure.NONE):
            self._recent.clear()
            return Sight.HIDDEN, None
        return (Sight.STEADY if size is None else self._moves(sample.t_ns, size, sample.diameter_px)), size

    def _size(self, sample: PupilSample) -> float | None:
        if self.measure is Measure.MM:
            low, high = DIAMETER_RANGE_MM
            return (
                sample.pupil_diameter_mm
                if sample.pupil_diameter_mm is not None and low <= sample.pupil_diameter_mm <= high
                else None
            )
        if self.measure is Measure.PX:
            # Infinity and NaN fail this too.
            return sample.diameter_px if sample.diameter_px is not None and 0.0 < sample.diameter_px < 1e6 else None
        return None

    def _moves(self, t_ns: int, size: float, px: float | None) -> Sight:
        recent = self._recent
        while len(recent) > 1 and recent[1][0] <= t_ns - SPEED_WINDOW_NS:
            recent.popleft()
        recent.append((t_ns, size, px))
        then_ns, then, then_px = recent[0]
        limit = MAX_SPEED_PER_S * max(t_ns - then_ns, SPEED_WINDOW_NS) * 1e-9
        if abs(size - then) <= limit * max(size, then):
            return Sight.STEADY
        if px is not None and then_px is not None and abs(px - then_px) <= limit * max(px, then_px):
            return Sight.JUMPING
        return Sight.SHRINKING if size < then else Sight.GROWING


def _measure(sample: PupilSample) -> Measure:
    if sample.pupil_diameter_mm is not None:
        return Measure.MM
    return Measure.NONE if sample.diameter_px is None else Measure.PX


def _is_sure(sample: PupilSample) -> bool:
    return sample.confidence >= MIN_CONFIDENCE and (
        sample.model_confidence is None or sample.model_confidence >= MIN_MODEL_CONFIDENCE
    )
