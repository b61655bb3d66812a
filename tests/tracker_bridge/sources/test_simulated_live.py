"""Simulated eyes before a light that is set while they live: else the same as the recorded ones."""

import itertools
import time

import numpy as np
import pytest

from entoptic.tracker_bridge.samples import NS_PER_S, Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Item, SourceError, Tick
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings
from entoptic.tracker_bridge.sources.simulated.live import BLOCK_S, LiveEyes
from entoptic.tracker_bridge.sources.simulated.live_pupil import Hippus, LightReflex
from entoptic.tracker_bridge.sources.simulated.pupil import LATENCY_S, STEP_S, light_reflex_mm, with_hippus_mm

LIGHT = ((0.0, 10.0), (1.0, 500.0), (2.5, 0.1), (2.7, 3.0))
STILL = SimulatedSettings(
    seconds=4.0, luminance=((0.0, 10.0),), hippus=0.0, diameter_noise_mm=0.0, blinks_per_minute=0.0
)


def lived(settings: SimulatedSettings, light: tuple[tuple[float, float], ...] = ()) -> list[Item]:
    eyes, coming, items = LiveEyes(settings), list(light), []
    for item in eyes.samples():
        items.append(item)
        while coming and item.t_ns >= coming[0][0] * NS_PER_S:
            t_s, luminance = coming.pop(0)
            eyes.set_luminance(luminance, round(t_s * NS_PER_S))
    return items


def test_the_reflex_is_that_of_the_recorded_eyes() -> None:
    reflex = LightReflex(LIGHT[0][1], 900.0, 30.0)
    stepped = []
    for step in range(401):
        for t_s, luminance in LIGHT[1:]:
            if step == round(t_s / STEP_S):
                reflex.set_luminance(t_s, luminance)
        stepped.append(reflex.next_mm())
    np.testing.assert_allclose(stepped, light_reflex_mm(4.0, LIGHT, 900.0, 30.0), rtol=1e-12)


def test_light_set_while_they_live_is_light_known_beforehand() -> None:
    seen = [item for item in lived(STILL, LIGHT[1:]) if isinstance(item, PupilSample) and item.eye is Eye.LEFT]
    known = SimulatedEyes(SimulatedSettings(seconds=4.0, luminance=LIGHT, hippus=0.0))
    np.testing.assert_allclose([one.pupil_diameter_mm for one in seen], known.truth.pupil_diameter_mm, atol=1e-9)


def test_no_light_can_come_too_late_for_a_block() -> None:
    assert BLOCK_S < LATENCY_S


def test_the_pupil_answers_after_the_latency_and_not_before() -> None:
    items = lived(STILL, ((1.0, 1000.0),))
    before = [item.pupil_diameter_mm for item in items if isinstance(item, PupilSample) and item.t_ns < 1.2 * NS_PER_S]
    assert set(before) == {before[0]}
    after = [item.pupil_diameter_mm for item in items if isinstance(item, PupilSample) and item.t_ns > 1.3 * NS_PER_S]
    assert before[0] is not None
    assert after[0] is not None
    assert after[0] < before[0]


def test_a_later_word_on_the_same_time_holds() -> None:
    reflex = LightReflex(10.0, 900.0, 30.0)
    reflex.set_luminance(1.0, 1000.0)
    reflex.set_luminance(0.5, 10.0)
    assert {reflex.next_mm() for _ in range(400)} == {LightReflex(10.0, 900.0, 30.0).next_mm()}


def test_hippus_is_as_strong_as_that_of_the_recorded_eyes() -> None:
    steady = np.full(20_000, 4.0)
    hippus = Hippus(np.random.SeedSequence(1), 0.1)
    stepped = np.array([hippus.next_mm(4.0) for _ in range(steady.size)])
    known = with_hippus_mm(np.random.default_rng(1), steady, 0.1)
    assert np.std(stepped) == pytest.approx(np.std(known), rel=0.15)
    assert abs(np.diff(stepped)).max() == pytest.approx(abs(np.diff(known)).max(), rel=0.5)


def test_they_live_the_same_life_again_and_that_of_the_recorded_eyes_of_their_seed() -> None:
    settings = SimulatedSettings(seconds=8.0, seed=5, luminance=((0.0, 10.0),))
    items = lived(settings)
    assert items == lived(settings)
    recorded = SimulatedEyes(settings)
    pupils = [item for item in items if isinstance(item, PupilSample)]
    known = [sample for sample in recorded.samples() if isinstance(sample, PupilSample)]
    assert [(sample.t_ns, sample.eye) for sample in pupils] == [(sample.t_ns, sample.eye) for sample in known]
    assert sum(isinstance(item, GazeSample) for item in items) == 3 * len(pupils) // 2
    # Lids are the same to the sample, whatever the noise; so is where they look, within it.
    shut = [sample.confidence == 0 for sample in pupils]
    assert any(shut)
    assert shut == [sample.confidence == 0 for sample in known]
    looking = [[one for one in each if isinstance(one, GazeSample)] for each in (items, recorded.samples())]
    off_deg = [abs(one.azimuth_deg - other.azimuth_deg) for one, other in zip(*looking, strict=True) if one.confidence]
    assert max(off_deg) < 8 * settings.noise_deg


def test_a_tick_comes_every_tenth_of_a_second() -> None:
    for rate_hz in (30.0, 200.0):
        settings = SimulatedSettings(seconds=2.0, rate_hz=rate_hz, luminance=((0.0, 10.0),))
        ticks = [item.t_ns for item in lived(settings) if isinstance(item, Tick)]
        assert max(np.diff(ticks)) <= 100_100_000


def test_by_the_clock_no_sample_comes_before_its_time() -> None:
    eyes = LiveEyes(SimulatedSettings(luminance=((0.0, 10.0),)), time.monotonic_ns())
    assert eyes.info.live
    early_ns = [item.t_ns - time.monotonic_ns() for item in itertools.islice(eyes.samples(), 400)]
    assert max(early_ns) <= 0


def test_a_schedule_of_light_and_a_setting_out_of_range_are_refused() -> None:
    with pytest.raises(SourceError, match="one luminance"):
        LiveEyes(SimulatedSettings(luminance=LIGHT))
    with pytest.raises(SourceError, match="rate_hz"):
        LiveEyes(SimulatedSettings(rate_hz=1.0, luminance=((0.0, 10.0),)))


def test_both_pupils_and_pixels_are_there() -> None:
    items = lived(STILL)
    first = [item for item in items if isinstance(item, PupilSample)][:2]
    assert [sample.eye for sample in first] == [Eye.RIGHT, Eye.LEFT]
    assert first[0].diameter_px is not None
    assert first[0].pupil_diameter_mm == pytest.approx(first[0].diameter_px / 4.93)
