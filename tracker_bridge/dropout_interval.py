"""One time during which a pupil is not trusted, and what it is: a blink, an eye held closed, or a dropout.

Theory of operation: a lid is told from other dropouts by its signs: openness, where the source gives it; else a pupil
that shrinks as only a lid makes it, or whose outline fades before it goes. Where no sign could be seen, because the
source gives no diameter or too few samples a second, a hidden pupil counts as a blink: that is what it nearly always
is.
"""

from __future__ import annotations

import collections
import statistics

from entoptic.tracker_bridge.extrapolation import Extrapolation
from entoptic.tracker_bridge.samples import Phase, PupilSample
from entoptic.tracker_bridge.trust import IRIS_SPEED_PER_S, MIN_CONFIDENCE, SPEED_WINDOW_NS, Sight

SETTLE_NS = 50_000_000
"""How long a pupil must be whole again before it is trusted. Engineering choice, as Kret & Sjak-Shie 2019 pad."""
LOST_AFTER_NS = 500_000_000
"""Engineering choice: longer than any blink that is not held (300–400 ms, Luidolt 2020)."""
HALF_CLOSED_NS = 3_000_000_000
"""A pupil that shrank as only a lid makes it, and never went, is not trusted for so long unless it is whole again.
Engineering choice: a real person's squints lasted 1–2.5 s; and an eye model that changed for good is lost no longer."""
MIN_COVER_NS = 25_000_000
"""A pupil is gone for at least so long in a blink. Engineering choice: the shortest of 23 blinks that people labelled
hid the pupil for 27 ms; a flickering outline lost it for up to 22 ms at a time."""
WHOLE_SHARE = 0.9
"""A pupil below this share of the diameter held shows a lid. Engineering choice: noise is less."""
NOTHING_FOUND = 0.1
"""Below this confidence there is not even a faint outline. Engineering choice: 0 is usual."""
SIGHTS_OF_A_LID = 4
"""Samples in one speed window from which on a lid cannot pass unseen. Engineering choice: at 120 Hz, with three, a
quarter and more of a person's long blinks showed no shrinking pupil."""
CLOSED_OPENNESS = 0.3
"""At this openness a lid covers all of a 4 mm pupil (see lids.py)."""


class Lids:
    """The openness that a source gives, without its outliers."""

    def __init__(self) -> None:
        self._recent: collections.deque[float] = collections.deque(maxlen=3)

    def closed(self, openness: float | None) -> bool | None:
        """Whether the lids hide the pupil after one more sample; None where the source does not say."""
        if openness is None:
            return None
        # Of closed eyes openness is noise, which the median of three samples takes out where it is above.
        self._recent.append(openness)
        return statistics.median_low(self._recent) < CLOSED_OPENNESS


class DropoutInterval:
    """Feed it all samples from the first mistrusted one on."""

    def __init__(self, since_ns: int, onset_ns: int, extrapolation: Extrapolation | None, *, lost: bool) -> None:
        self.since_ns = since_ns
        """The first mistrusted sample, or the last one before a silence."""
        self.onset_ns = onset_ns
        """When a lid began to touch the pupil, if it is a blink."""
        self.extrapolation = extrapolation
        """Where the pupil is supposed to be meanwhile; None where it has no diameter."""
        self.lid = False
        """A sign of a lid was seen."""
        self.blink = False
        """It is known to be a blink."""
        self.blink_reported = False
        self.lost = lost
        """It counts as a loss, and that was told."""
        self._closed: bool | None = None
        self._faded = False
        self._hidden = False
        self._whole_ns = onset_ns
        self._good_since_ns: int | None = None

    def add(self, sample: PupilSample, sight: Sight, size: float | None, closed: bool | None, interval_ns: int) -> None:
        """One more sample of a source that usually takes one every `interval_ns`."""
        t_ns = sample.t_ns
        if sight is Sight.JUMPING and size is not None:
            # The pupil is where it was: only the scale is another.
            self.extrapolation = Extrapolation([(t_ns, size)])
        supposed = None if self.extrapolation is None else self.extrapolation.at(t_ns)
        whole = size is None or supposed is None or size >= WHOLE_SHARE * supposed
        hidden = sight is Sight.HIDDEN
        self._hidden = self._hidden or hidden
        if whole and not hidden:
            self._whole_ns = t_ns
        if closed is not None:
            self._closed = self._closed or closed
        self.lid = self.lid or self._shows_lid(sample, sight, whole, interval_ns)
        # Of a pupil long lost only openness can still tell.
        if hidden and self.lid and (self._closed or (self._closed is None and not self.lost)):
            self.blink = self.blink or t_ns - self._whole_ns >= MIN_COVER_NS
        if sight is not Sight.STEADY or not self._is_possible(t_ns, size, supposed):
            self._good_since_ns = None
            return
        if self._good_since_ns is None:
            self._good_since_ns = t_ns
        if not self.blink:
            # What went before was a flicker: a blink, if one comes, begins after this.
            self.onset_ns = t_ns

    def _shows_lid(self, sample: PupilSample, sight: Sight, whole: bool, interval_ns: int) -> bool:
        if self._closed or sight is Sight.SHRINKING or not whole:
            return True
        if self._closed is False or sight is not Sight.HIDDEN:
            return False
        if sample.confidence >= NOTHING_FOUND:
            self._faded = self._faded or sample.confidence < MIN_CONFIDENCE
            return False
        return self._faded or self.extrapolation is None or interval_ns * SIGHTS_OF_A_LID > SPEED_WINDOW_NS

    def _is_possible(self, t_ns: int, size: float | None, supposed: float | None) -> bool:
        """Whether the iris can have brought the pupil there, and no lid."""
        if size is None or supposed is None:
            return True
        if self.lid and not self.blink and size < WHOLE_SHARE * supposed:
            return t_ns - self.since_ns >= HALF_CLOSED_NS
        reach = IRIS_SPEED_PER_S * (t_ns - self.since_ns) * 1e-9
        near = abs(size - supposed) <= max(size, supposed) * max(reach, 1.0 - WHOLE_SHARE)
        return near or t_ns - self.since_ns >= LOST_AFTER_NS

    def fall_silent(self) -> None:
        """No sample came for a while."""
        self._good_since_ns = None

    def is_over(self, t_ns: int) -> bool:
        """Whether the pupil has been whole for long enough."""
        return self._good_since_ns is not None and t_ns - self._good_since_ns >= SETTLE_NS

    def phase(self, sight: Sight) -> Phase:
        """What to call it at a sample."""
        opens = self._good_since_ns is not None or sight is Sight.GROWING
        if self.lost and not (self.lid and opens):
            return Phase.LOST
        if not self.lid:
            return Phase.DROPOUT
        if sight is Sight.HIDDEN:
            return Phase.CLOSING if self._closed is False else Phase.BLINK
        return Phase.OPENING if self._hidden else Phase.CLOSING
