"""Blinks that only openness shows, on lids whose way is known."""

import numpy as np
import pytest

from entoptic.tracker_bridge.dropout import DropoutFilter
from entoptic.tracker_bridge.events import BlinkOffset, BlinkOnset
from entoptic.tracker_bridge.lids import LidDips
from entoptic.tracker_bridge.samples import Eye, Phase, PupilSample

STEP_NS = 8_333_333


def dips(times_s: list[float], heights: list[float], noise: float = 0.0) -> list[tuple[int, int]]:
    found, lids = [], LidDips()
    rng = np.random.default_rng(1)
    for k in range(round(times_s[-1] * 120)):
        height = float(np.interp(k / 120, times_s, heights)) + rng.normal(0.0, noise)
        dip = lids.add(k * STEP_NS, min(max(height, 0.0), 1.0))
        if dip is not None:
            found.append(dip)
    return found


@pytest.mark.parametrize("depth", [0.25, 0.4, 0.9])
def test_a_quick_dip_is_told_with_its_times(depth: float) -> None:
    ((onset_ns, end_ns),) = dips([0.0, 1.0, 1.1, 1.15, 1.4, 2.0], [1.0, 1.0, 1.0 - depth, 1.0 - depth, 1.0, 1.0])
    assert onset_ns == pytest.approx(1.0e9, abs=40e6)
    assert end_ns == pytest.approx(1.275e9, abs=40e6)


def test_a_squint_a_slow_lid_and_noise_are_no_dips() -> None:
    assert not dips([0.0, 1.0, 1.4, 2.8, 3.2, 4.0], [1.0, 1.0, 0.4, 0.4, 1.0, 1.0])
    assert not dips([0.0, 1.0, 1.1, 2.5, 2.6, 4.0], [1.0, 1.0, 0.4, 0.4, 1.0, 1.0])
    assert not dips([0.0, 60.0], [0.8, 0.8], noise=0.03)


def eye(heights: list[float], pupil_from: float) -> list[PupilSample]:
    return [
        PupilSample(k * STEP_NS, Eye.LEFT, 4.0, 1.0 if height > pupil_from else 0.0, openness=height)
        for k, height in enumerate(heights)
    ]


@pytest.mark.parametrize(("lowest", "phases"), [(0.6, {Phase.TRACKING}), (0.1, set(Phase) - {Phase.LOST})])
def test_a_blink_is_told_once_whether_the_pupil_goes_or_stays(lowest: float, phases: set[Phase]) -> None:
    down = np.linspace(1.0, lowest, 10).tolist()
    samples = eye([*[1.0] * 100, *down, *[lowest] * 6, *down[::-1], *[1.0] * 100], pupil_from=0.5)
    eye_filter = DropoutFilter()
    shown = [eye_filter.step(sample) for sample in samples]
    onset, offset = (event for state in shown for event in state.events)
    assert isinstance(onset, BlinkOnset)
    assert isinstance(offset, BlinkOffset)
    assert offset.duration_ns == offset.t_ns - onset.t_ns
    assert {state.phase for state in shown} <= phases
    assert {state.pupil_diameter_mm for state in shown} == {4.0}
