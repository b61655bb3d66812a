"""The bounds that planning relies on: no frame changes anywhere by more than is said of its tile."""

import numpy as np
import pytest
from eye_contexts import glared
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline import Frame, Glare, GlareLevel, GlareModel, Observer
from entoptic.pipeline.effects.glare import Mixture, bounds, mixture
from entoptic.pipeline.measure import Measurement, luminance, measure
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.ranges import Change

OBSERVER = Observer()
CASES = {
    "wave, 2 mm": (GlareModel.WAVE, 2.0, 1.0),
    "wave, 5.1 mm": (GlareModel.WAVE, 5.1, 1.0),
    "wave, 8 mm": (GlareModel.WAVE, 8.0, 1.0),
    "SPE, starlight": (GlareModel.SPE, 5.0, 1e-3),
    "SPE, day": (GlareModel.SPE, 5.0, 100.0),
    "CIE": (GlareModel.CIE, 5.0, 1.0),
    "IJspeert": (GlareModel.IJSPEERT, 3.1, 1.0),
}
LEVELS = (GlareLevel.VEIL, GlareLevel.SOURCES, GlareLevel.WINDOW, GlareLevel.FRAME)


def frames() -> dict[str, np.ndarray]:
    """Frames made to lose or gain as much light as can be."""
    random = np.random.default_rng(4)
    made = {"uniform": np.ones((100, 90, 3))}
    made["random"] = random.random((100, 90, 3))
    made["of all luminances"] = 10 ** random.uniform(-3, 3, (100, 90, 3))
    made["a dark pixel in the light"] = np.ones((100, 90, 3))
    made["a dark pixel in the light"][50, 45] = 0
    made["a light in a corner"] = np.zeros((100, 90, 3))
    made["a light in a corner"][0, 0] = 1
    made["a gradient"] = np.linspace(1, 2, 90)[None, :, None] * np.ones((100, 1, 3))
    for channel, colour in enumerate(("red", "green", "blue")):
        made[f"a {colour} lamp"] = np.full((100, 90, 3), 1e-4)
        made[f"a {colour} lamp"][50, 45, channel] = 1
        made[f"half a {colour} field"] = np.zeros((100, 90, 3))
        made[f"half a {colour} field"][:50, :, channel] = 1
    return made


def actual(
    frame: Frame, kernel: Mixture, case: str, gaze_px: tuple[float, float], level: GlareLevel
) -> tuple[Measurement, np.ndarray]:
    model, pupil_diameter_mm, _ = CASES[case]
    (measured,) = measure(frame)
    image = glared(
        frame.rgb_cd_m2[0], frame.view, kernel, OBSERVER, Pose(pupil_diameter_mm), Glare(model, level), gaze_px
    )
    return measured, image


def by_tile(difference: np.ndarray, measured: Measurement) -> Change:
    """The largest difference in each tile, in R, G, B and Y."""
    with_luminance = np.concatenate([difference, np.asarray(luminance(difference))[None]])
    values, tile_px = np.abs(with_luminance), measured.range_cd_m2.tile_px
    for axis in (1, 2):
        values = np.maximum.reduceat(values, range(0, values.shape[axis], tile_px), axis=axis)
    return values


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("level", LEVELS)
def test_glare_changes_no_tile_by_more_than_is_said(case: str, level: GlareLevel) -> None:
    for name, rgb in frames().items():
        frame = Frame.from_rgb(rgb, 26.0)
        kernel = mixture(*CASES[case][:1], OBSERVER, Pose(CASES[case][1]), CASES[case][2], frame.view.ppd_centre)
        for gaze_px in ((45.0, 50.0), (8.0, 90.0), (170.0, 50.0)):
            measured, glared = actual(frame, kernel, case, gaze_px, level)
            bound = bounds.reduced(kernel, measured, gaze_px, level) + bounds.veil(kernel, measured)
            changed = by_tile(glared - np.asarray(frame.rgb_cd_m2[0], np.float64), measured)
            rounding = 1e-6 * measured.range_cd_m2.high
            assert (changed <= bound * (1 + 1e-4) + rounding).all(), (name, gaze_px, (changed / (bound + 1e-30)).max())


@pytest.mark.parametrize("level", [GlareLevel.WINDOW, GlareLevel.FRAME])
def test_the_veil_alone_differs_by_no_more_than_is_said(level: GlareLevel) -> None:
    case = "wave, 5.1 mm"
    for name, rgb in frames().items():
        frame = Frame.from_rgb(rgb, 26.0)
        kernel = mixture(GlareModel.WAVE, OBSERVER, Pose(5.1), 1.0, frame.view.ppd_centre)
        measured, full = actual(frame, kernel, case, (20.0, 30.0), level)
        _, veil = actual(frame, kernel, case, (20.0, 30.0), GlareLevel.VEIL)
        bound = bounds.reduced(kernel, measured, (20.0, 30.0), level)
        rounding = 1e-6 * measured.range_cd_m2.high
        assert (by_tile(full - veil, measured) <= bound * (1 + 1e-4) + rounding).all(), name


@given(
    seed=st.integers(0, 2**32 - 1),
    decades=st.floats(0, 8),
    grain=st.integers(1, 40),
    fov_deg=st.floats(5, 150),
    gaze=st.tuples(st.floats(-40, 140), st.floats(-40, 120)),
    level=st.sampled_from(LEVELS),
)
def test_on_random_frames(
    seed: int, decades: float, grain: int, fov_deg: float, gaze: tuple[float, float], level: GlareLevel
) -> None:
    random = np.random.default_rng(seed)
    coarse = 10 ** random.uniform(-decades / 2, decades / 2, (-(-80 // grain), -(-100 // grain), 3))
    frame = Frame.from_rgb(coarse.repeat(grain, 0).repeat(grain, 1)[:80, :100], fov_deg)
    kernel = mixture(GlareModel.CIE, OBSERVER, Pose(5.0), 1.0, frame.view.ppd_centre)
    measured, glared = actual(frame, kernel, "CIE", gaze, level)
    bound = bounds.reduced(kernel, measured, gaze, level) + bounds.veil(kernel, measured)
    changed = by_tile(glared - np.asarray(frame.rgb_cd_m2[0], np.float64), measured)
    assert (changed <= bound * (1 + 1e-4) + 1e-6 * measured.range_cd_m2.high).all()


def test_a_plain_wall_is_known_to_change_little_and_a_lamp_to_change_much_only_around_it() -> None:
    wall = Frame.from_rgb(np.full((200, 180, 3), 100.0), 104.0)
    kernel = mixture(GlareModel.WAVE, OBSERVER, Pose(3.0), 100.0, wall.view.ppd_centre)
    measured = measure(wall)[0]
    middle = bounds.reduced(kernel, measured, (90.0, 100.0), GlareLevel.FRAME)[3]
    rows, columns = middle.shape
    assert middle[rows // 4 : -rows // 4, columns // 4 : -columns // 4].max() < 1e-3
    rgb = np.full((200, 180, 3), 0.1)
    rgb[100, 90] = 1e4
    lit = measure(Frame.from_rgb(rgb, 104.0))[0]
    bound = bounds.reduced(kernel, lit, (90.0, 100.0), GlareLevel.FRAME)[3]
    assert bound.max() > 100
    assert bound[:5].max() < 0.1
