"""Where a pupil is supposed to be while nobody sees it."""

import numpy as np
import pytest

from entoptic.tracker_bridge.extrapolation import FADE_S, Extrapolation
from entoptic.tracker_bridge.trust import IRIS_SPEED_PER_S

STEP_NS = 5_000_000


def moving(speed_mm_s: float, noise_mm: float = 0.0, seed: int = 0) -> Extrapolation:
    noise = np.random.default_rng(seed).normal(0.0, noise_mm, 40)
    return Extrapolation([(k * STEP_NS, 5.0 + speed_mm_s * (k - 39) * 0.005 + noise[k]) for k in range(40)])


def test_a_still_pupil_stays_exactly() -> None:
    assert {moving(0.0).at(k * STEP_NS) for k in range(39, 400)} == {5.0}


def test_a_moving_pupil_goes_on_ever_slower_up_to_a_bound() -> None:
    extrapolation, end_ns = moving(-2.0), 39 * STEP_NS
    assert extrapolation.at(end_ns) == pytest.approx(5.0)
    assert extrapolation.at(end_ns + 10_000_000) == pytest.approx(4.98, abs=0.002)
    assert extrapolation.at(end_ns + 3600_000_000_000) == pytest.approx(5.0 - 2.0 * FADE_S)


def test_noise_alone_is_no_movement() -> None:
    ends = [moving(0.0, 0.03, seed).at(10**12) - 5.0 for seed in range(200)]
    # The straight line's unshrunk slope would put it off by 0.05 mm.
    assert np.sqrt(np.mean(np.square(ends))) < 0.035


def test_no_pupil_goes_faster_than_an_iris() -> None:
    assert moving(-50.0).at(10**12) > 1.0
    limit_mm_s = IRIS_SPEED_PER_S * (5.0 + 50.0 * 0.05)
    assert moving(-50.0).at(10**12) >= 5.0 - limit_mm_s * FADE_S - 50.0 * 0.05


def test_few_samples_tell_no_speed() -> None:
    assert Extrapolation([(0, 4.0), (STEP_NS, 4.1), (2 * STEP_NS, 4.2)]).at(10**12) == 4.2


def test_a_pupil_of_next_to_nothing_has_a_course_too() -> None:
    extrapolation = Extrapolation([(k * STEP_NS, 1e-300 * (k + 1)) for k in range(10)])
    assert extrapolation.at(10**12) == pytest.approx(1e-299)
