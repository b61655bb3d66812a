"""The filter of untrusted diameters, on constructed blinks whose truth is known."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge.dropout import SILENT_AFTER_NS, DropoutFilter, Shown
from entoptic.tracker_bridge.dropout_interval import LOST_AFTER_NS, MIN_COVER_NS
from entoptic.tracker_bridge.events import BlinkOffset, BlinkOnset, Event, PupilBack, PupilLost
from entoptic.tracker_bridge.samples import Eye, Phase, PupilSample

STEP_NS = 5_000_000


def pupil(t_ns: int, pupil_diameter_mm: float | None, confidence: float = 1.0) -> PupilSample:
    return PupilSample(t_ns, Eye.LEFT, pupil_diameter_mm, confidence)


def run(samples: list[PupilSample]) -> list[Shown]:
    dropout = DropoutFilter()
    return [dropout.step(sample) for sample in samples]


def blink(truth_mm: float, closed_ns: int) -> list[PupilSample]:
    """0.5 s open, 75 ms closing over a shrinking pupil at full confidence, closed, 100 ms opening, 1 s open."""
    samples, t_ns = [], 0
    for part_ns, diameter, confidence in (
        (500_000_000, lambda _: truth_mm, 1.0),
        (75_000_000, lambda share: truth_mm * (1 - 0.7 * share), 0.95),
        (closed_ns, lambda _: -0.07, 0.0),
        (100_000_000, lambda share: truth_mm * (0.3 + 0.7 * share), 0.95),
        (1_000_000_000, lambda _: truth_mm, 1.0),
    ):
        for k in range(part_ns // STEP_NS):
            samples.append(pupil(t_ns, diameter(k * STEP_NS / part_ns), confidence))
            t_ns += STEP_NS
    return samples


def test_a_blink_neither_shrinks_nor_loses_the_pupil() -> None:
    shown = run(blink(4.0, 150_000_000))
    diameters = [state.pupil_diameter_mm for state in shown]
    assert None not in diameters
    # The speed gate needs a few samples to see the lid: 25 ms × 37 mm/s at most leaks before it closes.
    assert min(d for d in diameters if d is not None) > 4.0 - 0.35
    error = np.array([d - 4.0 for d in diameters if d is not None])
    assert math.sqrt(np.mean(error**2)) < 0.06
    assert diameters[-1] == 4.0


def test_a_blink_is_one_onset_and_one_offset() -> None:
    events = [event for state in run(blink(4.0, 150_000_000)) for event in state.events]
    assert [type(event) for event in events] == [BlinkOnset, BlinkOffset]
    onset, offset = events
    assert abs(onset.t_ns - 500_000_000) <= 30_000_000
    # Offset is when the pupil is trusted again: the lid's 100 ms and 50 ms of settling after it.
    assert abs(offset.t_ns - 875_000_000) <= 30_000_000
    assert offset.duration_ns == offset.t_ns - onset.t_ns


def test_a_held_closed_eye_is_lost_and_then_back() -> None:
    shown = run(blink(4.0, 2_000_000_000))
    kinds = [type(event) for state in shown for event in state.events]
    assert kinds == [BlinkOnset, PupilLost, BlinkOffset, PupilBack]
    assert Phase.LOST in {state.phase for state in shown}
    assert all(state.pupil_diameter_mm is not None and state.pupil_diameter_mm > 3.6 for state in shown)


def test_a_dropout_without_a_lid_is_no_blink() -> None:
    samples = [
        pupil(k * STEP_NS, 4.0 if not 100 <= k < 130 else None, 1.0 if not 100 <= k < 130 else 0.0) for k in range(300)
    ]
    shown = run(samples)
    assert {state.phase for state in shown[100:130]} == {Phase.DROPOUT}
    assert not [event for state in shown for event in state.events if isinstance(event, BlinkOnset)]
    assert {state.pupil_diameter_mm for state in shown} == {4.0}


def test_a_light_reflex_passes_untouched() -> None:
    t_s = np.arange(0, 3, 0.005)
    trace = 3.0 + 3.0 * np.exp(-np.maximum(t_s - 1.0, 0) / 0.5)  # 6 mm/s at its fastest
    shown = run([pupil(round(t * 1e9), float(d)) for t, d in zip(t_s, trace, strict=True)])
    assert [state.pupil_diameter_mm for state in shown] == trace.tolist()


def test_nothing_trusted_yet_is_lost_without_a_diameter() -> None:
    shown = run([pupil(k * STEP_NS, 0.0, 0.0) for k in range(50)])
    assert {(state.phase, state.pupil_diameter_mm) for state in shown} == {(Phase.LOST, None)}


def test_nonsense_at_full_confidence_is_never_shown() -> None:
    samples = [pupil(k * STEP_NS, 4.0) for k in range(100)]
    samples += [pupil((100 + k) * STEP_NS, d) for k, d in enumerate((-7580.0, 13424.0, 0.0, -0.07, 0.27, 14.0))]
    assert {state.pupil_diameter_mm for state in run(samples)} == {4.0}


def phases(shown: list[Shown]) -> list[Phase]:
    """Each phase once, in order."""
    return [
        state.phase
        for state, before in zip(shown, [None, *shown], strict=False)
        if before is None or before.phase is not state.phase
    ]


def events_of(shown: list[Shown]) -> list[Event]:
    return [event for state in shown for event in state.events]


def test_a_blink_goes_through_its_phases() -> None:
    shown = run(blink(4.0, 150_000_000))
    assert phases(shown) == [Phase.TRACKING, Phase.CLOSING, Phase.BLINK, Phase.OPENING, Phase.TRACKING]


def test_an_eye_held_closed_goes_through_lost_and_comes_back_opening() -> None:
    shown = run(blink(4.0, 8_000_000_000))
    closing = [Phase.TRACKING, Phase.CLOSING, Phase.BLINK]
    assert phases(shown) == [*closing, Phase.LOST, Phase.OPENING, Phase.TRACKING]
    onset, lost, offset, back = events_of(shown)
    assert isinstance(onset, BlinkOnset)
    assert isinstance(lost, PupilLost)
    assert isinstance(offset, BlinkOffset)
    assert isinstance(back, PupilBack)
    assert abs(lost.t_ns - onset.t_ns - LOST_AFTER_NS) <= 30_000_000
    assert abs(offset.duration_ns - 8_225_000_000) <= 60_000_000


def test_shown_is_of_the_sample_s_own_time() -> None:
    """The live mode's latency is zero: what is measured and trusted is shown at once."""
    samples = [pupil(k * STEP_NS, 4.0 + 0.001 * k) for k in range(200)]
    assert [(state.t_ns, state.pupil_diameter_mm) for state in run(samples)] == [
        (s.t_ns, s.pupil_diameter_mm) for s in samples
    ]


def test_a_blink_is_told_as_soon_as_it_has_lasted() -> None:
    late = [
        sample.t_ns - event.t_ns
        for sample, state in zip(blink(4.0, 150_000_000), run(blink(4.0, 150_000_000)), strict=True)
        for event in state.events
        if isinstance(event, BlinkOnset)
    ]
    # The lid of `blink` needs 75 ms to cover the pupil.
    assert len(late) == 1
    assert 0 <= late[0] <= 75_000_000 + MIN_COVER_NS + STEP_NS


def test_one_sample_without_a_pupil_is_no_blink() -> None:
    samples = [pupil(k * STEP_NS, 2.0 if k == 100 else 4.0, 0.0 if k == 101 else 1.0) for k in range(300)]
    shown = run(samples)
    assert not events_of(shown)
    assert {state.pupil_diameter_mm for state in shown} == {4.0}


def test_a_flickering_outline_is_a_dropout() -> None:
    samples = [pupil(k * STEP_NS, 4.0, 0.0 if 100 <= k < 160 and k % 4 else 1.0) for k in range(300)]
    shown = run(samples)
    assert not events_of(shown)
    assert Phase.DROPOUT in phases(shown)
    assert {state.pupil_diameter_mm for state in shown} == {4.0}


@pytest.mark.parametrize("seconds", [0.3, 1.0, 2.5])
def test_a_lid_held_half_closed_never_shrinks_the_pupil(seconds: float) -> None:
    count = round(seconds / 0.005)
    sizes = [*[4.0] * 100, *[4.0 - 0.15 * k for k in range(10)], *[2.5] * count, *[4.0] * 50]
    shown = run([pupil(k * STEP_NS, size) for k, size in enumerate(sizes)])
    half = shown[105 : 110 + count]
    assert {state.phase for state in half} <= {Phase.CLOSING, Phase.LOST}
    assert min(state.pupil_diameter_mm or 0.0 for state in shown) > 3.6  # one speed window's leak
    assert {state.pupil_diameter_mm for state in half[10:]} == {4.0}
    assert not [event for event in events_of(shown) if isinstance(event, BlinkOnset)]
    assert shown[-1].phase is Phase.TRACKING


def test_a_pupil_that_stays_small_is_believed_in_the_end() -> None:
    shown = run([pupil(k * STEP_NS, 4.0 if k < 100 else 2.5) for k in range(800)])
    assert shown[-1].phase is Phase.TRACKING
    assert shown[-1].pupil_diameter_mm == 2.5


def test_a_reflex_goes_on_behind_a_lid() -> None:
    """A pupil that constricts at 1 mm/s is not shown where it was when the lid came."""
    samples = []
    for sample in blink(1.0, 150_000_000):
        whole_mm = 6.0 - sample.t_ns * 1e-9
        share = (
            sample.pupil_diameter_mm if sample.pupil_diameter_mm is not None and sample.pupil_diameter_mm > 0.0 else 0.0
        )
        samples.append(pupil(sample.t_ns, whole_mm * share, sample.confidence))
    shown = next(state for state in run(samples) if state.t_ns == 800_000_000)
    assert shown.pupil_diameter_mm is not None
    assert 5.2 < shown.pupil_diameter_mm < 5.4  # held still it would be 5.5


def test_pixels_alone_find_blinks_but_show_no_millimetres() -> None:
    samples = [
        PupilSample(
            s.t_ns,
            s.eye,
            None,
            s.confidence,
            diameter_px=None if s.pupil_diameter_mm is None else 5.0 * s.pupil_diameter_mm,
        )
        for s in blink(4.0, 150_000_000)
    ]
    shown = run(samples)
    assert [type(event) for event in events_of(shown)] == [BlinkOnset, BlinkOffset]
    assert phases(shown) == [Phase.TRACKING, Phase.CLOSING, Phase.BLINK, Phase.OPENING, Phase.TRACKING]
    assert {state.pupil_diameter_mm for state in shown} == {None}


def test_confidence_alone_finds_blinks() -> None:
    shown = run([PupilSample(s.t_ns, s.eye, None, float(s.confidence > 0.5)) for s in blink(4.0, 150_000_000)])
    assert phases(shown) == [Phase.TRACKING, Phase.BLINK, Phase.OPENING, Phase.TRACKING]
    onset, offset = events_of(shown)
    assert onset.t_ns == 575_000_000
    assert offset.t_ns == 775_000_000


def test_a_source_too_slow_to_see_a_lid_pass_counts_what_it_hides() -> None:
    samples = [pupil(k * 16_666_667, 4.0, 0.0 if 60 <= k < 70 else 1.0) for k in range(120)]
    shown = run(samples)
    assert phases(shown) == [Phase.TRACKING, Phase.BLINK, Phase.OPENING, Phase.TRACKING]
    assert [type(event) for event in events_of(shown)] == [BlinkOnset, BlinkOffset]


@pytest.mark.parametrize(("openness", "kinds"), [(0.0, [BlinkOnset, BlinkOffset]), (1.0, []), (None, [])])
def test_openness_decides_where_the_source_gives_it(openness: float | None, kinds: list[type[Event]]) -> None:
    samples = [
        PupilSample(
            k * STEP_NS, Eye.LEFT, 4.0, 0.0 if gone else 1.0, openness=openness if gone or openness is None else 1.0
        )
        for k, gone in enumerate([*[False] * 100, *[True] * 40, *[False] * 100])
    ]
    shown = run(samples)
    assert [type(event) for event in events_of(shown)] == kinds
    assert {state.phase for state in shown[102:140]} == {Phase.BLINK if kinds else Phase.DROPOUT}


def test_openness_is_passed_on_or_else_told_from_the_pupil() -> None:
    shown = run(blink(4.0, 800_000_000))
    by_phase: dict[Phase, list[float | None]] = {}
    for state in shown:
        by_phase.setdefault(state.phase, []).append(state.openness)
    assert set(by_phase[Phase.TRACKING]) == {1.0}
    assert set(by_phase[Phase.BLINK]) == set(by_phase[Phase.LOST]) == {0.0}
    closing = [value for value in by_phase[Phase.CLOSING] if value is not None]
    assert closing == sorted(closing, reverse=True)
    assert 0.3 < closing[-1] < closing[0] < 0.75
    given = run([PupilSample(k * STEP_NS, Eye.LEFT, 4.0, 1.0, openness=0.8) for k in range(10)])
    assert {state.openness for state in given} == {0.8}


def test_a_dropout_and_a_pupil_never_seen_have_no_openness() -> None:
    gone = run([pupil(k * STEP_NS, 4.0, 0.0 if k >= 100 else 1.0) for k in range(300)])
    assert {state.openness for state in gone if state.phase in (Phase.DROPOUT, Phase.LOST)} == {None}
    assert {state.openness for state in run([pupil(k * STEP_NS, None, 0.0) for k in range(50)])} == {None}


def test_silence_is_a_dropout_then_a_loss_told_once() -> None:
    dropout = DropoutFilter()
    assert dropout.tick(0) is None
    for k in range(100):
        dropout.step(pupil(k * STEP_NS, 4.0))
    last_ns = 99 * STEP_NS
    ticks = {ms: dropout.tick(last_ns + ms * 1_000_000) for ms in range(10, 2000, 10)}
    told = {ms: shown for ms, shown in ticks.items() if shown is not None}
    assert list(told) == [SILENT_AFTER_NS // 1_000_000, LOST_AFTER_NS // 1_000_000]
    assert [shown.phase for shown in told.values()] == [Phase.DROPOUT, Phase.LOST]
    assert [shown.events for shown in told.values()] == [(), (PupilLost(last_ns + LOST_AFTER_NS, Eye.LEFT),)]
    assert {shown.pupil_diameter_mm for shown in told.values()} == {4.0}
    back = [dropout.step(pupil(3_000_000_000 + k * STEP_NS, 5.0)) for k in range(60)]
    assert [type(event) for event in events_of(back)] == [PupilBack]
    assert back[-1].pupil_diameter_mm == 5.0


def test_an_hour_without_samples_is_one_loss_with_or_without_ticks() -> None:
    before = [pupil(k * STEP_NS, 4.0) for k in range(100)]
    after = [pupil(3_600_000_000_000 + k * STEP_NS, 3.0) for k in range(100)]
    silent = run([*before, *after])
    dropout = DropoutFilter()
    ticked = [dropout.step(sample) for sample in before]
    for k in range(100):
        ticked += filter(None, [dropout.tick(99 * STEP_NS + k * 100_000_000)])
    ticked += [dropout.step(sample) for sample in after]
    assert events_of(silent) == events_of(ticked)
    assert [type(event) for event in events_of(silent)] == [PupilLost, PupilBack]
    assert silent[-1].pupil_diameter_mm == 3.0


@pytest.mark.parametrize("rate_hz", [30, 60, 120, 200, 500, 1000])
def test_at_any_rate_a_blink_is_one_blink(rate_hz: int) -> None:
    samples = []
    for k in range(2 * rate_hz):
        t_s = k / rate_hz
        openness = float(np.interp(t_s, [1.0, 1.1, 1.15, 1.35], [1.0, 0.0, 0.0, 1.0]))
        share = np.clip((openness - 0.3) / 0.4, 0.0, 1.0)
        samples.append(pupil(round(t_s * 1e9), 4.0 * share, 0.0 if share < 0.4 else 0.9))
    shown = run(samples)
    assert [type(event) for event in events_of(shown)] == [BlinkOnset, BlinkOffset]
    assert min(state.pupil_diameter_mm or 0.0 for state in shown) > 3.3
    assert shown[-1].pupil_diameter_mm == 4.0


def test_millimetres_may_follow_pixels() -> None:
    px = [PupilSample(k * STEP_NS, Eye.LEFT, None, 1.0, diameter_px=20.0) for k in range(100)]
    mm = [PupilSample((100 + k) * STEP_NS, Eye.LEFT, 4.0, 1.0, diameter_px=20.0) for k in range(100)]
    shown = run([*px, *mm])
    assert {state.phase for state in shown} == {Phase.TRACKING}
    assert [state.pupil_diameter_mm for state in shown] == [None] * 100 + [4.0] * 100


def test_a_changed_eye_model_is_no_lid() -> None:
    """The millimetres jump while the image of the pupil stays: Pupil Capture does so, for seconds."""
    samples = [PupilSample(k * STEP_NS, Eye.LEFT, 4.0 if k < 100 else 3.0, 1.0, diameter_px=20.0) for k in range(200)]
    shown = run(samples)
    assert not events_of(shown)
    assert phases(shown) == [Phase.TRACKING, Phase.DROPOUT, Phase.TRACKING]
    assert shown[-1].pupil_diameter_mm == 3.0
    assert max(abs(np.diff([state.pupil_diameter_mm or 0.0 for state in shown]))) <= 0.05 + 1e-9


NUMBERS = st.none() | st.floats(-10, 20) | st.sampled_from([math.nan, math.inf, -math.inf, 0.0, -7580.0, 13_000.0])


@given(
    st.lists(
        st.tuples(
            st.integers(1, LOST_AFTER_NS) | st.just(3_600_000_000_000),
            NUMBERS,
            NUMBERS,
            st.floats(0, 1) | st.sampled_from([0.0, 1.0]),
            st.none() | st.floats(0, 1),
            st.booleans(),
        ),
        max_size=60,
    )
)
def test_whatever_comes_what_is_shown_makes_sense(
    steps: list[tuple[int, float | None, float | None, float, float | None, bool]],
) -> None:
    dropout, t_ns, blinking, lost, seen_mm = DropoutFilter(), 0, False, False, False
    for step_ns, pupil_diameter_mm, diameter_px, confidence, openness, silent in steps:
        t_ns += step_ns
        if silent:
            shown = dropout.tick(t_ns)
            if shown is None:
                continue
        else:
            shown = dropout.step(
                PupilSample(t_ns, Eye.LEFT, pupil_diameter_mm, confidence, diameter_px=diameter_px, openness=openness)
            )
            seen_mm = seen_mm or pupil_diameter_mm is not None
        assert shown.t_ns == t_ns
        assert shown.pupil_diameter_mm is None or 1.0 <= shown.pupil_diameter_mm <= 9.0
        assert shown.openness is None or 0.0 <= shown.openness <= 1.0
        assert shown.phase is not Phase.TRACKING or (shown.pupil_diameter_mm is not None) is seen_mm
        for event in shown.events:
            assert event.t_ns <= t_ns
            if isinstance(event, BlinkOnset | BlinkOffset):
                assert blinking is isinstance(event, BlinkOffset)
                blinking = not blinking
            else:
                assert lost is isinstance(event, PupilBack)
                lost = not lost
        assert not (shown.phase is Phase.TRACKING and (blinking or lost))
