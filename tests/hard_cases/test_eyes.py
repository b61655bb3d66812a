"""Eyes that break other programs: gaze outside the frame, one eye lost, both lost; and frames that change their size.

The states are those that the bridge makes of an eye tracker's samples, read as the worker reads them.
"""

import itertools
from collections.abc import Iterable, Sequence

import jax.numpy as jnp
import numpy as np
import pytest
from hard_frames import EYE, FOV_DEG, SMALL, grey, see, textured

from entoptic.pipeline import EyePose, Frame, Perceived, RenderState, View, perceive
from entoptic.services.rendering import pose_of
from entoptic.tracker_bridge.chain import records_of
from entoptic.tracker_bridge.samples import Eye, EyeState, GazeSample, Phase, PupilSample
from entoptic.tracker_bridge.source import Item

MS = 1_000_000
STEP_MS = 5
EYES = Eye.LEFT, Eye.RIGHT


def samples(seconds: float, lost: dict[Eye, float]) -> list[Item]:
    """Two eyes of 4 mm that look 6° to the right; each is lost from its second on: confidence 0, no diameter, no gaze.

    As a real tracker loses an eye: what it says of it is nonsense with the confidence of nonsense.
    """
    made: list[Item] = []
    for t_ms in range(0, round(seconds * 1e3), STEP_MS):
        seen = [eye for eye in Eye if t_ms < lost.get(eye, 1e9) * 1e3]
        for eye in Eye:
            size, sure = (4.0, 1.0) if eye in seen else (-7580.0, 0.0)
            made.append(PupilSample(t_ms * MS, eye, size, sure))
        made += [GazeSample(t_ms * MS, eye, 6.0, -2.0, 1.0) for eye in seen]
    return made


def states(items: Iterable[Item]) -> list[EyeState]:
    return [record for record in records_of(items) if isinstance(record, EyeState)]


def pair() -> Frame:
    """Both eyes' images of one place: the same texture with a lamp."""
    rgb = textured(0.3)
    rgb[30, 40] = 1e3
    return Frame.from_rgb(np.stack([rgb.transpose(2, 0, 1)] * 2), FOV_DEG)


def session(told: Sequence[EyeState | None], fps: float = 10.0) -> list[Perceived]:
    """Both eyes' frames, each with the state that is told."""
    frame, seen = pair(), []
    for state in told:
        poses = tuple(pose_of(state, eye) for eye in EYES)
        before = seen[-1].state if seen else None
        seen.append(perceive(frame, poses, observer=SMALL, state=before, dt_s=1 / fps if seen else 0.0))
    return seen


def largest_change(seen: Sequence[Perceived], eye: Eye) -> int:
    """Of any code value from a frame to the next."""
    images = [one.image[EYES.index(eye)].astype(int) for one in seen]
    return max(int(np.abs(after - before).max()) for before, after in itertools.pairwise(images))


def test_one_eye_lost_leaves_the_other_as_it_is_and_goes_on_itself() -> None:
    told = states(samples(2.0, {Eye.LEFT: 0.8}))[:: 100 // STEP_MS]
    both = states(samples(2.0, {}))[:: 100 // STEP_MS]
    assert told[-1].left.phase is Phase.LOST
    assert told[-1].right.phase is Phase.TRACKING
    seen, intact = session(told), session(both)
    for one, other in zip(seen, intact, strict=True):
        assert np.array_equal(one.image[EYES.index(Eye.RIGHT)], other.image[EYES.index(Eye.RIGHT)])
    # A lost eye borrows the other's gaze and pupil: nothing that a person sees changes.
    assert largest_change(seen, Eye.LEFT) <= 1
    assert seen[-1].image.min(axis=(1, 2, 3)).tolist() == intact[-1].image.min(axis=(1, 2, 3)).tolist()


def test_both_eyes_lost_keep_what_was_last_known() -> None:
    told = states(samples(3.0, {Eye.LEFT: 0.8, Eye.RIGHT: 0.9}))[:: 100 // STEP_MS]
    assert told[-1].left.phase is told[-1].right.phase is Phase.LOST
    seen = session(told)
    for eye in Eye:
        assert largest_change(seen, eye) <= 1
        pose = pose_of(told[-1], eye)
        assert pose.pupil_diameter_mm == pytest.approx(4.0, abs=0.01)
        assert (pose.azimuth_deg, pose.elevation_deg) == (6.0, -2.0)


@pytest.mark.parametrize("state", [None, *states(samples(0.3, dict.fromkeys(Eye, 0.0)))[-1:]])
def test_eyes_that_were_never_seen_look_straight_ahead_with_the_pupil_that_the_light_gives(
    state: EyeState | None,
) -> None:
    (seen,) = session([state])
    expected = perceive(pair(), EyePose(), observer=SMALL)
    assert np.array_equal(seen.image, expected.image)
    assert all(2.0 < mm < 8.0 for mm in seen.pupil_diameter_mm)


def test_eyes_that_come_back_do_not_flash() -> None:
    lost = dict.fromkeys(Eye, 0.5)
    gone = samples(1.5, lost)
    back = [
        item
        for t_ms in range(1500, 2500, STEP_MS)
        for item in (
            *(PupilSample(t_ms * MS, eye, 4.0, 1.0) for eye in Eye),
            *(GazeSample(t_ms * MS, eye, 6.0, -2.0, 1.0) for eye in Eye),
        )
    ]
    told = states([*gone, *back])[:: 100 // STEP_MS]
    assert {state.left.phase for state in told} >= {Phase.TRACKING, Phase.LOST}
    seen = session(told)
    assert max(largest_change(seen, eye) for eye in Eye) <= 1


def halves() -> np.ndarray:
    """Dark on the left, bright on the right, and above as bright as below."""
    rgb = grey(0.1)
    rgb[:, 32:] = 100.0
    return rgb


@pytest.mark.parametrize("azimuth_deg", [-175.0, -95.0, -31.0, 31.0, 95.0, 175.0])
@pytest.mark.parametrize("elevation_deg", [-60.0, 0.0, 60.0])
def test_a_gaze_outside_the_frame_adapts_to_what_of_the_frame_is_nearest(
    azimuth_deg: float, elevation_deg: float
) -> None:
    edge = View(64, 60, FOV_DEG).fov_deg / 2
    out = see(halves(), EyePose(azimuth_deg, elevation_deg, 4.0))
    at_the_edge = see(halves(), EyePose(np.copysign(edge, azimuth_deg), 0.0, 4.0))
    assert out.state.adapted_cd_m2 == pytest.approx(at_the_edge.state.adapted_cd_m2, rel=1e-6)
    assert out.image.shape == (1, 60, 64, 3)


def test_a_gaze_that_leaves_the_frame_does_not_jump() -> None:
    path = np.arange(20.0, 60.0, 1.0)
    adapted = [see(halves(), EyePose(float(deg), 0.0, 4.0)).state.adapted_cd_m2[0] for deg in path]
    steps = np.abs(np.diff(np.log(adapted)))
    assert steps[path[1:] > 31].max() == 0
    assert steps.max() < 0.05


def test_a_lamp_glares_wherever_the_eye_looks() -> None:
    rgb = grey(0.1)
    rgb[30, 20] = 1e4
    perceived = see(rgb, EyePose(90.0, 0.0, 4.0))
    assert np.isfinite(np.asarray(perceived.linear)).all()
    assert perceived.image[0, 30, 20, 1] == perceived.image[0, ..., 1].max()


SIZES = (60, 64), (33, 41), (60, 64)


def test_a_change_of_resolution_in_mid_session_is_a_cut_and_nothing_more() -> None:
    """Each frame is what an eye so adapted sees of that size, with all effects; nothing of the old size is left."""
    state = None
    for height, width in SIZES:
        rgb = textured(0.3, height, width)
        rgb[height // 2, width // 2] = 1e4
        before, state = state, see(rgb, state=state, dt_s=0.05).state
        fresh = see(rgb, state=RenderState(state.adapted_cd_m2))
        again = see(rgb, state=state, dt_s=0.0)
        assert again.image.shape == (1, height, width, 3)
        assert np.array_equal(again.image, fresh.image)
        if before is not None:
            target = fresh_target(rgb)
            low, high = sorted((before.adapted_cd_m2[0], target))
            assert low <= state.adapted_cd_m2[0] <= high


def fresh_target(rgb: np.ndarray) -> float:
    return see(rgb).state.adapted_cd_m2[0]


def test_a_change_of_the_field_of_view_in_mid_session_does_the_same() -> None:
    rgb = textured(0.3)
    rgb[30, 32] = 1e4
    state = None
    for fov_deg in (60.0, 100.0):
        frame = Frame.from_rgb(rgb, fov_deg)
        state = perceive(frame, EYE, observer=SMALL, state=state, dt_s=0.05).state
        again = perceive(frame, EYE, observer=SMALL, state=state)
        fresh = perceive(frame, EYE, observer=SMALL, state=RenderState(state.adapted_cd_m2))
        assert np.array_equal(again.image, fresh.image)


def test_the_same_pixels_in_another_view_are_another_frame() -> None:
    """Glare that may serve again for the same array does not where its angles are others."""
    pixels = jnp.asarray(Frame.from_rgb(halves(), FOV_DEG).rgb_cd_m2)
    state = None
    images = []
    for fov_deg in (60.0, 100.0):
        perceived = perceive(Frame(pixels, View(64, 60, fov_deg)), EYE, observer=SMALL, state=state)
        state = RenderState((1.0,), perceived.state.ocular, reusable=perceived.state.reusable)
        images.append(perceived.image)
    assert not np.array_equal(*images)
