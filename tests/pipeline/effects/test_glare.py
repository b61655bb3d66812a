"""Glare on frames: energy, linearity, place, both models, and the bounds that planning relies on."""

import numpy as np
import pytest

from pipeline import Observer, View
from pipeline.effects import glare
from pipeline.measure import luminance

VIEW = View(360, 400, 104.0)
OBSERVER = Observer()
CENTRE = (180.0, 200.0)


def dark(value: float = 0.0) -> np.ndarray:
    return np.full((3, 400, 360), value, np.float32)


def test_glare_moves_light_and_makes_none() -> None:
    frame = dark(0.1)
    frame[:, 190:194, 170:173] = 5e4
    glared = np.asarray(glare.wave_glare(frame, VIEW, OBSERVER, 5.0, CENTRE), np.float64)
    # What leaves at the frame's edge is of the 0.1 cd/m² there, 1e-5 of the whole.
    assert glared.sum(axis=(1, 2)) == pytest.approx(frame.sum(axis=(1, 2), dtype=np.float64), rel=1e-4)
    assert glared.min() >= 0
    assert glared[0, 192, 181] > 0.2


def test_glare_is_linear_in_the_light() -> None:
    random = np.random.default_rng(0)
    one, two = (random.random((3, 400, 360)).astype(np.float32) for _ in range(2))
    both = np.asarray(glare.wave_glare(one + 3 * two, VIEW, OBSERVER, 4.0, CENTRE))
    parts = [np.asarray(glare.wave_glare(frame, VIEW, OBSERVER, 4.0, CENTRE)) for frame in (one, two)]
    np.testing.assert_allclose(both, parts[0] + 3 * parts[1], rtol=0, atol=2e-5)


@pytest.mark.parametrize("gaze", [(10.0, 390.0), (-4000.0, 200.0), (180.0, 1e30), (359.9, 0.1)])
def test_a_gaze_at_the_edge_or_outside_the_frame_is_legal(gaze: tuple[float, float]) -> None:
    frame = dark(1.0)
    frame[:, 5, 5] = 1e5
    glared = np.asarray(glare.wave_glare(frame, VIEW, OBSERVER, 5.0, gaze))
    assert np.isfinite(glared).all()
    assert glared.min() >= 0


def test_glare_follows_the_gaze() -> None:
    view = View(1440, 400, 104.0)
    frame = np.zeros((3, 400, 1440), np.float32)
    frame[:, 200, 200] = frame[:, 200, 1240] = 1e5
    glared = np.asarray(glare.wave_glare(frame, view, OBSERVER, 5.0, (200.5, 200.5)))
    assert glared[1, 200, 210] > 0.1
    assert glared[1, 200, 1230] == 0.0


def test_a_light_crossing_the_windows_edge_does_not_jump() -> None:
    view = View(1440, 64, 104.0)
    veils = []
    for x in np.arange(500.0, 1100.0, 3.0):
        frame = np.zeros((3, 64, 1440), np.float32)
        frame[:, 32, 800] = 1e5
        veils.append(float(glare.wave_glare(frame, view, OBSERVER, 5.0, (x, 32.0))[1, 32, 806]))
    assert max(veils) > 0
    assert np.abs(np.diff(veils)).max() < 0.02 * max(veils)


def test_a_pupil_that_grows_through_a_step_does_not_jump() -> None:
    frame = dark()
    frame[:, 200, 180] = 1e5
    at = {mm: np.asarray(glare.wave_glare(frame, VIEW, OBSERVER, mm, CENTRE)) for mm in (3.9999, 4.0, 4.0001)}
    np.testing.assert_allclose(at[3.9999], at[4.0], rtol=1e-2, atol=0.05)
    np.testing.assert_allclose(at[4.0001], at[4.0], rtol=1e-2, atol=0.05)
    assert np.abs(at[4.0001] - at[4.0]).max() > 0


@pytest.mark.parametrize("pupil_mm", [0.5, 1.9, 2.0, 8.0, 12.0])
def test_a_pupil_out_of_range_is_clamped(pupil_mm: float) -> None:
    frame = dark()
    frame[:, 200, 180] = 1e5
    clamped = glare.wave_glare(frame, VIEW, OBSERVER, min(max(pupil_mm, 2.0), 8.0), CENTRE)
    assert np.array_equal(np.asarray(glare.wave_glare(frame, VIEW, OBSERVER, pupil_mm, CENTRE)), np.asarray(clamped))


def test_the_window_equals_summing_the_kernel_over_the_lights() -> None:
    """The FFT, its padding and its window against the kernel laid down at each light by hand."""
    frame = dark()
    lights = [(203, 181, 4e4), (198, 170, 1e3), (240, 150, 7e3)]
    kernel = glare.wave_kernel(OBSERVER, 20, VIEW.ppd_centre)
    radius = kernel.scatters.shape[1] // 2
    expected = np.zeros((3, 400 + 2 * radius, 360 + 2 * radius))
    for y, x, cd_m2 in lights:
        frame[:, y, x] = cd_m2
        expected[:, y : y + 2 * radius + 1, x : x + 2 * radius + 1] += cd_m2 * np.asarray(kernel.scatters)
        expected[:, y + radius, x + radius] += cd_m2 * np.asarray(kernel.stays)
    glared = np.asarray(glare.wave_glare(frame, VIEW, OBSERVER, 5.0, CENTRE))
    np.testing.assert_allclose(glared, expected[:, radius:-radius, radius:-radius], rtol=1e-4, atol=2e-3)


def test_the_analytic_veil_falls_as_spe_says() -> None:
    view = View(201, 201, 60.0)
    frame = np.zeros((3, 201, 201), np.float32)
    frame[:, 100, 100] = 1e6
    glared = np.asarray(glare.analytic_glare(frame, view, 100.0, 20.0), np.float64)
    from pipeline.optics import analytic

    for away in (10, 60):
        deg = away / view.ppd_centre
        weights = analytic.spe_weights(100.0, 20.0)
        density = weights[1] * analytic.f1(np.array(deg)) + weights[2] * analytic.f2(np.array(deg))
        expected = 1e6 * density * np.radians(1 / view.ppd_centre) ** 2
        assert glared[1, 100, 100 + away] == pytest.approx(float(expected), rel=0.02)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (5, 3), (33, 31)])
def test_frames_smaller_than_the_kernel_and_odd_ones(size: tuple[int, int]) -> None:
    height, width = size
    view = View(width, height, 90.0)
    frame = np.ones((3, height, width), np.float32)
    for glared in (
        glare.wave_glare(frame, view, OBSERVER, 5.0, (width / 2, height / 2)),
        glare.analytic_glare(frame, view, 10.0, 30.0),
    ):
        values = np.asarray(glared)
        assert values.shape == frame.shape
        assert np.isfinite(values).all()
        assert values.min() > 0
        # Not 1: the window's falloff, a few pixels wide here, scatters more of one pixel than of the next.
        assert values.max() <= 1.003


SMALL = View(90, 100, 26.0)


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


@pytest.mark.parametrize("name", hard_frames())
@pytest.mark.parametrize("pupil_mm", [2.0, 5.1, 8.0])
def test_wave_glare_changes_no_luminance_by_more_than_its_bound(name: str, pupil_mm: float) -> None:
    frame = hard_frames()[name]
    bound = glare.wave_bounds(OBSERVER, pupil_mm, SMALL).share
    for gaze in ((45.0, 50.0), (3.0, 99.0)):
        change = luminance(glare.wave_glare(frame, SMALL, OBSERVER, pupil_mm, gaze)) - luminance(frame)
        assert 0 < np.abs(np.asarray(change)).max() <= bound * (1 + 1e-5)


@pytest.mark.parametrize("name", hard_frames())
@pytest.mark.parametrize(("adapted_cd_m2", "age_years"), [(1e-3, 20.0), (0.2, 60.0), (100.0, 120.0)])
def test_analytic_glare_changes_no_luminance_by_more_than_its_bound(
    name: str, adapted_cd_m2: float, age_years: float
) -> None:
    frame = hard_frames()[name]
    bound = glare.analytic_bounds(SMALL, adapted_cd_m2, age_years).share
    glared = np.asarray(glare.analytic_glare(frame, SMALL, adapted_cd_m2, age_years))
    assert glared.min() >= 0
    assert 0 < np.abs(np.asarray(luminance(glared) - luminance(frame))).max() <= bound * (1 + 1e-5)


def test_the_bound_is_reached() -> None:
    """At a narrow pupil red scatters most: a lone red pixel loses all that the bound allows."""
    lamp = hard_frames()["a red lamp"]
    change = luminance(glare.wave_glare(lamp, SMALL, OBSERVER, 2.0, (45.5, 50.5))) - luminance(lamp)
    bound = glare.wave_bounds(OBSERVER, 2.0, SMALL).share
    assert np.abs(np.asarray(change)).max() == pytest.approx(bound, rel=0.02)


def test_no_pixel_keeps_less_than_the_bound_says() -> None:
    frame = hard_frames()["random"]
    for pupil_mm in (2.0, 5.1, 8.0):
        left = luminance(glare.wave_glare(frame, SMALL, OBSERVER, pupil_mm, (45.0, 50.0)))
        assert (left >= luminance(frame) * glare.wave_bounds(OBSERVER, pupil_mm, SMALL).stays * (1 - 1e-5)).all()
