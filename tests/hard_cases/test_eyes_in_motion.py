"""Steps, pupils and impulses that break other programs."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.observer import Observer, OcularDynamics
from entoptic.pipeline.optics.ocular_dynamics import OcularState, SaccadeImpulse, at_rest, pose_of, step

ALIVE = Observer(ocular_dynamics=OcularDynamics(*(True,) * len(OcularDynamics.__struct_fields__)))

lengths = st.one_of(st.sampled_from([0.0, 1e-9, 1 / 60, 10.0, 1e9, -1.0, math.nan, math.inf, 5e-324, 1e300]))
pupils = st.sampled_from([0.0, -3.0, 1.9, 2.0, 5.0, 8.0, 9.0, 1e30, math.nan, math.inf])


def check(state: OcularState, observer: Observer, pupil_diameter_mm: float) -> None:
    for measured in (False, True):
        pose = pose_of(state, observer, pupil_diameter_mm, 0.5, measured)
        assert 2.0 <= pose.pupil_diameter_mm <= 8.0
        assert abs(pose.defocus_d - observer.defocus_d) < 1.5
        assert 0.0 <= pose.openness <= 1.0
        assert all(math.isfinite(deg) for deg in pose.vitreous_deg)
        if pose.lens_m is not None:
            assert np.abs(pose.lens_m).max() < 60e-6


@given(st.lists(st.tuples(lengths, pupils), max_size=8), st.integers(0, 2**64))
def test_no_step_and_no_pupil_makes_an_eye_leave_its_range(steps: list[tuple[float, float]], seed: int) -> None:
    observer = Observer(seed=seed, ocular_dynamics=ALIVE.ocular_dynamics)
    state = at_rest(observer)
    for dt_s, pupil_diameter_mm in steps:
        state = step(state, observer, dt_s, pupil_diameter_mm, (SaccadeImpulse(1.0, 1.0),))
        check(state, observer, pupil_diameter_mm)


def test_a_million_years_end_in_the_same_eye_as_a_second_step_of_none() -> None:
    state = step(at_rest(ALIVE), ALIVE, 3e13, 4.0, (SaccadeImpulse(20.0, 0.0, ago_s=3e13),))
    assert state.vitreous.deg == (0.0, 0.0)
    check(step(state, ALIVE, 0.0, 4.0), ALIVE, 4.0)


def test_a_day_of_frames_neither_drifts_nor_grows() -> None:
    state = step(at_rest(ALIVE), ALIVE, 86400.0, 4.0)
    there = [pose_of(state := step(state, ALIVE, 1 / 60, 4.0), ALIVE, 4.0, 1.0, False) for _ in range(600)]
    for before, after in itertools.pairwise(there):
        assert abs(after.defocus_d - before.defocus_d) < 0.1
        assert abs(after.pupil_diameter_mm - before.pupil_diameter_mm) < 0.05
    check(state, ALIVE, 4.0)


def test_a_storm_of_saccades_dies_away() -> None:
    state = at_rest(ALIVE)
    for number in range(300):
        state = step(state, ALIVE, 1 / 60, 4.0, (SaccadeImpulse(90.0, (-1.0) ** number * 90.0),))
        check(state, ALIVE, 4.0)
    calm = step(state, ALIVE, 10.0, 4.0)
    assert np.abs(calm.vitreous.deg).max() < 1e-4


@pytest.mark.parametrize("dt_s", [1 / 1000, 1 / 7, 3.0])
def test_a_time_that_goes_back_and_forth_passes_once(dt_s: float) -> None:
    forth = step(at_rest(ALIVE), ALIVE, dt_s, 4.0)
    again = step(step(forth, ALIVE, -dt_s, 4.0), ALIVE, dt_s, 4.0)
    assert again.t_s == pytest.approx(2 * dt_s)
    check(again, ALIVE, 4.0)
