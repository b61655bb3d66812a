import csv
import itertools
import math
from collections.abc import Callable
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
import pytest
from benchmarks import light_reflex

from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.simulated import pupil as simulated_pupil
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings
from entoptic.tracker_bridge.sources.simulated.gaze import MAIN_SEQUENCE_DEG_S, Movement, positions_deg
from entoptic.tracker_bridge.sources.simulated.lid import Blink, draw_blinks, openness_at, visible_area, visible_height
from entoptic.tracker_bridge.sources.simulated.pupil import (
    LATENCY_S,
    STEP_S,
    light_reflex_mm,
    watson_yellott_mm,
    with_hippus_mm,
)
from entoptic.tracker_bridge.sources.simulated.tracker import LOST_MM
from entoptic.tracker_bridge.sources.simulated.truth import TruthEvent

NS = 1_000_000_000


@cache
def two_minutes() -> SimulatedEyes:
    return SimulatedEyes(SimulatedSettings(seconds=120.0, seed=7))


def events(kind: str) -> list[TruthEvent]:
    return [event for event in two_minutes().truth.events if event.kind == kind]


def right_pupils(eyes: SimulatedEyes) -> list[PupilSample]:
    return [s for s in eyes.samples() if isinstance(s, PupilSample) and s.eye is Eye.RIGHT]


def test_a_sample_of_each_kind_and_eye_at_each_time() -> None:
    eyes = SimulatedEyes(SimulatedSettings(seconds=2.0, rate_hz=120.0))
    samples = list(eyes.samples())
    assert len(samples) == 240 * 5
    for at, group in enumerate(samples[first : first + 5] for first in range(0, len(samples), 5)):
        assert [(type(s), s.eye) for s in group] == [
            (PupilSample, Eye.RIGHT),
            (PupilSample, Eye.LEFT),
            (GazeSample, Eye.RIGHT),
            (GazeSample, Eye.LEFT),
            (GazeSample, None),
        ]
        assert {s.t_ns for s in group} == {round(at * NS / 120.0)}
    assert (eyes.info.t_start_ns, eyes.info.t_end_ns) == (0, samples[-1].t_ns)
    assert "computed" in eyes.info.notes[0]


def test_the_same_settings_give_the_same_samples_and_others_do_not() -> None:
    settings = SimulatedSettings(seconds=5.0)
    once, again = (list(SimulatedEyes(settings).samples()) for _ in range(2))
    assert once == again
    assert list(SimulatedEyes(msgspec.structs.replace(settings, seed=2)).samples()) != once


def test_noise_and_rate_leave_what_the_eyes_do() -> None:
    plain = SimulatedEyes(SimulatedSettings(seconds=20.0)).truth
    noisy = SimulatedEyes(SimulatedSettings(seconds=20.0, noise_deg=1.0, diameter_noise_mm=0.5)).truth
    slow = SimulatedEyes(SimulatedSettings(seconds=20.0, rate_hz=50.0)).truth
    assert plain.events == noisy.events == slow.events
    assert (plain.azimuth_deg == noisy.azimuth_deg).all()
    assert (plain.azimuth_deg[:, ::4] == slow.azimuth_deg).all()
    assert (plain.pupil_diameter_mm[::4] == slow.pupil_diameter_mm).all()


def test_all_samples_are_within_their_ranges() -> None:
    for sample in two_minutes().samples():
        msgspec.convert(msgspec.to_builtins(sample), type(sample))
        assert all(math.isfinite(v) for v in msgspec.structs.astuple(sample) if isinstance(v, float))


@pytest.mark.parametrize(
    ("settings", "path"),
    [
        (SimulatedSettings(seconds=0.05), "seconds"),
        (SimulatedSettings(rate_hz=math.nan), "rate_hz"),
        (SimulatedSettings(age_years=7.0), "age_years"),
        (SimulatedSettings(luminance=((0.0, -1.0),)), "luminance"),
        (SimulatedSettings(luminance=()), "luminance"),
        (SimulatedSettings(luminance=((1.0, 1.0),)), "luminance"),
        (SimulatedSettings(luminance=((0.0, 1.0), (5.0, 2.0), (4.0, 3.0))), "luminance"),
        (SimulatedSettings(luminance=((0.0, 1.0), (math.nan, 2.0))), "luminance"),
    ],
)
def test_a_setting_out_of_range_is_named(settings: SimulatedSettings, path: str) -> None:
    with pytest.raises(SourceError, match=path):
        SimulatedEyes(settings)


def test_unknown_settings_are_refused() -> None:
    with pytest.raises(msgspec.ValidationError, match="unknown field `sedd`"):
        msgspec.toml.decode("sedd = 3", type=SimulatedSettings)


# Eye movements


def test_movements_lie_on_the_main_sequence() -> None:
    moves = events("microsaccade") + events("saccade")
    amplitude, velocity = np.log([(e.amplitude_deg or 0.0, e.peak_velocity_deg_s or 0.0) for e in moves]).T
    slope, offset = np.polyfit(amplitude, velocity, 1)
    assert slope == pytest.approx(0.5, abs=0.02)
    assert math.exp(offset) == pytest.approx(MAIN_SEQUENCE_DEG_S, rel=0.03)
    scatter = velocity - (slope * amplitude + offset)
    assert 0.05 < scatter.std() < 0.15


def test_microsaccades_are_small_short_and_frequent() -> None:
    micro = events("microsaccade")
    assert all(0.15 <= (e.amplitude_deg or 0.0) <= 1.0 for e in micro)
    durations_ms = [(e.offset_ns - e.onset_ns) / 1e6 for e in micro]
    assert min(durations_ms) >= 6.0
    assert max(durations_ms) <= 30.0
    assert 9.0 < np.median(durations_ms) < 14.0
    assert 0.6 < len(micro) / 120.0 < 1.4  # 1.2 per second of the time without blinks
    onsets = [e.onset_ns for e in two_minutes().truth.events if e.kind != "blink"]
    assert min(np.diff(onsets)) >= 0.15 * NS


def test_a_saccade_reaches_its_peak_velocity_and_its_goal() -> None:
    move = Movement("saccade", 0.1, 0.04, 3.0, -4.0)
    t_s = np.arange(0.0, 0.3, 1e-5)
    position = positions_deg(t_s, [move])
    speed = np.hypot(*np.gradient(position, 1e-5, axis=1))
    assert speed.max() == pytest.approx(move.peak_velocity_deg_s, rel=1e-3)
    assert position[:, -1] == pytest.approx([3.0, -4.0])
    assert (position[:, t_s <= 0.1] == 0.0).all()
    assert speed[t_s > 0.1401].max() == pytest.approx(0.0, abs=1e-6)


def test_both_eyes_go_together_and_drift_is_slow() -> None:
    truth = two_minutes().truth
    assert np.std(truth.azimuth_deg[0] - truth.azimuth_deg[1]) < 0.05
    assert np.abs(truth.azimuth_deg).max() < 15.0
    still = SimulatedEyes(SimulatedSettings(seconds=60.0, saccades_per_minute=0.0, microsaccades_per_second=0.0)).truth
    assert {event.kind for event in still.events} == {"blink"}
    assert 0.05 < still.azimuth_deg.std() < 0.15
    speed = np.hypot(np.diff(still.azimuth_deg[0]), np.diff(still.elevation_deg[0])) * 200.0
    assert 0.3 < np.median(speed) < 1.2


def test_no_movement_is_near_a_blink() -> None:
    for blink, move in itertools.product(events("blink"), events("microsaccade") + events("saccade")):
        assert move.offset_ns <= blink.onset_ns - 0.149 * NS or move.onset_ns >= blink.offset_ns + 0.149 * NS


def test_measured_gaze_is_the_truth_with_the_given_noise() -> None:
    eyes = two_minutes()
    truth = eyes.truth
    gazes = [s for s in eyes.samples() if isinstance(s, GazeSample) and s.eye is Eye.LEFT]
    seen = truth.openness == 1.0
    error = np.array([s.azimuth_deg for s in gazes]) - truth.azimuth_deg[Eye.LEFT]
    assert error[seen].std() == pytest.approx(0.02, rel=0.05)
    assert error[seen].mean() == pytest.approx(0.0, abs=0.001)


# Lids


def test_blinks_last_300_to_400_ms_and_come_as_often_as_told() -> None:
    durations = [(e.offset_ns - e.onset_ns) / 1e9 for e in events("blink")]
    assert 0.3 <= min(durations) <= max(durations) <= 0.4
    assert all(e.amplitude_deg is None and e.eye is None for e in events("blink"))
    blinks = draw_blinks(np.random.default_rng(1), 3600.0, 15.0)
    assert len(blinks) / 60.0 == pytest.approx(15.0, rel=0.1)
    assert draw_blinks(np.random.default_rng(1), 3600.0, 0.0) == []
    assert all(before.end_s < after.onset_s for before, after in itertools.pairwise(blinks))


def test_a_lid_closes_faster_than_it_opens() -> None:
    t_s = np.arange(0.0, 1.0, 0.001)
    openness = openness_at(t_s, [Blink(0.2, 0.4)])
    assert openness[t_s < 0.2].min() == 1.0
    assert openness[t_s > 0.6].min() == 1.0
    assert openness.min() == 0.0
    assert -np.diff(openness).min() > 1.5 * np.diff(openness).max()


def test_how_much_of_a_pupil_a_lid_leaves() -> None:
    four = np.full(3, 4.0)
    assert visible_height(np.array([1.0, 0.5, 0.0]), four) == pytest.approx([1.0, 0.5, 0.0])
    assert visible_area(np.array([0.0, 0.5, 1.0])) == pytest.approx([0.0, 0.5, 1.0])
    height = 0.3
    a = math.acos(1 - 2 * height)
    assert visible_area(np.array([height]))[0] == pytest.approx((a - math.sin(2 * a) / 2) / math.pi)


def test_each_blink_shrinks_the_pupil_before_it_is_lost() -> None:
    eyes = two_minutes()
    pupils = right_pupils(eyes)
    t_ns = eyes.truth.t_ns
    assert len(events("blink")) > 15
    for blink in events("blink"):
        inside = slice(*np.searchsorted(t_ns, (blink.onset_ns, blink.offset_ns)))
        of_blink, true_mm = pupils[inside], eyes.truth.pupil_diameter_mm[inside]
        lost = [s.confidence == 0.0 for s in of_blink]
        first, last = lost.index(True), len(lost) - 1 - lost[::-1].index(True)
        assert all(lost[first : last + 1])
        assert all(s.pupil_diameter_mm == LOST_MM and s.model_confidence == 0.1 for s in of_blink[first : last + 1])
        before = of_blink[first - 1]
        assert before.confidence >= 0.6  # it passes for good
        assert before.pupil_diameter_mm is not None
        assert before.pupil_diameter_mm < 0.9 * true_mm[first - 1]
        assert of_blink[last + 1].pupil_diameter_mm < 0.9 * true_mm[last + 1]
        assert min(s.openness or 0.0 for s in of_blink) < 0.05
        assert of_blink[0].confidence > 0.95
        assert (last - first) / 200.0 < 0.3


# Pupil


def test_the_steady_pupil_is_that_of_watson_and_yellott() -> None:
    assert watson_yellott_mm(1.0, 900.0, 45.0) == pytest.approx(5.240, abs=5e-4)
    assert watson_yellott_mm(0.0, 900.0, 28.58) == 7.75
    assert watson_yellott_mm(1.6e9, 900.0, 28.58) == pytest.approx(2.0, abs=0.01)


@pytest.mark.parametrize("luminance", [1e-6, 0.01, 1.0, 100.0, 1e4])
def test_after_a_step_the_pupil_settles_at_the_steady_size(luminance: float) -> None:
    diameters = light_reflex_mm(40.0, ((0.0, 30.0), (5.0, luminance)), 900.0, 45.0)
    assert diameters[0] == watson_yellott_mm(30.0, 900.0, 45.0)
    assert diameters[-1] == pytest.approx(watson_yellott_mm(luminance, 900.0, 45.0), abs=0.002)


def test_the_reflex_waits_then_constricts_fast_and_dilates_slowly() -> None:
    t_s = np.arange(0.0, 20.0 + STEP_S / 2, STEP_S)
    bright = light_reflex_mm(20.0, ((0.0, 1.0), (5.0, 1000.0)), 900.0, 30.0)
    dark = light_reflex_mm(20.0, ((0.0, 1000.0), (5.0, 1.0)), 900.0, 30.0)
    for diameters, seen_after_s in ((bright, 0.05), (dark, 0.15)):
        waiting = t_s < 5.0 + LATENCY_S + STEP_S / 2
        assert (diameters[waiting] == diameters[0]).all()
        assert (diameters[~waiting] != diameters[0]).all()
        assert abs(diameters[np.searchsorted(t_s, 5.0 + LATENCY_S + seen_after_s)] - diameters[0]) > 0.02

    def half_way_s(diameters: np.ndarray) -> float:
        half = (diameters[0] + diameters[-1]) / 2
        return float(t_s[np.argmax((diameters < half) != (diameters[0] < half))]) - 5.0

    assert 0.3 < half_way_s(bright) < 0.8
    assert half_way_s(dark) > 2.5 * half_way_s(bright)
    assert np.gradient(bright, STEP_S).min() > -10.0  # the fastest pupils go about 6 mm/s


def test_hippus_is_smooth_and_as_strong_as_told() -> None:
    steady = np.full(60_000, 4.0)
    swing = with_hippus_mm(np.random.default_rng(3), steady, 0.1) - steady
    limit = 0.1 * 9.0 / 4.0 * math.sqrt(1.0 - 4.0 / 9.0)
    assert 0.5 * limit < np.abs(swing).max() <= limit
    assert np.abs(np.gradient(swing, STEP_S)).max() < 1.5
    assert (with_hippus_mm(np.random.default_rng(3), steady, 0.0) == steady).all()


@pytest.mark.parametrize("luminance", [12.0, 500.0])
def test_the_surge_of_the_reflex_is_gone_when_the_light_stays(luminance: float) -> None:
    diameters = light_reflex_mm(40.0, ((0.0, 10.0), (5.0, luminance)), 900.0, 30.0)
    settled = watson_yellott_mm(luminance, 900.0, 30.0)
    assert diameters.min() < settled - 0.02
    assert diameters[-1] == pytest.approx(settled, abs=0.002)


def test_the_reflex_is_the_same_at_any_step(monkeypatch: pytest.MonkeyPatch) -> None:
    flash = ((0.0, 1.0), (1.0, 500.0), (2.0, 1.0))
    coarse = light_reflex_mm(8.0, flash, 900.0, 30.0)
    monkeypatch.setattr(simulated_pupil, "STEP_S", STEP_S / 10)
    assert light_reflex_mm(8.0, flash, 900.0, 30.0)[::10] == pytest.approx(coarse, abs=0.01)


@pytest.mark.shared_data
@pytest.mark.parametrize("power_uw", light_reflex.POWERS_UW)
def test_the_reflex_follows_measured_responses_to_flashes(shared: Callable[[str], Path], power_uw: int) -> None:
    """Five powers of a 1 s flash in the dark, one factor from power to luminance for all of them.

    The background of each series is the light at which its own pupil is as wide as it was before the flash. The last
    0.6 s are left to a wider limit: there the weakest flash leaves the pupil wider than before, which no reflex does.
    """
    t_s, by_power = light_reflex.measured(shared("plr/plr3000_intensity_series_mean_mm.csv"))
    seen_mm = by_power[power_uw]
    seen = light_reflex.response(t_s, seen_mm)
    model_mm = light_reflex.simulated(t_s, power_uw, seen.baseline_mm)
    model = light_reflex.response(t_s, model_mm)
    assert model.baseline_mm == pytest.approx(seen.baseline_mm, abs=0.01)
    assert model.latency_s == pytest.approx(seen.latency_s, rel=0.1)
    assert model.minimum_mm == pytest.approx(seen.minimum_mm, rel=0.1)
    assert model.amplitude_mm == pytest.approx(seen.amplitude_mm, rel=0.1)
    assert model.minimum_s == pytest.approx(seen.minimum_s, rel=0.1)
    error = np.abs(model_mm / seen_mm - 1.0)
    assert error[t_s < 7.4].max() < 0.095
    assert error.max() < 0.105


def test_what_is_read_off_a_response() -> None:
    """Against a triangle: 6 mm until 0.25 s, down by 1 mm/s until 2 s, up again."""
    t_s = np.arange(-30, 150) / 30.0
    read = light_reflex.response(t_s, 6.0 - np.interp(t_s, [0.25, 2.0, 4.0], [0.0, 1.75, 0.0]))
    assert read.latency_s == pytest.approx(0.25 + 0.06, abs=1e-9)
    assert (read.baseline_mm, read.minimum_s) == (6.0, 2.0)
    assert (read.minimum_mm, read.amplitude_mm) == pytest.approx((4.25, 1.75))


# Truth


def test_the_truth_is_written_as_a_table(tmp_path: Path) -> None:
    eyes = two_minutes()
    eyes.write_truth_csv(tmp_path / "truth.csv")
    with (tmp_path / "truth.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == ["kind", "eye", "onset_ns", "offset_ns", "amplitude_deg", "peak_velocity_deg_s"]
    assert [row["kind"] for row in rows] == [event.kind for event in eyes.truth.events]
    for row, event in zip(rows, eyes.truth.events, strict=True):
        assert (row["eye"], int(row["onset_ns"]), int(row["offset_ns"])) == ("both", event.onset_ns, event.offset_ns)
        assert (row["amplitude_deg"] == "") == (event.kind == "blink")
        assert event.kind == "blink" or float(row["amplitude_deg"]) == event.amplitude_deg
