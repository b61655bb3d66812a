"""Lights of their own: their flux, their glare and their steadiness as they move."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from entoptic.pipeline import Frame, View
from entoptic.pipeline.effects.glare import lights, window
from entoptic.pipeline.effects.glare.kernel import component
from entoptic.pipeline.effects.glare.lights import SUBPIXELS, Falloff, LightMixture, PointKernel
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, Light
from entoptic.pipeline.measure import luminance, measure

VIEW = View(160, 140, 40.0)
RADIUS = 12
VEIL_SHARE = 0.1
DARK = np.zeros((3, 140, 160), np.float32)


def fine_kernel() -> np.ndarray:
    """A yellowish kernel with a sharp core and a tail of the angle's −3rd power, in sub-pixels; luminance 1 − veil."""
    half = RADIUS * SUBPIXELS
    offset = np.arange(-half, half + 1) / SUBPIXELS
    away = np.hypot(offset[:, None], offset)
    grey = np.maximum(1 - away / away[0, half], 0) / (0.1 + away) ** 3
    grey *= (1 - VEIL_SHARE) / grey.sum()
    yellow = np.array([1.4, 0.97, 0.12])
    return grey * (yellow / (yellow @ LUMINANCE_WEIGHTS))[:, None, None]


KERNEL = PointKernel(fine_kernel())
MIXTURE: LightMixture = ((KERNEL, 0.4), (PointKernel(fine_kernel()), 0.6))


def draw(*sources: Light, falloff: Falloff = Falloff.NONE, view: View = VIEW) -> np.ndarray:
    dark = jnp.zeros((3, view.height_px, view.width_px), jnp.float32)
    return np.asarray(lights.draw_lights(dark, sources, view, lambda _: MIXTURE, falloff), np.float64)


def at_px(x: float, y: float, **more: float) -> Light:
    """A light at a place in VIEW."""
    right, up = (x - VIEW.width_px / 2) / VIEW.focal_px, (VIEW.height_px / 2 - y) / VIEW.focal_px
    azimuth = np.degrees(np.arctan(right))
    return Light(float(azimuth), float(np.degrees(np.arctan(up * np.cos(np.radians(azimuth))))), 1.0, **more)


@pytest.mark.parametrize("falloff", Falloff)
@pytest.mark.parametrize("radius_deg", [0.0, 0.05, 0.3, 0.8, 2.2, 4.0])
def test_a_lights_illuminance_is_what_it_was_said_to_be(falloff: Falloff, radius_deg: float) -> None:
    light = Light(0.0, 0.0, 2.5, radius_deg)
    drawn = draw(light, falloff=falloff)
    illuminance = luminance(drawn).sum() / VIEW.focal_px**2
    assert float(illuminance) == pytest.approx(2.5 * (1 - VEIL_SHARE), rel=1e-4)


def test_off_the_axis_a_pixel_has_a_smaller_solid_angle() -> None:
    light = Light(12.0, 9.0, 1.0, 0.4)
    where = lights.place(light, VIEW)
    assert where is not None
    cosine = np.cos(np.radians(12)) * np.cos(np.radians(9))
    assert float(luminance(draw(light)).sum()) * cosine**3 / VIEW.focal_px**2 == pytest.approx(1 - VEIL_SHARE, rel=1e-4)
    # The disc's own luminance is its illuminance over its solid angle, wherever it stands.
    disc_cd_m2 = where.cd_m2 / (np.pi * where.radius_px**2)
    assert disc_cd_m2 == pytest.approx(1 / (np.pi * np.radians(0.4) ** 2))


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(x=st.floats(70, 90), y=st.floats(60, 80))
def test_a_distant_light_does_not_flicker_as_it_moves(x: float, y: float) -> None:
    """1 km away, on a boat that heaves: total flux to 1e-4, and what falls beyond 4 px of it to 1 %."""
    drawn = luminance(draw(at_px(x, y)))
    still = luminance(draw(at_px(80.5, 70.5)))
    steradians = [
        np.cos(np.arctan(np.hypot(px - 80, py - 70) / VIEW.focal_px)) ** 3 for px, py in ((x, y), (80.5, 70.5))
    ]
    assert float(drawn.sum()) * steradians[0] == pytest.approx(float(still.sum()) * steradians[1], rel=1e-4)

    def beyond(image: np.ndarray, px: float, py: float) -> float:
        """Light beyond 4 px, weighed by a smooth step so that no pixel's middle decides."""
        away = np.hypot(np.arange(140)[:, None] + 0.5 - py, np.arange(160) + 0.5 - px)
        return float((image * np.clip((away - 3) / 2, 0, 1)).sum())

    moved, fixed = beyond(drawn, x, y) * steradians[0], beyond(still, 80.5, 70.5) * steradians[1]
    assert moved == pytest.approx(fixed, rel=0.01)


@pytest.mark.parametrize("edge", [80.0, 64.0, 0.0, 160.0])
def test_crossing_a_pixels_border_a_tile_or_the_frames_edge_is_smooth(edge: float) -> None:
    """Steps of a hundredth of a pixel change no pixel by more than 5 hundredths of the light in its brightest one."""
    steps = [luminance(draw(at_px(edge + shift, 70.3))) for shift in np.arange(-0.3, 0.3, 0.01)]
    brightest = max(float(step.max()) for step in steps)
    assert max(float(np.abs(b - a).max()) for a, b in itertools.pairwise(steps)) < 0.05 * brightest


def test_a_light_in_the_middle_of_a_pixel_is_what_that_pixel_would_be() -> None:
    """Drawn as a light, or lit in the frame and spread by the frame's FFT: the same."""
    coarse = np.asarray(lights.phases(KERNEL, 0, Falloff.NONE))[SUBPIXELS**2 // 2, :, 0].astype(np.float64)
    grey = np.tensordot(LUMINANCE_WEIGHTS, coarse, 1)
    light = Light(0.0, 0.0, 1.0)
    view = View(161, 141, 40.0)
    drawn = luminance(draw(light, view=view))
    frame = np.zeros((3, 141, 161), np.float32)
    frame[:, 70, 80] = view.focal_px**2
    seen = component(grey, None, VEIL_SHARE)
    glared = window.glare_frame(
        jnp.asarray(frame), view, ((seen, 1.0),), measure(Frame(jnp.asarray(frame)[None], view))[0]
    )
    spread = luminance(np.asarray(glared, np.float64))
    spread[70, 80] -= VEIL_SHARE * view.focal_px**2  # which the veil would take
    np.testing.assert_allclose(drawn, spread, rtol=1e-4, atol=1e-6 * view.focal_px**2)


def test_a_disc_grows_smoothly_and_far_from_it_its_glare_does_not_change() -> None:
    radii = np.concatenate([np.linspace(0, 3, 13), np.linspace(7.5, 8.6, 12)]) / VIEW.ppd_centre
    images = [luminance(draw(Light(0.0, 0.0, 1.0, float(radius)))) for radius in radii]
    far = [float(image[70, 80 + 6]) for image in images[:5]]
    assert max(far) / min(far) - 1 < 0.1  # an inverse cube over a disc of 1 px, 6 px away
    for before, after in itertools.pairwise(images[13:]):
        # A tenth of a pixel more of radius fills a tenth of the edge's pixels, from the last layer on too.
        assert np.abs(after - before).max() < 0.11 * before.max()


def test_the_largest_prepared_disc_is_the_disc() -> None:
    """A disc of 8 px from the prepared ones, and one convolved on its own."""
    at = lights.place(Light(0.07, 0.11, 1.0, 8 / VIEW.ppd_centre), VIEW)
    assert at is not None
    prepared = luminance(draw(Light(0.07, 0.11, 1.0, 7.9999 / VIEW.ppd_centre)))
    alone = luminance(np.float64(at.cd_m2) * lights._large_disc(at, KERNEL, Falloff.NONE, (140, 160)))
    assert np.abs(prepared - alone).max() < 0.05 * alone.max()
    assert float(np.abs(prepared - alone).sum() / alone.sum()) < 0.01


def test_a_falloff_takes_nothing_from_the_centre_and_all_from_the_rim() -> None:
    x_squared = np.array([0.0, 0.25, 1.0, 2.0])
    np.testing.assert_array_equal(Falloff.NONE.weight(x_squared), 1)
    np.testing.assert_array_equal(Falloff.EPANECHNIKOV.weight(x_squared), [1, 0.75, 0, 0])
    np.testing.assert_array_equal(Falloff.SILVERMAN.weight(x_squared), [1, 0.5625, 0, 0])
    light = at_px(80.5, 70.5)
    plain, weighed = draw(light), draw(light, falloff=Falloff.SILVERMAN)
    assert (weighed[:, 70, 80] > plain[:, 70, 80]).all()
    assert weighed[1, 70, 86] / plain[1, 70, 86] == pytest.approx((1 - (6 / RADIUS) ** 2) ** 2, rel=0.05)


@pytest.mark.parametrize(
    "light", [Light(180.0, 0.0, 1.0), Light(0.0, 89.9, 1.0), Light(-90.0, 45.0, 1.0), Light(60.0, 0.0, 1e9)]
)
def test_lights_that_reach_nothing_draw_nothing(light: Light) -> None:
    assert not draw(light).any()


def test_many_lights_are_the_sum_of_each() -> None:
    random = np.random.default_rng(0)
    many = [at_px(float(x), float(y)) for x, y in random.uniform(-5, 150, (300, 2))]
    together = draw(*many)
    some = [draw(*many[k : k + 100]) for k in (0, 100, 200)]
    np.testing.assert_allclose(together, sum(some), rtol=1e-4, atol=1e-3)
