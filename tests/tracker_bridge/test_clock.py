import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge.clock import ArrivalClock, RoundTripClock
from entoptic.tracker_bridge.events import ClockEstimated, ClockJumped

S = 1_000_000_000
MS = 1_000_000


class Remote:
    """A clock elsewhere, with an offset and a rate, and a network with delays to it and back."""

    def __init__(self, seed: int, *, offset_ns: int, drift_ppm: float, slowest_ns: int = 2 * MS) -> None:
        self.offset_ns, self.rate, self.slowest_ns = offset_ns, 1.0 - drift_ppm * 1e-6, slowest_ns
        self.rng = np.random.default_rng(seed)

    def at(self, bridge_ns: int) -> int:
        return round((bridge_ns - 5 * S) * self.rate) + 5 * S - self.offset_ns

    def delay_ns(self) -> int:
        """15 µs at least, now and then a hundred times as much."""
        return 15_000 + min(round(self.rng.pareto(1.0) * 30_000), self.slowest_ns)

    def ask(self, clock: RoundTripClock, sent_ns: int) -> tuple[object, ...]:
        there_ns = sent_ns + self.delay_ns()
        return clock.add(sent_ns, self.at(there_ns), there_ns + self.delay_ns())


def polled(remote: Remote, seconds: int) -> tuple[RoundTripClock, list[object]]:
    clock, events = RoundTripClock(), []
    for k in range(16):
        events.extend(remote.ask(clock, 5 * S + k * MS))
    for k in range(1, seconds):
        events.extend(remote.ask(clock, (5 + k) * S))
    return clock, events


@given(
    seed=st.integers(0, 10_000),
    offset_ns=st.integers(-(10**18), 10**18),
    drift_ppm=st.floats(-100, 100),
    seconds=st.integers(2, 150),
)
def test_the_true_offset_lies_within_the_published_uncertainty(seed, offset_ns, drift_ppm, seconds):
    remote = Remote(seed, offset_ns=offset_ns, drift_ppm=drift_ppm)
    clock, events = polled(remote, seconds)
    assert not [event for event in events if isinstance(event, ClockJumped)]
    estimates = [event for event in events if isinstance(event, ClockEstimated)]
    assert estimates
    for estimate in estimates:
        true_ns = estimate.t_ns - remote.at(estimate.t_ns)
        assert abs(estimate.offset_ns - true_ns) <= estimate.uncertainty_ns + 1000
    now_ns = (5 + seconds) * S
    converted = clock.bridge_ns(remote.at(now_ns))
    assert converted is not None
    assert abs(converted - now_ns) < 2 * MS


def test_drift_is_found_within_a_minute():
    _, events = polled(Remote(1, offset_ns=123 * S, drift_ppm=80.0), 90)
    estimates = [event for event in events if isinstance(event, ClockEstimated)]
    assert estimates[3].drift_ppm == 0.0  # not told before it can be
    assert estimates[-1].drift_ppm == pytest.approx(80.0, abs=2.0)
    assert estimates[-1].uncertainty_ns < 0.2 * MS


def test_a_clock_that_somebody_sets_is_noticed_at_the_next_answer():
    remote = Remote(2, offset_ns=7 * S, drift_ppm=20.0)
    clock, _ = polled(remote, 30)
    remote.offset_ns -= 100 * S
    events = remote.ask(clock, 36 * S)
    jump = next(event for event in events if isinstance(event, ClockJumped))
    assert jump.jump_ns == pytest.approx(100 * S, abs=5 * MS)
    converted = clock.bridge_ns(remote.at(37 * S))
    assert converted == pytest.approx(37 * S, abs=5 * MS)


def test_one_slow_answer_is_no_jump():
    remote = Remote(3, offset_ns=0, drift_ppm=0.0)
    clock, _ = polled(remote, 30)
    before = clock.bridge_ns(remote.at(40 * S))
    events = clock.add(35 * S, remote.at(38 * S), 38 * S)  # three seconds on the way there, none back
    assert not [event for event in events if isinstance(event, ClockJumped)]
    assert clock.bridge_ns(remote.at(40 * S)) == pytest.approx(before, abs=1000)


def test_nothing_is_converted_before_the_clock_is_known():
    clock = RoundTripClock()
    assert clock.bridge_ns(5) is None
    clock.add(0, 10, 20)
    assert clock.bridge_ns(5) is None
    assert ArrivalClock().bridge_ns(5) is None


def arrivals(clock: ArrivalClock, remote: Remote, from_s: float, to_s: float, late_ns: int = 0) -> list[object]:
    """Samples at 200 Hz that need 1 ms at least, and up to 2 ms more."""
    events = []
    for k in range(round(from_s * 200), round(to_s * 200)):
        taken_ns = k * 5 * MS
        events.extend(clock.add(remote.at(taken_ns), taken_ns + MS + late_ns + remote.delay_ns()))
    return events


@given(seed=st.integers(0, 10_000), offset_ns=st.integers(-(10**18), 10**18), drift_ppm=st.floats(-100, 100))
def test_arrivals_tell_the_offset_to_their_least_delay(seed, offset_ns, drift_ppm):
    remote, clock = Remote(seed, offset_ns=offset_ns, drift_ppm=drift_ppm), ArrivalClock(MS)
    events = arrivals(clock, remote, 5.0, 40.0)
    assert not [event for event in events if isinstance(event, ClockJumped)]
    estimate = [event for event in events if isinstance(event, ClockEstimated)][-1]
    assert abs(estimate.offset_ns - (estimate.t_ns - remote.at(estimate.t_ns))) <= estimate.uncertainty_ns
    assert estimate.drift_ppm == pytest.approx(drift_ppm, abs=10.0)
    assert estimate.uncertainty_ns < 3 * MS


@pytest.mark.parametrize("jump_s", [100, -100, 0.3, -0.3])
def test_a_device_that_starts_anew_is_noticed(jump_s):
    remote, clock = Remote(4, offset_ns=S, drift_ppm=0.0), ArrivalClock(MS)
    arrivals(clock, remote, 5.0, 10.0)
    remote.offset_ns -= round(jump_s * S)
    jumps = [event for event in arrivals(clock, remote, 10.0, 13.0) if isinstance(event, ClockJumped)]
    assert [jump.jump_ns for jump in jumps] == [pytest.approx(jump_s * S, abs=10 * MS)]
    assert clock.bridge_ns(remote.at(14 * S)) == pytest.approx(14 * S, abs=5 * MS)


def test_a_queue_that_empties_is_no_jump():
    remote, clock = Remote(5, offset_ns=S, drift_ppm=0.0), ArrivalClock(MS)
    arrivals(clock, remote, 5.0, 10.0)
    events = []
    for k in range(800):  # four seconds of samples come within two, the first of them three seconds late
        taken_ns = 10 * S + k * 5 * MS
        events.extend(clock.add(remote.at(taken_ns), max(13 * S + k * 2_500_000, taken_ns + 2 * MS)))
    assert not [event for event in events if isinstance(event, ClockJumped)]
    assert clock.bridge_ns(remote.at(20 * S)) == pytest.approx(20 * S, abs=5 * MS)


def test_a_first_sample_that_was_late_makes_no_jump_of_those_that_follow() -> None:
    remote, clock = Remote(6, offset_ns=S, drift_ppm=0.0), ArrivalClock(MS)
    clock.add(remote.at(5 * S), 5 * S + 200 * MS)
    events = arrivals(clock, remote, 5.2, 9.0)
    assert not [event for event in events if isinstance(event, ClockJumped)]
    assert clock.bridge_ns(remote.at(9 * S)) == pytest.approx(9 * S, abs=3 * MS)


def test_one_late_sample_after_a_pause_is_no_jump_whenever_the_pause_began() -> None:
    for k in range(210):  # more samples than a second has
        remote, clock = Remote(7, offset_ns=S, drift_ppm=0.0), ArrivalClock(MS)
        arrivals(clock, remote, 5.0, 6.2 + k * 0.005)
        events = list(clock.add(remote.at(13 * S), 13 * S + 200 * MS))
        events += arrivals(clock, remote, 13.2, 13.3)
        assert not [event for event in events if isinstance(event, ClockJumped)]
        assert clock.bridge_ns(remote.at(14 * S)) == pytest.approx(14 * S, abs=3 * MS)
