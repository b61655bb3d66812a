"""Window, frame and sources: one linear operator, against the kernel laid down by hand."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from entoptic.pipeline import View
from entoptic.pipeline.effects.glare import sources, window
from entoptic.pipeline.effects.glare.kernel import Component, Mixture
from entoptic.pipeline.measure import Measurement, luminance

VIEW = View(300, 260, 104.0)
RADIUS = 19
CENTRE = (150.0, 130.0)
Measured = Callable[[np.ndarray, View], Measurement]


@pytest.fixture
def mixture(make_component: Callable[..., Component]) -> Mixture:
    grey = make_component(2, RADIUS, channels=1)
    return ((make_component(0, RADIUS), 0.3), (make_component(1, RADIUS), 0.5), (grey, 0.2))


def by_hand(frame: NDArray[np.float64], kernel: Mixture) -> NDArray[np.float64]:
    """A frame whose every lit pixel lays down the kernel, in float64."""
    radius = kernel[0][0].scatters.shape[2] // 2
    rows, columns = frame.shape[1:]
    padded = np.zeros((3, rows + 2 * radius, columns + 2 * radius))
    stays, scatters = np.zeros((3, 3)), np.zeros((3, 3, 2 * radius + 1, 2 * radius + 1))
    for component, weight in kernel:
        alike = np.eye(3) if component.stays.shape == (1, 1) else 1
        stays += weight * (np.asarray(component.stays, np.float64) * alike + component.veil_share * np.eye(3))
        alike = np.eye(3)[:, :, None, None] if component.stays.shape == (1, 1) else 1
        scatters += weight * np.asarray(component.scatters, np.float64) * alike
    for y, x in np.argwhere(frame.any(axis=0)):
        light = frame[:, y, x]
        padded[:, y : y + 2 * radius + 1, x : x + 2 * radius + 1] += np.einsum("oijk,i->ojk", scatters, light)
        padded[:, y + radius, x + radius] += stays @ light
    return padded[:, radius : radius + rows, radius : radius + columns]


def coloured_lights(view: View = VIEW) -> NDArray[np.float32]:
    frame = np.zeros((3, view.height_px, view.width_px), np.float32)
    for dy, dx, rgb in ((0, 0, (4e3, 1e3, 2e3)), (3, -11, (0, 900, 0)), (-12, 15, (0, 0, 3e3)), (14, 2, (2e3, 0, 0))):
        frame[:, view.height_px // 2 + dy, view.width_px // 2 + dx] = rgb
    return frame


@pytest.mark.parametrize("level", ["window", "frame", "sources"])
def test_every_level_lays_down_the_kernel_at_each_light(level: str, mixture: Mixture, measured: Measured) -> None:
    frame = coloured_lights()
    about = measured(frame, VIEW)
    if level == "window":
        glared = window.glare_window(jnp.asarray(frame), VIEW, mixture, CENTRE, about)
    elif level == "frame":
        glared = window.glare_frame(jnp.asarray(frame), VIEW, mixture, about)
    else:
        glared, taken = sources.glare_sources(jnp.asarray(frame), mixture, about)
        assert len(taken.at) == 4
        assert taken.above_cd_m2 == 30 * about.mean_cd_m2
    expected = by_hand(frame.astype(np.float64), mixture)
    np.testing.assert_allclose(glared, expected, rtol=2e-5, atol=2e-5)
    # All light is well within the frame.
    assert np.asarray(glared, np.float64).sum(axis=(1, 2)) == pytest.approx(frame.sum(axis=(1, 2)), rel=1e-5)


@pytest.mark.parametrize("onto", [False, True])
def test_the_change_is_added_to_another_image(onto: bool, mixture: Mixture, measured: Measured) -> None:
    frame = jnp.asarray(coloured_lights())
    base = np.full(frame.shape, 7.0, np.float32)
    about = measured(np.asarray(frame), VIEW)
    alone = np.asarray(window.glare_window(frame, VIEW, mixture, CENTRE, about))
    added = window.glare_window(frame, VIEW, mixture, CENTRE, about, onto=jnp.asarray(base) if onto else frame + 7)
    np.testing.assert_allclose(added, alone - (frame if onto else 0) + 7, rtol=1e-5, atol=1e-4)
    drawn, _ = sources.glare_sources(frame, mixture, about, onto=jnp.asarray(base))
    np.testing.assert_allclose(drawn, alone - frame + 7, rtol=1e-5, atol=1e-4)


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 1000), factor=st.floats(0.01, 100))
def test_glare_is_linear_in_the_light(seed: int, factor: float, mixture: Mixture, measured: Measured) -> None:
    random = np.random.default_rng(seed)
    one, two = (random.random((3, 60, 70)).astype(np.float32) for _ in range(2))
    view = View(70, 60, 104.0)
    about = measured(one, view)

    def glared(rgb: NDArray[np.float32]) -> NDArray[np.float32]:
        windowed = window.glare_window(jnp.asarray(rgb), view, mixture, (30.0, 31.0), about)
        return np.asarray(windowed) + np.asarray(window.glare_frame(jnp.asarray(rgb), view, mixture, about))

    both = glared(one + np.float32(factor) * two)
    np.testing.assert_allclose(
        both, glared(one) + np.float32(factor) * glared(two), rtol=1e-5, atol=1e-5 * (1 + factor)
    )


@pytest.mark.parametrize("gaze", [(10.0, 250.0), (-40.0, 120.0), (-4000.0, 200.0), (180.0, 1e30), (299.9, 0.1)])
def test_a_gaze_at_the_edge_or_outside_the_frame_is_legal(
    gaze: tuple[float, float], mixture: Mixture, measured: Measured
) -> None:
    frame = np.ones((3, 260, 300), np.float32)
    frame[:, 5, 5] = frame[:, -1, -1] = 1e4
    glared = window.glare_window(jnp.asarray(frame), VIEW, mixture, gaze, measured(frame, VIEW))
    assert np.isfinite(np.asarray(glared)).all()
    assert float(luminance(glared).min()) >= 0


@pytest.mark.parametrize("x", [0.0, 60.3, 300.0, 512.0, 700.0, 1130.5, 1440.0, 1530.0])
@pytest.mark.parametrize("y", [0.0, 30.0, 200.0])
def test_nothing_wraps_round_in_the_window(x: float, y: float, mixture: Mixture, measured: Measured) -> None:
    """The window is not padded: what wraps round is dropped, wherever it lies in the frame."""
    view = View(1440, 200, 150.0)
    frame = np.zeros((3, 200, 1440), np.float32)
    frame[:, 3::29, 5::31] = 100
    windowed = np.asarray(window.glare_window(jnp.asarray(frame), view, mixture, (x, y), measured(frame, view)))
    seen = window.window_of(view, RADIUS)
    assert seen.columns < 1440
    away = np.hypot(np.arange(200)[:, None] + 0.5 - y, np.arange(1440) + 0.5 - x)
    share = window.falloff(away / seen.reach_px)
    expected = frame + by_hand(frame * share, mixture) - frame * share
    np.testing.assert_allclose(windowed, expected, rtol=1e-5, atol=2e-5)


def test_glare_follows_the_gaze(mixture: Mixture, measured: Measured) -> None:
    view = View(1440, 200, 150.0)
    frame = np.zeros((3, 200, 1440), np.float32)
    frame[:, 100, 200] = frame[:, 100, 1240] = 1e4
    glared = np.asarray(window.glare_window(jnp.asarray(frame), view, mixture, (200.5, 100.5), measured(frame, view)))
    assert glared[1, 100, 206] > 0.1
    assert glared[1, 100, 1234] == 0.0


def test_a_light_crossing_the_windows_edge_does_not_jump(mixture: Mixture, measured: Measured) -> None:
    view = View(1440, 200, 150.0)
    frame = np.zeros((3, 200, 1440), np.float32)
    frame[:, 32, 800] = 1e4
    about = measured(frame, view)
    veils = [
        float(window.glare_window(jnp.asarray(frame), view, mixture, (x, 32.0), about)[1, 32, 806])
        for x in np.arange(600.0, 1000.0, 3.0)
    ]
    assert veils[0] == veils[-1] == 0
    assert max(veils) > 0
    # A smooth step over 78 px rises by 1.5/78 a pixel at most.
    assert np.abs(np.diff(veils)).max() < 3 * 1.6 / 78 * max(veils)


def test_the_windows_angle_is_that_of_the_view_not_of_its_pixels(make_component: Callable[..., Component]) -> None:
    """42° either side of the gaze on any display, and glare at the same pixel whatever the window holds."""
    for width in (90, 360, 1440, 2880):
        view = View(width, width, 104.0)
        seen = window.window_of(view, round(9 * view.ppd_centre))
        assert np.degrees(np.arctan(seen.lands_px / view.focal_px)) == pytest.approx(42.3, abs=0.5 if width > 90 else 2)
    assert window.window_of(View(1440, 1600, 104.0), 89).fft_columns == window.WINDOW_PX


@pytest.mark.parametrize("size", [(1, 1), (5, 3), (20, 61)])
def test_frames_smaller_than_the_kernel_and_odd_ones(
    size: tuple[int, int], mixture: Mixture, measured: Measured
) -> None:
    view = View(size[1], size[0], 90.0)
    frame = np.random.default_rng(3).random((3, *size)).astype(np.float32)
    about = measured(frame, view)
    expected = by_hand(frame.astype(np.float64), mixture)
    glared = window.glare_frame(jnp.asarray(frame), view, mixture, about)
    np.testing.assert_allclose(glared, expected, atol=1e-6)
    drawn, taken = sources.glare_sources(jnp.asarray(frame), mixture, about, above_cd_m2=-1.0)
    if not taken.left_out:
        np.testing.assert_allclose(drawn, expected, atol=1e-6)
    windowed = np.asarray(window.glare_window(jnp.asarray(frame), view, mixture, (size[1] / 2, size[0] / 2), about))
    assert windowed.shape == frame.shape
    assert float(luminance(windowed).min()) >= 0


def test_only_the_light_above_a_ceiling_spreads(mixture: Mixture, measured: Measured) -> None:
    frame = coloured_lights() + np.float32(1.0)
    about = measured(frame, VIEW)
    y = np.asarray(luminance(frame))
    share = np.where(y > 100, 1 - 100 / np.maximum(y, 100), 0)
    assert 0 < (share > 0).sum() < 10
    expected = frame + by_hand(frame * share, mixture) - frame * share
    frame_ = jnp.asarray(frame)
    for glared in (
        window.glare_window(frame_, VIEW, mixture, CENTRE, about, ceiling_cd_m2=100.0),
        window.glare_frame(frame_, VIEW, mixture, about, ceiling_cd_m2=100.0),
        sources.glare_sources(frame_, mixture, about, ceiling_cd_m2=100.0, above_cd_m2=1.0)[0],
    ):
        np.testing.assert_allclose(glared, expected, rtol=2e-5, atol=2e-5)


@pytest.mark.parametrize("lit", [(3, 4), (17, 20)])
@pytest.mark.parametrize("level", ["window", "frame"])
def test_the_sun_leaves_the_dark_corner_dark(
    lit: tuple[int, int], level: str, mixture: Mixture, measured: Measured
) -> None:
    """1.6e9 cd/m² over 1e-3: by splats where the sun is small, by float64 where it is large."""
    frame = np.full((3, 260, 300), 1e-3, np.float32)
    frame[:, 100 : 100 + lit[0], 120 : 120 + lit[1]] = 1.6e9
    about = measured(frame, VIEW)
    assert about.max_cd_m2 > window.float32_limit_cd_m2(about)
    sun, dark = (np.where(lit, frame, 0) for lit in (frame > 1, frame < 1))
    share = np.ones(frame.shape[1:])
    if level == "frame":
        glared, night = (window.glare_frame(jnp.asarray(light), VIEW, mixture, about) for light in (frame, dark))
    else:
        glared, night = (
            window.glare_window(jnp.asarray(light), VIEW, mixture, CENTRE, about) for light in (frame, dark)
        )
        away = np.hypot(np.arange(260)[:, None] + 0.5 - CENTRE[1], np.arange(300) + 0.5 - CENTRE[0])
        share = window.falloff(away / window.window_of(VIEW, RADIUS).reach_px)
    sun = sun.astype(np.float64)
    truth = luminance(sun + by_hand(sun * share, mixture) - sun * share)
    got, night = (np.asarray(luminance(np.asarray(rgb, np.float64))) for rgb in (glared, night))
    assert got.min() >= 0
    far, near = truth == 0, truth > 1
    assert far.any()
    assert np.abs(got[far] - night[far]).max() < 1e-5
    assert np.abs(got[near] / truth[near] - 1).max() < 1e-3


def test_an_ordinary_frame_pays_nothing_for_the_sun(mixture: Mixture, measured: Measured) -> None:
    street, day = np.full((3, 260, 300), 0.1, np.float32), np.full((3, 260, 300), 3e3, np.float32)
    street[:, 40, 50], day[:, 40, 50] = 5e3, 1e6
    for frame in (street, day):
        about = measured(frame, VIEW)
        assert about.max_cd_m2 <= window.float32_limit_cd_m2(about)


def test_glare_has_no_latency(mixture: Mixture, measured: Measured) -> None:
    """A frame's glare is its own, whatever came before."""
    frame = coloured_lights()
    about = measured(frame, VIEW)
    first = np.asarray(window.glare_window(jnp.asarray(frame), VIEW, mixture, CENTRE, about))
    window.glare_window(jnp.asarray(frame[:, ::-1]), VIEW, mixture, (3.0, 4.0), about)
    again = np.asarray(window.glare_window(jnp.asarray(frame), VIEW, mixture, CENTRE, about))
    assert np.array_equal(first, again)
