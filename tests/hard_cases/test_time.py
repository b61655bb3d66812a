"""Steps of light and of time that break other programs: each through whole frames. docs/hard-cases.md."""

import itertools
import math

import numpy as np
import pytest
from hard_frames import EYE, FOV_DEG, SMALL, SPREAD, UNSPREAD, grey, linear, see, textured

from entoptic.pipeline import Effects, Frame, Glare, Perceived, RenderState, perceive
from entoptic.pipeline.effects.adaptation import Adaptation

FPS = 24
DARK, BRIGHT = 0.01, 1000.0


def course(start: float, target: float, t_s: float) -> float:
    """LUI 5.2–5.4 by hand: what an eye adapted to `start` is adapted to after so long before `target`."""
    rods = 0.04 / (0.04 + target)
    tau_s = rods * 0.4 + (1 - rods) * 0.1
    return target + (start - target) * math.exp(-t_s / tau_s)


def session(frames: list[np.ndarray], fps: float, glare: Glare = SPREAD) -> list[Perceived]:
    """Each frame with what the one before left."""
    seen: list[Perceived] = []
    for rgb in frames:
        seen.append(see(rgb, state=seen[-1].state if seen else None, dt_s=1 / fps if seen else 0.0, glare=glare))
    return seen


def adapted(perceived: list[Perceived]) -> np.ndarray:
    return np.array([one.state.adapted_cd_m2[0] for one in perceived])


@pytest.mark.parametrize(
    ("before", "after", "fps", "seconds"),
    [(DARK, BRIGHT, 24, 1.5), (DARK, BRIGHT, 3, 3.0), (BRIGHT, DARK, 6, 6.0), (1e-6, 1e9, 24, 2.0)],
)
def test_a_step_of_light_adapts_without_oscillation(before: float, after: float, fps: float, seconds: float) -> None:
    """pfstmo_pattanaik00 alternates between 0 and 0.3 for ever, at 24 frames a second from 0.01 to 1000 cd/m²."""
    frames = [textured(before)] * 3 + [textured(after)] * round(seconds * fps)
    seen = session(frames, fps)
    start, *trace = adapted(seen[2:])
    # The texture's mean under the gaze is not the frame's.
    target = see(textured(after)).state.adapted_cd_m2[0]
    expected = [course(start, target, k / fps) for k in range(1, len(trace) + 1)]
    np.testing.assert_allclose(trace, expected, rtol=1e-6)
    shown = np.array([linear(one)[20:-20, 20:-20].mean() for one in seen])
    jump, *settling = np.diff(shown[2:])
    # One step the wrong way, since light comes before the eye has followed; from then on one way alone.
    towards = -math.copysign(1, jump)
    assert abs(jump) > 0.01
    assert (towards * np.array(settling) >= -1e-6).all()
    fresh = linear(see(textured(after)))[20:-20, 20:-20].mean()
    assert shown[-1] == pytest.approx(fresh, rel=0.02)


@pytest.mark.parametrize("dt_s", [0.0, -0.0, -1e-9, -1.0, -1e300, -math.inf, math.nan])
def test_time_that_stands_still_or_goes_backwards_changes_nothing(dt_s: float) -> None:
    state = RenderState((0.2,))
    still = see(textured(50.0), state=state)
    perceived = see(textured(50.0), state=state, dt_s=dt_s)
    assert perceived.state.adapted_cd_m2 == (0.2,)
    assert np.array_equal(perceived.image, still.image)


@pytest.mark.parametrize("dt_s", [1e3, 1e9, 1e300, math.inf])
def test_after_a_huge_step_of_time_the_eye_is_fully_adapted(dt_s: float) -> None:
    fresh = see(textured(50.0))
    perceived = see(textured(50.0), state=RenderState((1e-6,)), dt_s=dt_s)
    assert perceived.state.adapted_cd_m2 == pytest.approx(fresh.state.adapted_cd_m2, rel=1e-12)
    assert np.abs(perceived.image.astype(int) - fresh.image.astype(int)).max() <= 1


@pytest.mark.parametrize("dt_s", [5e-324, 1e-12, 1e-9])
def test_after_a_tiny_step_of_time_hardly_anything_has_changed(dt_s: float) -> None:
    perceived = see(textured(50.0), state=RenderState((0.2,)), dt_s=dt_s)
    assert 0.2 <= perceived.state.adapted_cd_m2[0] <= 0.2 + 51 * dt_s / 0.1


def test_frames_dropped_leave_the_eye_where_it_would_have_been() -> None:
    """One long step is many short ones."""
    steady = textured(50.0)
    state = RenderState((0.2,))
    one = see(steady, state=state, dt_s=0.1)
    for _ in range(10):
        state = see(steady, state=state, dt_s=0.01).state
    assert state.adapted_cd_m2 == pytest.approx(one.state.adapted_cd_m2, rel=1e-12)


@pytest.mark.parametrize("luminance", [1e-6, 0.01, 1.0, 1e3, 1e9])
@pytest.mark.parametrize("dt_s", [0.0, 1 / 24, 1e9])
def test_the_first_frame_is_that_of_an_adapted_eye(luminance: float, dt_s: float) -> None:
    """However long it is said to have taken: no flash at the start, and none at the end of a long wait."""
    first = see(textured(luminance), dt_s=dt_s)
    later = see(textured(luminance), state=first.state, dt_s=30.0)
    assert np.array_equal(first.image, later.image)
    assert 0 < first.image.mean() < 255


def blinking(lamp_cd_m2: float, seconds: float, fps: float, hz: float = 5.0) -> list[np.ndarray]:
    """A street at night with a small light at the gaze, half of each period on."""
    off = textured(0.05)
    on = off.copy()
    on[29:31, 31:33] = lamp_cd_m2
    return [on if k / fps * hz % 1 < 0.5 else off for k in range(round(seconds * fps))]


def test_a_light_blinking_at_5_hz_swings_the_eye_as_far_as_the_formula_says_and_no_farther() -> None:
    """From period to period the same, between the two exponentials' fixed points."""
    fps, lamp = 60, 2e3
    frames = blinking(lamp, 2.0, fps)
    trace = adapted(session(frames, fps, glare=UNSPREAD))
    on, off = (see(frame).state.adapted_cd_m2[0] for frame in (frames[0], frames[6]))
    high = low = off
    for _ in range(100):
        high = course(low, on, 0.1)
        low = course(high, off, 0.1)
    last = trace[-24:]
    assert (last.max(), last.min()) == pytest.approx((high, low), rel=1e-3)
    assert trace.max() <= on
    np.testing.assert_allclose(trace[-12:], trace[-24:-12], rtol=1e-3)


def test_a_robust_eye_hardly_swings_with_a_light_blinking_at_5_hz() -> None:
    """The frame around a small light keeps its exposure: within 6 %, where LUI's mean swings by half and more."""
    swings = []
    for robust in (False, True):
        effects = Effects(glare=UNSPREAD, adaptation=Adaptation(robust=robust))
        state, trace = None, []
        for rgb in blinking(2e3, 1.2, 60):
            dt_s = 0.0 if state is None else 1 / 60
            state = perceive(
                Frame.from_rgb(rgb, FOV_DEG), EYE, observer=SMALL, state=state, dt_s=dt_s, effects=effects
            ).state
            trace.append(state.adapted_cd_m2[0])
        swings.append(max(trace[-24:]) / min(trace[-24:]))
    assert swings[1] < 1.06 < 1.4 < swings[0]


def test_a_blinking_light_leaves_no_ghost() -> None:
    """A frame without the light is the same whether or not the one before had it: glare has no memory."""
    on, off = (blinking(1e5, 1.0, 60)[k] for k in (0, 6))
    state = see(on, state=RenderState((0.05,)), glare=SPREAD).state
    perceived = see(off, state=RenderState((0.05,), state.ocular, reusable=state.reusable), glare=SPREAD)
    assert np.array_equal(perceived.image, see(off, state=RenderState((0.05,)), glare=SPREAD).image)


def cycle(count: int) -> itertools.islice:
    """Frames of a changing scene, for ever: the same twelve again and again."""
    scenes = [grey(0.01, 6, 8), textured(0.3, 6, 8), textured(20.0, 6, 8), grey(0.0, 6, 8), grey(900.0, 6, 8)]
    return itertools.islice(itertools.cycle([scenes[k] for k in (0, 0, 1, 1, 1, 3, 2, 4, 4, 2, 1, 0)]), count)


def drift_of(frames: int) -> tuple[list[Perceived], list[Perceived]]:
    """The ninth and the last twelve of so many frames at 24 a second."""
    state, early, late = None, [], []
    for k, rgb in enumerate(cycle(frames)):
        perceived = see(rgb, state=state, dt_s=1 / FPS)
        state = perceived.state
        if 96 <= k < 108:
            early.append(perceived)
        if k >= frames - 12:
            late.append(perceived)
    return early, late


def no_drift(early: list[Perceived], late: list[Perceived]) -> None:
    np.testing.assert_allclose(adapted(late), adapted(early), rtol=1e-9)
    for first, last in zip(early, late, strict=True):
        assert np.abs(first.image.astype(int) - last.image.astype(int)).max() <= 1


def test_a_hundred_frames_and_more_do_not_drift() -> None:
    no_drift(*drift_of(12 * 12))


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_ten_thousand_frames_do_not_drift() -> None:
    """pfstmo_pattanaik00 drifts within a dozen frames of a scene in which nothing changes."""
    no_drift(*drift_of(12 * 834))


def test_a_scene_in_which_nothing_changes_comes_to_rest_to_the_bit() -> None:
    """From there on every frame is the one before, for 10,000 frames or more: time alone goes on."""
    rgb, state = textured(0.5, 6, 8), RenderState((300.0,))
    before = None
    for _ in range(400):
        perceived = see(rgb, state=state, dt_s=1 / FPS)
        if before is not None and perceived.state.adapted_cd_m2 == before.state.adapted_cd_m2:
            break
        before, state = perceived, perceived.state
    assert before is not None
    assert perceived.state.adapted_cd_m2 == before.state.adapted_cd_m2
    assert np.array_equal(perceived.image, before.image)
    assert perceived.state.adapted_cd_m2 == pytest.approx(see(rgb).state.adapted_cd_m2, rel=1e-12)
