"""Samples in, states and events out."""

import itertools
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge import wire
from entoptic.tracker_bridge.chain import Chain, records_of
from entoptic.tracker_bridge.dropout import SLEW_MM_S
from entoptic.tracker_bridge.events import ClockEstimated, ClockJumped, Event, PupilBack, PupilLost, SourceSilent
from entoptic.tracker_bridge.samples import Eye, EyeState, GazeSample, Phase, PupilSample
from entoptic.tracker_bridge.source import Item, Tick

MS = 1_000_000


def both_eyes(count: int, from_ms: int = 0) -> list[Item]:
    made: list[Item] = []
    for k in range(count):
        made += [PupilSample((from_ms + k * 5) * MS, eye, 4.0, 1.0) for eye in Eye]
        made.append(GazeSample((from_ms + k * 5) * MS, None, k % 10, -1.0, 0.9))
    return made


def states_of(items: Iterable[Item], chain: Chain | None = None) -> list[EyeState]:
    return [record for record in records_of(items, chain) if isinstance(record, EyeState)]


def events_of(items: Iterable[Item], chain: Chain | None = None) -> list[Event]:
    return [record for record in records_of(items, chain) if not isinstance(record, EyeState)]


def test_one_state_a_moment_with_everything_of_that_moment() -> None:
    states = states_of(both_eyes(20))
    assert [state.sequence for state in states] == list(range(20))
    assert [state.t_ns for state in states] == [k * 5 * MS for k in range(20)]
    last = states[-1]
    assert last.left.phase is last.right.phase is Phase.TRACKING
    assert last.left.t_ns == last.right.t_ns == last.t_ns
    assert last.gaze is not None
    assert (last.gaze.azimuth_deg, last.gaze.elevation_deg) == (9, -1)


def test_before_an_eye_is_seen_it_is_lost_and_without_a_diameter() -> None:
    (state,) = states_of([GazeSample(0, None, 1.0, 1.0, 1.0)])
    assert state.left.phase is Phase.LOST
    assert state.left.pupil_diameter_mm is None
    assert not state.left.borrowed
    assert state.gaze is not None


def test_gaze_of_both_eyes_is_the_mean_of_the_fresh_ones() -> None:
    samples: list[Item] = [
        GazeSample(0, Eye.LEFT, 4.0, 0.0, 1.0),
        GazeSample(0, Eye.RIGHT, 2.0, 2.0, 1.0),
        GazeSample(100 * MS, Eye.LEFT, 8.0, 0.0, 1.0),
        GazeSample(101 * MS, Eye.RIGHT, 50.0, 0.0, 0.1),
    ]
    gazes = [state.gaze for state in states_of(samples)]
    assert [(gaze.azimuth_deg, gaze.elevation_deg) for gaze in gazes if gaze] == [(3.0, 1.0), (8.0, 0.0), (8.0, 0.0)]


def test_gaze_of_both_is_that_of_one_eye_while_the_source_sees_one_alone() -> None:
    items: list[Item] = []
    for k in range(100):  # from 100 to 300 ms the left eye is closed
        t_ns = k * 5 * MS
        if 20 <= k < 60:
            items.append(GazeSample(t_ns, Eye.RIGHT, k, 0.0, 1.0))
        else:
            items += [GazeSample(t_ns, None, k, 0.0, 1.0), GazeSample(t_ns + MS, Eye.RIGHT, k + 0.5, 0.0, 1.0)]
    for state in states_of(items):
        assert state.gaze is not None
        was_given = not 100 * MS <= state.t_ns < 300 * MS
        if was_given:
            assert state.gaze.azimuth_deg == state.gaze.t_ns // (5 * MS)
        elif state.t_ns > 150 * MS:
            assert state.gaze.t_ns == state.t_ns


def test_the_chain_is_the_same_to_the_bit_twice() -> None:
    samples = both_eyes(200)
    first, second = ([wire.encode_state(state) for state in states_of(samples)] for _ in range(2))
    assert first == second


def test_a_live_moment_is_out_as_soon_as_a_tick_says_that_it_is_whole() -> None:
    chain = Chain(live=True)
    for item in both_eyes(1):
        assert list(chain.step(item)) == []
    (state,) = chain.step(Tick(6 * MS))
    assert isinstance(state, EyeState)
    assert state.t_ns == 0


def test_a_gaze_does_not_wait_for_the_pupil() -> None:
    items: list[Item] = []
    for k in range(200):  # pupils lost from 100 ms on, gaze goes on
        t_ns = k * 5 * MS
        items += [PupilSample(t_ns, eye, 4.0, 1.0 if k < 20 else 0.0) for eye in Eye]
        items.append(GazeSample(t_ns, None, k / 10, 0.0, 1.0))
    for k, state in enumerate(states_of(items)):
        assert state.gaze is not None
        assert (state.gaze.t_ns, state.gaze.azimuth_deg) == (k * 5 * MS, k / 10)


def test_what_comes_late_twice_or_backwards_is_left_out_and_counted() -> None:
    chain = Chain(live=True)
    good = both_eyes(40, from_ms=1000)
    late = [PupilSample(100 * MS, Eye.LEFT, 8.0, 1.0), GazeSample(1000 * MS, None, 77.0, 0.0, 1.0)]
    states = states_of([*good, *good[-6:], *late, Tick(1200 * MS)], chain)
    assert chain.late_count == 8
    assert [state.t_ns for state in states] == [(1000 + k * 5) * MS for k in range(40)]
    assert states[-1].left.pupil_diameter_mm == pytest.approx(4.0)


def test_a_sample_from_the_future_does_not_make_all_others_late() -> None:
    chain = Chain(live=True)
    states = states_of(
        [Tick(0), *both_eyes(2), PupilSample(9_000_000 * MS, Eye.LEFT, 4.0, 1.0), *both_eyes(2, from_ms=10)], chain
    )
    assert chain.late_count == 1
    assert [state.t_ns // MS for state in states] == [0, 5, 10, 15]


def test_a_steady_stream_without_ticks_goes_on_for_ever() -> None:
    chain = Chain(live=True)
    states = states_of([Tick(0), *both_eyes(1000)], chain)
    assert chain.late_count == 0
    assert len(states) == 1000


def test_two_eyes_out_of_step_never_turn_time_back() -> None:
    items: list[Item] = []
    for k in range(50):  # the left eye's images come 3 ms after younger ones of the right eye
        items += [PupilSample((k * 5 + 3) * MS, Eye.RIGHT, 4.0, 1.0), PupilSample(k * 5 * MS, Eye.LEFT, 3.0, 1.0)]
    states = states_of(items)
    times = [state.t_ns for state in states]
    assert times == sorted(times)
    assert len(states) == 100
    assert (states[-1].right.t_ns, states[-1].left.t_ns) == (248 * MS, 245 * MS)


def test_silence_makes_a_pupil_lost_once_and_its_return_makes_it_back() -> None:
    chain = Chain(live=True)
    ticks = [Tick((1000 + k * 100) * MS) for k in range(1, 30)]
    again = both_eyes(60, from_ms=4000)
    records = list(records_of([*both_eyes(40, from_ms=800), *ticks, *again, Tick(4300 * MS)], chain))
    lost = [record for record in records if isinstance(record, PupilLost)]
    back = [record for record in records if isinstance(record, PupilBack)]
    assert sorted(event.eye for event in lost) == sorted(event.eye for event in back) == [Eye.RIGHT, Eye.LEFT]
    states = [record for record in records if isinstance(record, EyeState)]
    phases = [state.left.phase for state in states]
    assert phases[0] is phases[-1] is Phase.TRACKING
    assert Phase.DROPOUT in phases
    assert Phase.LOST in phases
    times = [state.t_ns for state in states]
    assert times == sorted(times)


def test_what_silence_makes_of_an_eye_is_of_a_time_that_no_sample_can_still_reach() -> None:
    """Samples may come a quarter of a second late."""
    before, ticks = both_eyes(20), [Tick(k * 7 * MS) for k in range(14, 200)]
    found = states_of([*before, *ticks], Chain(live=True))[20:]
    assert found[-1].left.phase is found[-1].right.phase is Phase.LOST
    assert {state.t_ns + 250 * MS for state in found} <= {tick.t_ns for tick in ticks}


def test_an_eye_that_falls_silent_in_a_recording_is_lost_too() -> None:
    items = [item for item in both_eyes(400) if not (isinstance(item, PupilSample) and item.eye and item.t_ns > 10**9)]
    last = states_of(items)[-1]
    assert last.right.phase is Phase.TRACKING
    assert last.left.phase is Phase.LOST


def test_a_lost_eye_borrows_the_other_with_their_difference_and_says_so() -> None:
    items: list[Item] = []
    for k in range(600):
        t_ns = k * 5 * MS
        items.append(PupilSample(t_ns, Eye.RIGHT, 4.0, 1.0))
        items.append(PupilSample(t_ns, Eye.LEFT, 3.5, 1.0 if k < 200 else 0.0))
    states = states_of(items)
    assert not any(state.left.borrowed for state in states if state.left.phase is not Phase.LOST)
    last = states[-1].left
    assert (last.phase, last.borrowed) == (Phase.LOST, True)
    assert last.pupil_diameter_mm == pytest.approx(3.5)
    assert not states[-1].right.borrowed


def test_a_lost_eye_never_jumps_when_it_borrows_nor_when_it_comes_back() -> None:
    items: list[Item] = []
    for k in range(1000):  # the right pupil opens and blinks meanwhile; the left one is gone from 0.5 to 4.5 s
        t_ns, right_mm = k * 5 * MS, min(3.0 + max(k - 100, 0) * 0.005, 6.0)
        blinks = 400 <= k < 430
        items.append(PupilSample(t_ns, Eye.RIGHT, None if blinks else right_mm, 0.0 if blinks else 1.0))
        gone = 100 <= k < 900
        items.append(PupilSample(t_ns, Eye.LEFT, None if gone else right_mm - 0.5, 0.0 if gone else 1.0))
    lefts = [state.left for state in states_of(items)]
    shown_mm = [left.pupil_diameter_mm or 0.0 for left in lefts]
    assert max(abs(after - before) for before, after in itertools.pairwise(shown_mm)) <= SLEW_MM_S * 0.005 + 1e-9
    assert {left.borrowed for left in lefts[210:900]} == {True}  # its fellow's blink does not end it
    assert shown_mm[890] == pytest.approx(5.5)
    assert (lefts[-1].phase, lefts[-1].borrowed, shown_mm[-1]) == (Phase.TRACKING, False, 5.5)


def test_two_lost_eyes_borrow_nothing() -> None:
    items: list[Item] = [PupilSample(k * 5 * MS, eye, 4.0, 1.0 if k < 100 else 0.0) for k in range(400) for eye in Eye]
    last = states_of(items)[-1]
    assert not last.left.borrowed
    assert not last.right.borrowed
    assert last.left.pupil_diameter_mm == pytest.approx(4.0)


def test_the_clock_s_uncertainty_stands_in_every_state() -> None:
    assert {state.clock_uncertainty_ns for state in states_of(both_eyes(3))} == {0}
    estimate, jump = ClockEstimated(20 * MS, 5, 0.0, 40_000), ClockJumped(60 * MS, 10**9)
    records = list(
        records_of(
            [*both_eyes(2), estimate, *both_eyes(2, 20), jump, *both_eyes(2, 60), SourceSilent(80 * MS, "gone")],
            Chain(live=True),
        )
    )
    assert [r.clock_uncertainty_ns if isinstance(r, EyeState) else type(r).__name__ for r in records] == [
        *(None, None, "ClockEstimated", 40_000, 40_000, "ClockJumped", None, None, "SourceSilent"),
    ]


_items = st.one_of(
    st.builds(
        PupilSample,
        t_ns=st.integers(0, 4_000_000_000),
        eye=st.sampled_from(Eye),
        pupil_diameter_mm=st.none() | st.floats(allow_nan=False, allow_infinity=False) | st.floats(1, 9),
        confidence=st.floats(0, 1),
        model_confidence=st.none() | st.floats(0, 1),
        openness=st.none() | st.floats(0, 1),
    ),
    st.builds(
        GazeSample,
        t_ns=st.integers(0, 4_000_000_000),
        eye=st.none() | st.sampled_from(Eye),
        azimuth_deg=st.floats(-180, 180),
        elevation_deg=st.floats(-90, 90),
        confidence=st.floats(0, 1),
    ),
    st.builds(Tick, t_ns=st.integers(0, 4_000_000_000)),
)


@given(st.lists(_items, max_size=60), st.booleans(), st.booleans())
def test_any_items_in_any_order_give_valid_states_in_order(items: list[Item], in_order: bool, live: bool) -> None:
    if in_order:
        items = sorted(items, key=lambda item: item.t_ns)
    times, sequences = [], []
    for record in records_of(items, Chain(live=live)):
        if isinstance(record, EyeState):
            assert wire.decode_state(wire.encode_state(record)) == record
            times.append(record.t_ns)
            sequences.append(record.sequence)
    assert times == sorted(times)
    assert sequences == list(range(len(sequences)))
