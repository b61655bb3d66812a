"""The filter of untrusted diameters, on constructed blinks whose truth is known."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tracker_bridge.dropout import LOST_AFTER_NS, DropoutFilter, Shown
from tracker_bridge.samples import BlinkOffset, BlinkOnset, Eye, Phase, PupilBack, PupilLost, PupilSample

STEP_NS = 5_000_000


def pupil(t_ns: int, diameter_mm: float | None, confidence: float = 1.0) -> PupilSample:
    return PupilSample(t_ns, Eye.LEFT, diameter_mm, confidence)


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
    diameters = [state.diameter_mm for state in shown]
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
    assert all(state.diameter_mm is not None and state.diameter_mm > 3.6 for state in shown)


def test_a_dropout_without_a_lid_is_no_blink() -> None:
    samples = [
        pupil(k * STEP_NS, 4.0 if not 100 <= k < 130 else None, 1.0 if not 100 <= k < 130 else 0.0) for k in range(300)
    ]
    shown = run(samples)
    assert {state.phase for state in shown[100:130]} == {Phase.DROPOUT}
    assert not [event for state in shown for event in state.events if isinstance(event, BlinkOnset)]
    assert {state.diameter_mm for state in shown} == {4.0}


def test_a_light_reflex_passes_untouched() -> None:
    t_s = np.arange(0, 3, 0.005)
    trace = 3.0 + 3.0 * np.exp(-np.maximum(t_s - 1.0, 0) / 0.5)  # 6 mm/s at its fastest
    shown = run([pupil(round(t * 1e9), float(d)) for t, d in zip(t_s, trace, strict=True)])
    assert [state.diameter_mm for state in shown] == trace.tolist()


def test_nothing_trusted_yet_is_lost_without_a_diameter() -> None:
    shown = run([pupil(k * STEP_NS, 0.0, 0.0) for k in range(50)])
    assert {(state.phase, state.diameter_mm) for state in shown} == {(Phase.LOST, None)}


def test_nonsense_at_full_confidence_is_never_shown() -> None:
    samples = [pupil(k * STEP_NS, 4.0) for k in range(100)]
    samples += [pupil((100 + k) * STEP_NS, d) for k, d in enumerate((-7580.0, 13424.0, 0.0, -0.07, 0.27, 14.0))]
    assert {state.diameter_mm for state in run(samples)} == {4.0}


@given(
    st.lists(
        st.tuples(
            st.integers(0, LOST_AFTER_NS),
            st.none() | st.floats(-10, 20),
            st.floats(0, 1),
        ),
        max_size=60,
    )
)
def test_whatever_comes_a_shown_diameter_is_a_pupils(steps: list[tuple[int, float | None, float]]) -> None:
    t_ns, samples = 0, []
    for step_ns, diameter_mm, confidence in steps:
        t_ns += step_ns
        samples.append(pupil(t_ns, diameter_mm, confidence))
    for state in run(samples):
        assert state.diameter_mm is None or 1.0 <= state.diameter_mm <= 9.0
        assert state.phase is not Phase.TRACKING or state.diameter_mm is not None
