"""The bounds that planning relies on: of every model's kernel, on frames made to lose or gain as much as can be."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest

from pipeline import Observer, View
from pipeline.effects.glare import veil, window
from pipeline.effects.glare.kernel import Mixture, bounds
from pipeline.effects.glare.models import GlareModel, mixture
from pipeline.frame import LUMINANCE_WEIGHTS
from pipeline.measure import Measurement, luminance
from pipeline.optics.aperture import Pose

OBSERVER = Observer()
SMALL = View(90, 100, 26.0)
Measured = Callable[[np.ndarray, View], Measurement]

CASES = {
    "wave, 2 mm": (GlareModel.WAVE, 2.0, 1.0),
    "wave, 5.1 mm": (GlareModel.WAVE, 5.1, 1.0),
    "wave, 8 mm": (GlareModel.WAVE, 8.0, 1.0),
    "SPE, starlight": (GlareModel.SPE, 5.0, 1e-3),
    "SPE, a street": (GlareModel.SPE, 5.0, 0.2),
    "SPE, day": (GlareModel.SPE, 5.0, 100.0),
    "CIE": (GlareModel.CIE, 5.0, 1.0),
    "IJspeert": (GlareModel.IJSPEERT, 3.1, 1.0),
}


def hard_frames() -> dict[str, np.ndarray]:
    """Frames of luminance 1 at most, made to lose or gain as much light as can be."""
    random = np.random.default_rng(4)
    frames = {"uniform": np.ones((3, 100, 90), np.float32)}
    frames["random"] = random.random((3, 100, 90), np.float32)
    frames["sparse"] = (random.random((1, 100, 90)) < 0.01) * random.random((3, 100, 90), np.float32)
    frames["a dark pixel in the light"] = np.ones((3, 100, 90), np.float32)
    frames["a dark pixel in the light"][:, 50, 45] = 0
    frames["in a corner"] = np.zeros((3, 100, 90), np.float32)
    frames["in a corner"][:, 0, 0] = 1
    for channel, colour in enumerate(("red", "green", "blue")):
        frames[f"a {colour} lamp"] = np.zeros((3, 100, 90), np.float32)
        frames[f"a {colour} lamp"][channel, 50, 45] = 1
        frames[f"a {colour} field around a dark pixel"] = np.zeros((3, 100, 90), np.float32)
        frames[f"a {colour} field around a dark pixel"][channel] = 1
        frames[f"a {colour} field around a dark pixel"][channel, 50, 45] = 0
    return {name: (frame / luminance(frame).max()).astype(np.float32) for name, frame in frames.items()}


def kernel_of(case: str) -> Mixture:
    model, pupil_mm, adapted_cd_m2 = CASES[case]
    return mixture(model, OBSERVER, Pose(pupil_mm), adapted_cd_m2, SMALL.ppd_centre)


def glared_luminance(frame: np.ndarray, kernel: Mixture, gaze: tuple[float, float], measured: Measured) -> np.ndarray:
    rgb = jnp.asarray(frame)
    veiled = rgb + veil.veil_change(rgb, SMALL, kernel)
    glared = window.glare_window(rgb, SMALL, kernel, gaze, measured(frame, SMALL), onto=veiled)
    return np.asarray(luminance(glared))


@pytest.mark.parametrize("case", CASES)
def test_glare_changes_no_luminance_by_more_than_its_bound_and_keeps_what_it_says(
    case: str, measured: Measured
) -> None:
    kernel = kernel_of(case)
    bound = bounds(kernel)
    for name, frame in hard_frames().items():
        before = luminance(frame)
        for gaze in ((45.0, 50.0), (3.0, 99.0)):
            after = glared_luminance(frame, kernel, gaze, measured)
            assert 0 < np.abs(after - before).max() <= bound.share * (1 + 1e-5), name
            assert (after >= before * bound.stays * (1 - 1e-5)).all(), name


@pytest.mark.parametrize("case", ["wave, 2 mm", "wave, 8 mm"])
def test_the_bound_is_reached(case: str, measured: Measured) -> None:
    """A lone lamp loses, or a dark pixel gets from lamps of the colours that scatter most to it, all that is allowed.

    The veil, of which a small frame holds little, is put in by hand.
    """
    kernel = kernel_of(case)
    frames = hard_frames()
    lost = []
    for colour in ("red", "green", "blue"):
        lamp = frames[f"a {colour} lamp"]
        lost.append(float(np.abs(glared_luminance(lamp, kernel, (45.5, 50.5), measured) - luminance(lamp)).max()))
    weights = np.array(LUMINANCE_WEIGHTS)
    scatters = sum(weight * np.asarray(part.scatters, np.float64) for part, weight in kernel)
    from_each = np.einsum("o,oijk->ijk", weights, scatters) / weights[:, None, None]
    radius = from_each.shape[1] // 2
    around = np.zeros((3, 100, 90), np.float32)
    square = around[:, 50 - radius : 51 + radius, 45 - radius : 46 + radius]
    for channel in range(3):
        # Light comes from the side opposite to the one it scatters to.
        most = (from_each.argmax(axis=0) == channel)[::-1, ::-1]
        square[channel, most] = 1 / weights[channel]
    around[:, 50, 45] = 0
    glared = window.glare_window(jnp.asarray(around), SMALL, kernel, (45.5, 50.5), measured(around, SMALL))
    got = float(luminance(glared)[50, 45]) + sum(weight * part.veil_share for part, weight in kernel)
    assert max(*lost, got) == pytest.approx(bounds(kernel).share, rel=0.02)


def test_a_pupil_that_grows_through_a_step_does_not_jump(measured: Measured) -> None:
    frame = hard_frames()["a green lamp"] * np.float32(1e4)
    at = {}
    for pupil_mm in (4.9999, 5.0, 5.0001):
        kernel = mixture(GlareModel.WAVE, OBSERVER, Pose(pupil_mm), 1.0, SMALL.ppd_centre)
        at[pupil_mm] = glared_luminance(frame, kernel, (45.0, 50.0), measured)
    np.testing.assert_allclose(at[4.9999], at[5.0], rtol=1e-2, atol=0.05)
    np.testing.assert_allclose(at[5.0001], at[5.0], rtol=1e-2, atol=0.05)
    assert np.abs(at[5.0001] - at[5.0]).max() > 0


@pytest.mark.parametrize("pupil_mm", [0.5, 1.9, 12.0])
def test_a_pupil_out_of_range_is_clamped(pupil_mm: float) -> None:
    clamped = mixture(GlareModel.WAVE, OBSERVER, Pose(min(max(pupil_mm, 2.0), 8.0)), 1.0, SMALL.ppd_centre)
    kernel = mixture(GlareModel.WAVE, OBSERVER, Pose(pupil_mm), 1.0, SMALL.ppd_centre)
    assert [(id(part), weight) for part, weight in kernel] == [(id(part), weight) for part, weight in clamped]
