"""The living eye as a whole: steps of any length, each switch by itself, what nobody measures."""

import dataclasses
import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.observer import Observer, OcularDynamics
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.optics.ocular_dynamics import OcularState, SaccadeImpulse, at_rest, pose_of, step

SQUINT = Observer().squint_openness
SWITCHES = OcularDynamics.__struct_fields__
ALL = OcularDynamics(**dict.fromkeys(SWITCHES, True))
KICKS = (SaccadeImpulse(8.0, -3.0), SaccadeImpulse(-0.4, 0.2, ago_s=0.03))


def observer_with(*switches: str, seed: int = 3) -> Observer:
    return Observer(seed=seed, defocus_d=0.5, ocular_dynamics=OcularDynamics(**dict.fromkeys(switches, True)))


ALIVE = observer_with(*SWITCHES)


def numbers(state: OcularState) -> np.ndarray:
    """A whole state, the lens in millimetres."""
    parts = [np.array([state.t_s, state.hippus_beats, *state.vitreous.deg, *state.vitreous.deg_s])]
    if state.lens is not None:
        parts += [1e3 * state.lens.position, 1e3 * state.lens.velocity]
    return np.concatenate(parts)


def after(
    observer: Observer, seconds: float, fps: float = 25.0, impulses: tuple[SaccadeImpulse, ...] = ()
) -> OcularState:
    state = step(at_rest(observer), observer, 0.0, 4.0, impulses)
    for _ in range(round(seconds * fps)):
        state = step(state, observer, 1 / fps, 4.0)
    return state


def pose_after(observer: Observer, seconds: float = 0.4, *, openness: float = 0.6, measured: bool = False) -> Pose:
    return pose_of(after(observer, seconds, impulses=KICKS), observer, 4.0, openness, measured)


def deviations(pose: Pose) -> set[str]:
    """The fields in which a pose is not that of an eye at rest."""
    rest = Pose(4.0, 0.5)
    return {
        field.name
        for field in dataclasses.fields(Pose)
        if not np.array_equal(getattr(pose, field.name), getattr(rest, field.name))
    }


def test_with_nothing_switched_on_the_eye_is_at_rest_whatever_happens() -> None:
    pose = pose_after(observer_with(), openness=0.0)
    assert deviations(pose) == set()
    assert pose.lens_m is None


@pytest.mark.parametrize(
    ("switches", "moves"),
    [
        (("microfluctuations",), {"defocus_d"}),
        (("lens",), set()),  # nothing drives it
        (("microfluctuations", "lens"), {"defocus_d", "lens_m"}),
        (("vitreous",), {"vitreous_deg"}),
        (("lids",), {"openness"}),
        (("lashes",), set()),  # nothing lowers them before the pupil
        (("lids", "lashes"), {"openness", "lashes"}),
        (("squint",), {"openness"}),
        (("hippus",), {"pupil_diameter_mm"}),
    ],
)
def test_each_switch_moves_its_own_part_alone(switches: tuple[str, ...], moves: set[str]) -> None:
    assert deviations(pose_after(observer_with(*switches))) == moves


@pytest.mark.parametrize("switch", SWITCHES)
def test_each_switch_off_leaves_its_part_at_rest_and_the_others_as_they_are(switch: str) -> None:
    everything = pose_after(ALIVE)
    assert deviations(everything) == {field.name for field in dataclasses.fields(Pose)}
    living_without = msgspec.structs.replace(ALL, **{switch: False})
    pose = pose_after(msgspec.structs.replace(ALIVE, ocular_dynamics=living_without))
    rests = {
        "microfluctuations": {"defocus_d", "lens_m"},
        "lens": {"lens_m"},
        "vitreous": {"vitreous_deg"},
        "lids": set(),  # the lids are squinting
        "lashes": {"lashes"},
        "squint": set(),  # the lids are as the tracker says
        "hippus": {"pupil_diameter_mm"},
    }[switch]
    assert deviations(pose) == deviations(everything) - rests
    for name in deviations(pose) - {"openness"}:
        np.testing.assert_array_equal(getattr(pose, name), getattr(everything, name))
    assert pose.openness == {"lids": SQUINT, "squint": 0.6}.get(switch, SQUINT)


@pytest.mark.parametrize(
    ("switches", "openness", "expected"),
    [
        (("lids",), 0.0, 0.0),
        (("lids",), 0.6, 0.6),
        (("lids",), 0.93, 1.0),  # touches no pupil of 4 mm
        (("squint",), 0.0, SQUINT),  # what the tracker says is not asked for
        (("squint", "lids"), 1.0, SQUINT),
        (("squint", "lids"), 0.1, 0.1),
        (("lids",), 1.7, 1.0),
        (("lids",), -0.2, 0.0),
    ],
)
def test_lids_go_as_far_as_measured_and_squinting_no_further_up(
    switches: tuple[str, ...], openness: float, expected: float
) -> None:
    assert pose_after(observer_with(*switches), openness=openness).openness == expected


def test_a_measured_pupil_is_left_as_it_is() -> None:
    assert pose_after(ALIVE, measured=True).pupil_diameter_mm == 4.0
    assert pose_after(ALIVE, measured=False).pupil_diameter_mm != 4.0


@given(
    st.sampled_from([1e-9, 1e-3, 1 / 90, 0.3, 10.0, 1e4]),
    st.floats(0.0, 1.0),
    st.floats(2.0, 8.0),
    st.floats(0.0, 100.0),
)
def test_two_steps_are_one_of_both_lengths(
    dt_s: float, share: float, pupil_diameter_mm: float, before_s: float
) -> None:
    start = step(step(at_rest(ALIVE), ALIVE, before_s, 5.0, KICKS), ALIVE, 0.01, 5.0)
    whole = step(start, ALIVE, dt_s, pupil_diameter_mm)
    half = step(start, ALIVE, dt_s * share, pupil_diameter_mm)
    halves = step(half, ALIVE, dt_s - dt_s * share, pupil_diameter_mm)
    np.testing.assert_allclose(numbers(halves), numbers(whole), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("fps", [7.0, 30.0, 300.0])
def test_the_frame_rate_changes_nothing(fps: float) -> None:
    slow, fast = after(ALIVE, 2.0, 1.0, KICKS), after(ALIVE, 2.0, fps, KICKS)
    np.testing.assert_allclose(numbers(slow), numbers(fast), rtol=0, atol=1e-8)


@pytest.mark.parametrize("dt_s", [0.0, -0.0, -1e-9, -5.0, -math.inf, math.inf, math.nan])
def test_no_time_passes_where_it_does_not_go_forwards(dt_s: float) -> None:
    before = after(ALIVE, 1.0, impulses=KICKS)
    np.testing.assert_array_equal(numbers(step(before, ALIVE, dt_s, 6.0)), numbers(before))
    turned_eye = step(before, ALIVE, dt_s, 6.0, (SaccadeImpulse(4.0, 2.0),))
    turned = np.array(turned_eye.vitreous.deg) - np.array(before.vitreous.deg)
    np.testing.assert_allclose(turned, (-2.0, -1.0), rtol=0, atol=1e-12)
    assert (turned_eye.t_s, turned_eye.hippus_beats) == (before.t_s, before.hippus_beats)


def test_an_eye_moves_the_same_way_twice_and_another_otherwise() -> None:
    first, second, other = (pose_after(observer_with(*SWITCHES, seed=seed)) for seed in (3, 3, 4))
    for field in dataclasses.fields(Pose):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(second, field.name))
    assert first.defocus_d != other.defocus_d
    assert first.pupil_diameter_mm != other.pupil_diameter_mm
    assert not np.array_equal(first.lens_m, other.lens_m)


def test_the_lens_follows_accommodation() -> None:
    observer = observer_with("microfluctuations", "lens")
    state, lens, drive = at_rest(observer), [], []
    for _ in range(2000):
        state = step(state, observer, 0.01, 5.0)
        pose = pose_of(state, observer, 5.0, 1.0, True)
        assert pose.lens_m is not None
        assert pose.lens_m.shape == (17, 17)
        lens.append(pose.lens_m[8, 8])
        drive.append(pose.defocus_d)
    lens_um, drive_d = 1e6 * np.array(lens[200:]), np.array(drive[200:]) - 0.5
    lags = range(12)
    fits = [np.corrcoef(lens_um[lag:], drive_d[: len(drive_d) - lag])[0, 1] for lag in lags]
    assert np.argmin(fits) in (3, 4, 5, 6)  # × 10 ms
    assert min(fits) < -0.99
    assert np.polyfit(drive_d, lens_um, 1)[0] == pytest.approx(-7.5, abs=1.5)  # µm/D, halfway to the equator


def test_a_vitreous_that_has_come_back_rests() -> None:
    observer = observer_with("vitreous")
    assert deviations(pose_after(observer, 2.0)) == {"vitreous_deg"}
    assert deviations(pose_after(observer, 5.0)) == set()


def test_a_pupil_that_changes_does_not_make_hippus_jump() -> None:
    observer = observer_with("hippus")
    state = step(at_rest(observer), observer, 5000.0, 3.0)
    one = pose_of(state, observer, 3.0, 1.0, False).pupil_diameter_mm
    state = step(state, observer, 1e-3, 3.001)
    other = pose_of(state, observer, 3.001, 1.0, False).pupil_diameter_mm
    assert abs(other - one) < 0.005
