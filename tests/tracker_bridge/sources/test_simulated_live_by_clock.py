"""Simulated eyes that live by the clock, without an end."""

import itertools
from collections.abc import Iterator

import msgspec
import numpy as np
import pytest

from entoptic.tracker_bridge.samples import NS_PER_S, Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Item, SourceError, Tick
from entoptic.tracker_bridge.sources import played
from entoptic.tracker_bridge.sources.simulated import live
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings
from entoptic.tracker_bridge.sources.simulated.live import STRETCH_S, LiveEyes

MS = 1_000_000
DIM = SimulatedSettings(seed=3, luminance=((0.0, 1.0),), hippus=0.0, diameter_noise_mm=0.0, noise_deg=0.0)


class Clock:
    """A machine that computes in no time: nothing but sleep lets time pass."""

    def __init__(self) -> None:
        self.now_ns = 1_000 * NS_PER_S

    def monotonic_ns(self) -> int:
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        self.now_ns += round(seconds * NS_PER_S)


@pytest.fixture(autouse=True)
def time(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    for module in (live, played):
        monkeypatch.setattr(module, "time", clock)
    return clock


@pytest.fixture(scope="module")
def drawn() -> SimulatedEyes:
    return SimulatedEyes(msgspec.structs.replace(DIM, seconds=float(STRETCH_S)))


def until(items: Iterator[Item], end_ns: int) -> list[Item]:
    return list(itertools.takewhile(lambda item: item.t_ns < end_ns, items))


def pupils(items: list[Item]) -> list[PupilSample]:
    return [item for item in items if isinstance(item, PupilSample) and item.eye is Eye.LEFT]


def gazes(items: list[Item]) -> dict[int, tuple[float, float]]:
    seen = [item for item in items if isinstance(item, GazeSample) and item.eye is None and item.confidence > 0.98]
    return {item.t_ns: (item.azimuth_deg, item.elevation_deg) for item in seen}


def assert_as_drawn(seen: dict[int, tuple[float, float]], begun_ns: int, drawn: SimulatedEyes) -> None:
    """Where they look is told by the time since they began, whenever they were started."""
    at = [(t_ns - begun_ns) // (5 * MS) for t_ns in seen]
    truth = drawn.truth
    np.testing.assert_allclose([azimuth for azimuth, _ in seen.values()], truth.azimuth_deg[:, at].mean(axis=0))


def test_they_are_the_recorded_ones_and_have_no_end(drawn: SimulatedEyes, time: Clock) -> None:
    begun_ns = time.monotonic_ns()
    eyes = LiveEyes(DIM, begun_ns)
    items = until(eyes.samples(), time.monotonic_ns() + 400 * MS)
    assert (eyes.info.t_start_ns, eyes.info.t_end_ns, eyes.info.live) == (begun_ns, None, True)
    assert_as_drawn(gazes(items), begun_ns, drawn)
    assert set(np.diff([sample.t_ns for sample in pupils(items)])) == {5 * MS}
    assert max(np.diff([item.t_ns for item in items if isinstance(item, PupilSample | Tick)])) <= 100 * MS


def test_started_again_they_look_where_they_would_have_looked(drawn: SimulatedEyes, time: Clock) -> None:
    begun_ns = time.monotonic_ns() - 7 * NS_PER_S
    items = until(LiveEyes(DIM, begun_ns).samples(), time.monotonic_ns() + 300 * MS)
    seen = gazes(items)
    assert min(seen) >= begun_ns + 7 * NS_PER_S
    assert_as_drawn(seen, begun_ns, drawn)


def test_between_two_stretches_they_blink_and_the_pupil_goes_on(time: Clock) -> None:
    begun_ns = time.monotonic_ns() - STRETCH_S * NS_PER_S + 300 * MS
    items = until(LiveEyes(DIM, begun_ns).samples(), begun_ns + STRETCH_S * NS_PER_S + 400 * MS)
    samples = pupils(items)
    shut = [sample.t_ns for sample in samples if sample.confidence == 0.0]
    border_ns = begun_ns + STRETCH_S * NS_PER_S
    assert shut[0] < border_ns < shut[-1]
    assert samples[-1].confidence > 0.9
    assert samples[-1].pupil_diameter_mm == pytest.approx(samples[0].pupil_diameter_mm)
    assert set(np.diff([sample.t_ns for sample in samples])) == {5 * MS}
    # The gaze leaps behind the lid alone.
    seen = gazes(items)
    assert not [t_ns for t_ns in seen if abs(t_ns - border_ns) < 50 * MS]


def test_the_pupil_answers_to_light_that_is_set(time: Clock) -> None:
    begun_ns = time.monotonic_ns() - 3 * STRETCH_S * NS_PER_S - 5 * NS_PER_S
    eyes = LiveEyes(DIM, begun_ns)
    samples = eyes.samples()
    dark_mm = pupils(until(samples, time.monotonic_ns() + 100 * MS))[-1].pupil_diameter_mm
    eyes.set_luminance(5000.0, time.monotonic_ns())
    bright_mm = pupils(until(samples, time.monotonic_ns() + 900 * MS))[-1].pupil_diameter_mm
    assert dark_mm is not None
    assert bright_mm is not None
    assert bright_mm < dark_mm - 0.5


def test_light_known_beforehand_is_refused() -> None:
    with pytest.raises(SourceError, match="one luminance"):
        LiveEyes(SimulatedSettings(), 0)
