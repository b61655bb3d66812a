"""The bounds that planning relies on: no frame changes anywhere by more than is said of its tile."""

import numpy as np
import pytest
from eye_contexts import glared
from hypothesis import given, settings
from hypothesis import strategies as st

from entoptic.pipeline import Frame, GlareLevel, GlareModel, Observer
from entoptic.pipeline.effects.glare import Mixture, bounds, mixture
from entoptic.pipeline.effects.glare.scatter import DARKNESS
from entoptic.pipeline.measure import Measurement, luminance, measure
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.ranges import Change

OBSERVER = Observer()
ROUNDING = 1e-6
"""As a share of the frame's brightest."""
CASES = {
    "wave, 2 mm": (GlareModel.WAVE, 2.0, 1.0),
    "wave, 5.1 mm": (GlareModel.WAVE, 5.1, 1.0),
    "wave, 8 mm": (GlareModel.WAVE, 8.0, 1.0),
    "SPE, starlight": (GlareModel.SPE, 5.0, 1e-3),
    "SPE, day": (GlareModel.SPE, 5.0, 100.0),
    "CIE": (GlareModel.CIE, 5.0, 1.0),
    "IJspeert": (GlareModel.IJSPEERT, 3.1, 1.0),
}
LEVELS = (GlareLevel.EIGHTH, GlareLevel.QUARTER, GlareLevel.HALF)


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
    frame: Frame, kernel: Mixture, level: GlareLevel, *, is_dark: bool = False
) -> tuple[Measurement, np.ndarray, np.ndarray]:
    """What is measured, what stands beyond the frame's edges, and the frame with glare."""
    (measured,) = measure(frame)
    beyond = DARKNESS if is_dark else measured.log_average_cd_m2
    return measured, beyond, glared(frame.rgb_cd_m2[0], frame.view, kernel, level, beyond_cd_m2=beyond)


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
    model, pupil_diameter_mm, adapted_cd_m2 = CASES[case]
    for name, rgb in frames().items():
        frame = Frame.from_rgb(rgb, 26.0)
        kernel = mixture(model, OBSERVER, Pose(pupil_diameter_mm), adapted_cd_m2, frame.view.ppd_centre)
        measured, beyond, seen = actual(frame, kernel, level, is_dark=name == "random")
        bound = bounds.skipped(kernel, bounds.rings(measured, beyond))
        changed = by_tile(seen - np.asarray(frame.rgb_cd_m2[0], np.float64), measured)
        assert (changed <= bound + ROUNDING * measured.range_cd_m2.high.max()).all(), (
            name,
            (changed / (bound + 1e-30)).max(),
        )


@pytest.mark.parametrize("level", [GlareLevel.EIGHTH, GlareLevel.QUARTER])
def test_a_reduced_level_differs_by_no_more_than_is_said(level: GlareLevel) -> None:
    for name, rgb in frames().items():
        frame = Frame.from_rgb(rgb, 26.0)
        kernel = mixture(GlareModel.WAVE, OBSERVER, Pose(5.1), 1.0, frame.view.ppd_centre)
        measured, beyond, full = actual(frame, kernel, GlareLevel.HALF)
        *_, less = actual(frame, kernel, level)
        bound = bounds.reduced(kernel, bounds.rings(measured, beyond), level, GlareLevel.HALF)
        assert (by_tile(full - less, measured) <= bound + 1e-6 * measured.range_cd_m2.high).all(), (
            name,
            (by_tile(full - less, measured) / (bound + 1e-30)).max(),
        )


@given(
    seed=st.integers(0, 2**32 - 1),
    decades=st.floats(0, 8),
    grain=st.integers(1, 40),
    fov_deg=st.sampled_from([5.0, 40.0, 104.0]),
    level=st.sampled_from(LEVELS),
    is_dark=st.booleans(),
)
@settings(max_examples=20)
def test_on_random_frames(
    seed: int, decades: float, grain: int, fov_deg: float, level: GlareLevel, is_dark: bool
) -> None:
    random = np.random.default_rng(seed)
    coarse = 10 ** random.uniform(-decades / 2, decades / 2, (-(-80 // grain), -(-100 // grain), 3))
    frame = Frame.from_rgb(coarse.repeat(grain, 0).repeat(grain, 1)[:80, :100], fov_deg)
    kernel = mixture(GlareModel.CIE, OBSERVER, Pose(5.0), 1.0, frame.view.ppd_centre)
    measured, beyond, seen = actual(frame, kernel, level, is_dark=is_dark)
    changed = by_tile(seen - np.asarray(frame.rgb_cd_m2[0], np.float64), measured)
    bound = bounds.skipped(kernel, bounds.rings(measured, beyond))
    assert (changed <= bound + ROUNDING * measured.range_cd_m2.high.max()).all(), (changed / (bound + 1e-30)).max()


def test_a_plain_wall_is_known_to_change_little_and_a_lamp_to_change_much_only_around_it() -> None:
    wall = Frame.from_rgb(np.full((200, 180, 3), 100.0), 104.0)
    kernel = mixture(GlareModel.WAVE, OBSERVER, Pose(3.0), 100.0, wall.view.ppd_centre)
    (measured,) = measure(wall)
    assert bounds.skipped(kernel, bounds.rings(measured, measured.log_average_cd_m2)).max() < 1e-3
    middle = bounds.skipped(kernel, bounds.rings(measured, DARKNESS))[3]
    rows, columns = middle.shape
    # With darkness around it, a wall lacks what would come from beyond its edges.
    assert middle[rows // 4 : -rows // 4, columns // 4 : -columns // 4].max() < 5
    rgb = np.full((200, 180, 3), 0.1)
    rgb[100, 90] = 1e4
    bound = bounds.skipped(kernel, bounds.rings(measure(Frame.from_rgb(rgb, 104.0))[0], DARKNESS))[3]
    assert bound.max() > 100
    assert bound[:5].max() < bound.max() / 3
