"""Saccades as they happen: on simulated eyes, whose truth is known, and on constructed movements."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from entoptic.tracker_bridge.dropout import DropoutFilter
from entoptic.tracker_bridge.events import SaccadeKind, SaccadeOffset, SaccadeOnset
from entoptic.tracker_bridge.microsaccades import COVERED, SaccadeDetector, SaccadeEvent, angle_deg
from entoptic.tracker_bridge.saccade_velocity import MIN_NOISE_NS, NoiseMeter, Place, Velocity, VelocityFilter
from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings
from entoptic.tracker_bridge.sources.simulated.truth import TruthEvent

MS = 1_000_000


def run(samples: Iterable[GazeSample | PupilSample]) -> list[SaccadeEvent]:
    """The detector as the bridge uses it."""
    detector = SaccadeDetector()
    filters = {eye: DropoutFilter() for eye in Eye}
    events: list[SaccadeEvent] = []
    for sample in samples:
        if isinstance(sample, GazeSample):
            events += detector.step(sample)
        elif filters[sample.eye].step(sample).phase in COVERED:
            events += detector.blind(sample.t_ns, sample.eye)
    return events


def onsets_of(events: Iterable[SaccadeEvent]) -> list[SaccadeOnset]:
    return [event for event in events if isinstance(event, SaccadeOnset)]


def offsets_of(events: Iterable[SaccadeEvent]) -> list[SaccadeOffset]:
    return [event for event in events if isinstance(event, SaccadeOffset)]


@dataclasses.dataclass
class Outcome:
    truth: list[TruthEvent]
    hits: list[tuple[TruthEvent, SaccadeOnset, SaccadeOffset]]
    false_alarms: int


@functools.cache
def simulated(seed: int) -> Outcome:
    """A minute at 200 Hz with 0.02° of noise and 15 blinks."""
    eyes = SimulatedEyes(SimulatedSettings(seconds=60.0, rate_hz=200.0, noise_deg=0.02, seed=seed))
    events = run(eyes.samples())
    left = list(zip(onsets_of(events), offsets_of(events), strict=True))
    truth = [event for event in eyes.truth.events if event.kind != "blink" and event.onset_ns > MIN_NOISE_NS]
    hits = []
    for event in truth:
        near = [pair for pair in left if abs(pair[0].onset_ns - event.onset_ns) < 40 * MS]
        if near:
            left.remove(near[0])
            hits.append((event, *near[0]))
    return Outcome(truth, hits, len(left))


SEEDS = (1, 2, 3, 4, 5)


def all_hits() -> list[tuple[TruthEvent, SaccadeOnset, SaccadeOffset]]:
    return [hit for seed in SEEDS for hit in simulated(seed).hits]


@pytest.mark.parametrize("kind", ["microsaccade", "saccade"])
def test_movements_of_simulated_eyes_are_found(kind: str) -> None:
    truth = sum(event.kind == kind for seed in SEEDS for event in simulated(seed).truth)
    hits = sum(event.kind == kind for event, *_ in all_hits())
    assert truth > 50
    assert hits / truth >= 0.95


def test_there_is_less_than_a_false_alarm_a_minute_with_15_blinks_a_minute() -> None:
    assert sum(simulated(seed).false_alarms for seed in SEEDS) / len(SEEDS) <= 1.0


def test_the_latency_at_200_hz_is_20_ms_or_less() -> None:
    latencies = [(onset.t_ns - event.onset_ns) / MS for event, onset, _ in all_hits()]
    assert np.median(latencies) <= 20.0
    assert np.percentile(latencies, 90) <= 30.0


def test_onsets_and_offsets_are_a_few_ms_off() -> None:
    onsets = [(onset.onset_ns - event.onset_ns) / MS for event, onset, _ in all_hits()]
    offsets = [(offset.offset_ns - event.offset_ns) / MS for event, _, offset in all_hits()]
    assert np.median(np.abs(onsets)) <= 3.0
    assert abs(np.median(onsets)) <= 2.0
    assert np.median(np.abs(offsets)) <= 3.0


def test_amplitude_kind_and_peak_velocity_are_those_of_the_movement() -> None:
    hits = all_hits()
    amplitudes = np.array([event.amplitude_deg or 0.0 for event, *_ in hits])
    found = np.array([offset.amplitude_deg for *_, offset in hits])
    assert np.median(np.abs(found - amplitudes)) <= 0.02
    clear = np.abs(amplitudes - 1.0) > 0.1
    kinds = np.array([offset.kind == event.kind for event, _, offset in hits])
    assert np.mean(kinds[clear]) >= 0.99
    peaks = np.array([offset.peak_velocity_deg_s / (event.peak_velocity_deg_s or 1.0) for event, _, offset in hits])
    assert np.median(peaks[amplitudes > 1.0]) == pytest.approx(1.0, abs=0.05)
    # At 200 Hz the fastest 5 ms of a movement of 7–18 ms are slower than its fastest moment.
    assert 0.65 <= np.median(peaks[amplitudes < 1.0]) <= 1.0


def test_a_replay_gives_the_same_events() -> None:
    eyes = SimulatedEyes(SimulatedSettings(seconds=10.0, seed=7))
    assert run(eyes.samples()) == run(eyes.samples())


def steps(
    *,
    rate_hz: float = 200.0,
    seconds: float = 3.0,
    at_s: float = 2.0,
    way_deg: tuple[float, float] = (0.5, 0.0),
    lasts_s: float = 0.015,
    noise_deg: float = 0.01,
    eyes: tuple[Eye | None, ...] = (Eye.RIGHT, Eye.LEFT),
    phase: float = 0.0,
    seed: int = 1,
) -> list[GazeSample]:
    """Eyes that are still but for one movement at an even speed; the second eye is sampled `phase` intervals later."""
    rng = np.random.default_rng(seed)
    samples = []
    for n in range(int(seconds * rate_hz)):
        for which, eye in enumerate(eyes):
            t_s = (n + which * phase) / rate_hz
            done = min(max((t_s - at_s) / lasts_s, 0.0), 1.0)
            azimuth, elevation = (done * way + rng.normal(0.0, noise_deg) for way in way_deg)
            samples.append(GazeSample(round(t_s * 1e9), eye, azimuth, elevation, 1.0))
    return samples


def latency_ms(events: list[SaccadeEvent], at_s: float = 2.0) -> float:
    (onset,) = onsets_of(events)
    return onset.t_ns / MS - at_s * 1e3


@pytest.mark.parametrize("eyes", [(Eye.RIGHT, Eye.LEFT), (Eye.RIGHT,), (Eye.LEFT,), (None,)])
@pytest.mark.parametrize("rate_hz", [60.0, 120.0, 200.0, 500.0, 1000.0])
def test_one_movement_is_one_onset_and_one_offset(eyes: tuple[Eye | None, ...], rate_hz: float) -> None:
    events = run(steps(eyes=eyes, rate_hz=rate_hz))
    assert [type(event) for event in events] == [SaccadeOnset, SaccadeOffset]
    onset, offset = onsets_of(events)[0], offsets_of(events)[0]
    assert offset.onset_ns == onset.onset_ns
    assert offset.kind is SaccadeKind.MICROSACCADE
    assert offset.amplitude_deg == pytest.approx(0.5, abs=0.03)
    assert offset.azimuth_deg == pytest.approx(0.5, abs=0.03)
    assert offset.elevation_deg == pytest.approx(0.0, abs=0.03)
    assert onset.azimuth_velocity_deg_s > 0.0
    assert onset.onset_ns / MS == pytest.approx(2000.0, abs=max(1500.0 / rate_hz, 3.0))
    assert offset.offset_ns / MS == pytest.approx(2015.0, abs=max(1500.0 / rate_hz, 4.0))


@pytest.mark.parametrize(
    ("rate_hz", "most_ms"), [(60.0, 50.0), (120.0, 25.0), (200.0, 15.0), (500.0, 15.0), (1000.0, 15.0)]
)
def test_the_latency_is_the_look_ahead_and_the_run(rate_hz: float, most_ms: float) -> None:
    assert 0.0 < latency_ms(run(steps(rate_hz=rate_hz))) <= most_ms


def test_a_movement_downwards_waits_10_ms_for_a_lid() -> None:
    wait_ms = latency_ms(run(steps(way_deg=(0.0, -0.5)))) - latency_ms(run(steps(way_deg=(0.0, 0.5))))
    assert 10.0 <= wait_ms <= 15.0


@pytest.mark.parametrize("phase", [0.25, 0.5, 0.75])
def test_the_eyes_may_be_sampled_in_turns(phase: float) -> None:
    events = run(steps(phase=phase))
    assert [type(event) for event in events] == [SaccadeOnset, SaccadeOffset]
    assert offsets_of(events)[0].amplitude_deg == pytest.approx(0.5, abs=0.03)


@settings(max_examples=15)
@given(angle=st.floats(0.0, 6.28), azimuth=st.floats(-40, 40), elevation=st.floats(-1, 1))
def test_direction_comes_out_as_it_went_in_wherever_the_eyes_look(
    angle: float, azimuth: float, elevation: float
) -> None:
    way = 3.0 * math.cos(angle), 3.0 * math.sin(angle)
    moved = [
        GazeSample(s.t_ns, s.eye, s.azimuth_deg + azimuth, s.elevation_deg + elevation, 1.0)
        for s in steps(way_deg=way, lasts_s=0.03)
    ]
    (offset,) = offsets_of(run(moved))
    assert offset.kind is SaccadeKind.SACCADE
    assert (offset.azimuth_deg, offset.elevation_deg) == pytest.approx(way, abs=0.1)
    assert offset.amplitude_deg == pytest.approx(3.0, abs=0.1)


def with_eye(samples: list[GazeSample], eye: Eye, still: list[GazeSample]) -> list[GazeSample]:
    """The samples with those of one eye taken from elsewhere."""
    return [other if sample.eye is eye else sample for sample, other in zip(samples, still, strict=True)]


def test_what_one_of_two_eyes_does_alone_is_no_saccade() -> None:
    assert run(with_eye(steps(), Eye.LEFT, steps(way_deg=(0.0, 0.0)))) == []


def test_eyes_that_go_against_one_another_make_no_saccade() -> None:
    assert run(with_eye(steps(), Eye.LEFT, steps(way_deg=(-0.5, 0.0)))) == []


def test_one_eye_is_enough_while_the_other_is_covered() -> None:
    samples = [
        GazeSample(s.t_ns, s.eye, s.azimuth_deg, s.elevation_deg, 0.0 if s.eye is Eye.LEFT and s.t_ns > 1e9 else 1.0)
        for s in steps()
    ]
    assert [type(event) for event in run(samples)] == [SaccadeOnset, SaccadeOffset]


@pytest.mark.parametrize("eyes", [(Eye.RIGHT, Eye.LEFT), (None,)])
def test_one_wild_sample_is_no_movement(eyes: tuple[Eye | None, ...]) -> None:
    samples = [
        GazeSample(s.t_ns, s.eye, s.azimuth_deg + (2.0 if s.t_ns == 2_000 * MS else 0.0), s.elevation_deg, 1.0)
        for s in steps(way_deg=(0.0, 0.0), eyes=eyes)
    ]
    assert run(samples) == []


def test_steady_pursuit_is_no_movement_once_it_is_usual() -> None:
    pursuit = [
        GazeSample(s.t_ns, s.eye, s.azimuth_deg + 8.0 * s.t_ns * 1e-9, s.elevation_deg, 1.0)
        for s in steps(way_deg=(3.0, 0.0), lasts_s=0.03)
    ]
    assert [type(event) for event in run(pursuit)] == [SaccadeOnset, SaccadeOffset]


def test_an_overshoot_is_no_movement_of_its_own() -> None:
    samples = []
    for s in steps(way_deg=(5.0, 0.0), lasts_s=0.04):
        after_s = s.t_ns * 1e-9 - 2.04
        ring = 0.5 * math.exp(-after_s / 0.02) * math.sin(2 * math.pi * after_s / 0.04) if after_s > 0 else 0.0
        samples.append(GazeSample(s.t_ns, s.eye, s.azimuth_deg + ring, s.elevation_deg, 1.0))
    events = run(samples)
    assert [type(event) for event in events] == [SaccadeOnset, SaccadeOffset]
    assert offsets_of(events)[0].amplitude_deg == pytest.approx(5.0, abs=0.5)


@pytest.mark.parametrize("told_by", ["confidence", "pupil"])
def test_nothing_is_found_until_100_ms_after_the_eyes_are_back(told_by: str) -> None:
    def events(back_s: float) -> list[SaccadeEvent]:
        detector = SaccadeDetector()
        found: list[SaccadeEvent] = []
        for s in steps():
            covered = 1.5 <= s.t_ns * 1e-9 < back_s
            if covered and told_by == "pupil" and s.eye is not None:
                found += detector.blind(s.t_ns, s.eye)
            confidence = 0.3 if covered and told_by == "confidence" else 1.0
            found += detector.step(GazeSample(s.t_ns, s.eye, s.azimuth_deg, s.elevation_deg, confidence))
        return found

    assert events(back_s=1.93) == []
    assert len(events(back_s=1.8)) == 2


def test_a_gap_is_like_a_blink() -> None:
    def events(back_s: float) -> list[SaccadeEvent]:
        return run(s for s in steps() if not 1.5 <= s.t_ns * 1e-9 < back_s)

    assert events(back_s=1.93) == []
    assert len(events(back_s=1.8)) == 2


def test_a_lid_that_pulls_the_pupil_down_before_it_covers_it_is_no_saccade() -> None:
    detector = SaccadeDetector()
    found: list[SaccadeEvent] = []
    for s in steps(way_deg=(0.0, -8.0), lasts_s=0.03):
        if s.t_ns >= 2_010 * MS and s.eye is not None:
            found += detector.blind(s.t_ns, s.eye)
        found += detector.step(s)
    assert found == []


def test_a_movement_that_a_blink_cuts_short_still_ends() -> None:
    samples = [s for s in steps(way_deg=(20.0, 0.0), lasts_s=0.08) if s.t_ns < 2_040 * MS]
    events = run([*samples, *(with_confidence(s, 0.0) for s in steps()[800:] if s.t_ns >= 2_040 * MS)])
    assert [type(event) for event in events] == [SaccadeOnset, SaccadeOffset]
    assert offsets_of(events)[0].offset_ns <= 2_040 * MS


def with_confidence(sample: GazeSample, confidence: float) -> GazeSample:
    return GazeSample(sample.t_ns, sample.eye, sample.azimuth_deg, sample.elevation_deg, confidence)


def test_a_movement_in_a_stream_that_falls_silent_ends_with_time() -> None:
    detector = SaccadeDetector()
    events: list[SaccadeEvent] = []
    for s in steps(way_deg=(20.0, 0.0), lasts_s=0.08):
        if s.t_ns < 2_040 * MS:
            events += detector.step(s)
    assert [type(event) for event in events] == [SaccadeOnset]
    assert [type(event) for event in detector.tick(2_200 * MS)] == [SaccadeOffset]
    assert detector.tick(2_300 * MS) == ()


def test_the_direction_of_both_is_left_aside_where_each_eye_has_its_own() -> None:
    own = steps()
    both = [GazeSample(s.t_ns, None, 0.0, 0.0, 1.0) for s in own if s.eye is Eye.LEFT]
    merged = sorted([*own, *both], key=lambda s: (s.t_ns, s.eye is None))
    assert run(merged) == run(own)


@given(
    intervals_ms=st.lists(st.floats(1.0, 30.0), min_size=60, max_size=90),
    slope=st.tuples(st.floats(-30, 30), st.floats(-10, 10)),
)
def test_the_velocity_of_steady_motion_is_exact_at_any_sampling(
    intervals_ms: list[float], slope: tuple[float, float]
) -> None:
    velocity_filter = VelocityFilter(8 * MS, 100 * MS)
    for t_ns in np.cumsum(np.round(np.array(intervals_ms) * MS).astype(np.int64)).tolist():
        t_s = t_ns * 1e-9
        velocity = velocity_filter.step(Place(t_ns, slope[0] * t_s, slope[1] * t_s))
        if velocity is not None:
            seconds = velocity.t_ns * 1e-9
            across = math.cos(math.radians(slope[1] * seconds))
            assert velocity.azimuth_deg_s == pytest.approx(slope[0] * across, abs=1e-6)
            assert velocity.elevation_deg_s == pytest.approx(slope[1], abs=1e-6)


def test_the_velocitys_latency_is_half_its_window() -> None:
    for rate_hz, half_window in ((60, 2), (200, 2), (250, 2), (500, 4), (1000, 8)):
        velocity_filter = VelocityFilter(8 * MS, 100 * MS)
        late_ns = 0
        for n in range(200):
            t_ns = round(n * 1e9 / rate_hz)
            if n == 100:
                velocity_filter.restart()
            velocity = velocity_filter.step(Place(t_ns, 0.0, 0.0))
            late_ns = t_ns - velocity.t_ns if velocity else 0
        assert velocity_filter.half_window == half_window
        assert late_ns == pytest.approx(half_window * 1e9 / rate_hz, abs=2)


def test_noise_is_measured_after_half_a_second_and_movements_hardly_count() -> None:
    rng = np.random.default_rng(3)
    meter = NoiseMeter()
    sigma = None
    for n in range(800):
        fast = 300.0 if n % 100 < 8 else 0.0
        azimuth, elevation = rng.normal(0.0, (1.0, 2.0))
        sigma = meter.step(Velocity(n * 5 * MS, azimuth + fast, elevation))
        assert (sigma is None) == (n < 100)
    assert sigma is not None
    assert sigma == pytest.approx((0.6745, 2 * 0.6745), rel=0.2)


@given(azimuth=st.floats(-60, 60), elevation=st.floats(-60, 60), size=st.floats(1e-6, 1.0))
def test_the_angle_between_directions_is_that_on_the_sphere(azimuth: float, elevation: float, size: float) -> None:
    here = Place(0, azimuth, elevation)
    assert angle_deg(here, here) == 0.0
    assert angle_deg(here, Place(0, azimuth, elevation + size)) == pytest.approx(size, rel=1e-6)
    across = size * math.cos(math.radians(elevation))
    assert angle_deg(here, Place(0, azimuth + size, elevation)) == pytest.approx(across, rel=1e-3)


def test_noise_does_not_mind_where_a_clock_begins() -> None:
    def measured(from_ns: int) -> list[tuple[float, float] | None]:
        meter = NoiseMeter()
        return [meter.step(Velocity(from_ns + n * 5 * MS, float(n % 7), float(n % 5))) for n in range(200)]

    assert measured(-(10**15)) == measured(0) == measured(10**15)
    assert measured(0)[-1] is not None
