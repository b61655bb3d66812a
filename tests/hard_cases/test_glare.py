"""Light that breaks glare: the sun beside starlight, single pixels, darkness, frames of any size, impossible pupils."""

import functools
import math

import jax.numpy as jnp
import numpy as np
import pytest
from eye_contexts import glared

from entoptic.pipeline.effects import glare
from entoptic.pipeline.effects.glare import models
from entoptic.pipeline.effects.glare.kernel import Mixture, Part
from entoptic.pipeline.effects.glare.settings import GlareLevel
from entoptic.pipeline.frame import Frame, FrameError, View
from entoptic.pipeline.measure import luminance
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.oracles import sphere
from entoptic.pipeline.oracles.point_spread import alike, cie135
from entoptic.pipeline.render import EyePose

LEVELS = list(GlareLevel)
OBSERVER = Observer(particles=50, gratings=0)
SUN_CD_M2, SUN_DEG = 1.6e9, 0.53
SIGHTS = {"14 ppd": (View(512, 512, 36.5), (10.6, 12.3)), "8 ppd, odd": (View(301, 411, 35.0), (291.4, 400.2))}
"""A view, and where in it the sun is: (x, y) px, in a corner."""


@functools.lru_cache(maxsize=4)
def wave(pixels_per_deg: float) -> Mixture:
    """One pupil's function, of a coarse plane and few wavelengths: with a veil, and coloured."""
    return ((models.wave_part(OBSERVER, Pose(4.0), pixels_per_deg, grid=512, wavelengths=8), 1.0),)


@functools.lru_cache
def cie() -> Mixture:
    return models.mixture(models.GlareModel.CIE, Observer(), Pose(4.0), 1.0, 10.0)


def _compact(per_deg: float, radius: int, wider: float) -> np.ndarray:
    """The same light as CIE's near the axis, and none further than 3°."""
    offset = np.arange(-radius, radius + 1) / per_deg
    near = cie()[0][0].cells(per_deg, radius, wider) * (np.hypot(offset[:, None], offset) < 3)
    near[:, :, radius, radius] += 1 - near.sum()
    return near


@functools.lru_cache
def compact() -> Mixture:
    return ((Part(_compact, None), 1.0),)


def scattered(rgb: np.ndarray, view: View, kernel: Mixture, level: GlareLevel) -> np.ndarray:
    return glared(rgb, view, kernel, level)


def sun(view: View, x_px: float, y_px: float) -> np.ndarray:
    """Starlight, and the sun's disc with the edge that a camera's pixels would have."""
    part = (np.arange(5) + 0.5) / 5
    v = ((np.arange(view.height_px)[:, None] + part).ravel() - view.height_px / 2) / view.focal_px
    u = ((np.arange(view.width_px)[:, None] + part).ravel() - view.width_px / 2) / view.focal_px
    sun_u, sun_v = (x_px - view.width_px / 2) / view.focal_px, (y_px - view.height_px / 2) / view.focal_px
    length = np.sqrt(1 + v[:, None] ** 2 + u[None, :] ** 2) * math.sqrt(1 + sun_v**2 + sun_u**2)
    inside = (1 + v[:, None] * sun_v + u[None, :] * sun_u) / length > math.cos(math.radians(SUN_DEG / 2))
    share = inside.reshape(view.height_px, 5, view.width_px, 5).mean(axis=(1, 3))
    return np.broadcast_to(1e-3 + SUN_CD_M2 * share, (3, *share.shape)).astype(np.float32)


def far_from(view: View, sun_px: tuple[float, float]) -> np.ndarray:
    """One in a hundred of the pixels (n, 2) more than half the view away from the sun, and not at the edges."""
    rows, columns = np.indices((view.height_px, view.width_px))[:, 20:-20:40, 20:-20:40].reshape(2, -1)
    away = np.hypot(columns - sun_px[0], rows - sun_px[1])
    return np.stack([rows, columns], axis=1)[away > view.width_px / 2][::101]


@functools.cache
def lit_by_the_sun(name: str) -> np.ndarray:
    """The truth there, (3, n)."""
    view, at = SIGHTS[name]
    return sphere.glare(sun(view, *at), view, alike(cie135(30.0, 0.5)), far_from(view, at))


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("name", SIGHTS)
def test_the_sun_beside_starlight(name: str, level: GlareLevel) -> None:
    """In float32, and nothing below 0: 4 % in the dark corner, which the sun's veil lights."""
    view, at = SIGHTS[name]
    rgb = sun(view, *at)
    image = scattered(rgb, view, cie(), level)
    far = far_from(view, at)
    truth = lit_by_the_sun(name)
    assert truth.min() > 100
    np.testing.assert_allclose(image[:, far[:, 0], far[:, 1]], truth, rtol=0.04)
    assert np.asarray(luminance(jnp.asarray(image))).min() >= 0


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("name", SIGHTS)
def test_the_sun_without_a_veil_leaves_starlight_but_for_rounding(name: str, level: GlareLevel) -> None:
    """No eye is without a veil: without one there is noise, 5e-8 of the sun."""
    view, at = SIGHTS[name]
    image = scattered(sun(view, *at), view, compact(), level)
    far = far_from(view, at)
    assert np.abs(image[:, far[:, 0], far[:, 1]] - 1e-3).max() < 5e-8 * SUN_CD_M2
    assert np.asarray(luminance(jnp.asarray(image))).min() >= 0


@pytest.mark.parametrize("level", LEVELS)
def test_an_all_black_frame_stays_exactly_black(level: GlareLevel) -> None:
    view = View(96, 80, 40.0)
    assert not scattered(np.zeros((3, 80, 96)), view, wave(view.ppd_centre), level).any()


@pytest.mark.parametrize("level", LEVELS)
def test_one_white_pixel_stays_where_it_is(level: GlareLevel) -> None:
    view = View(96, 80, 40.0)
    rgb = np.zeros((3, 80, 96))
    rgb[:, 41, 50] = 100.0
    image = scattered(rgb, view, wave(view.ppd_centre), level)
    y = np.asarray(luminance(jnp.asarray(image)))
    assert np.unravel_index(y.argmax(), y.shape) == (41, 50)
    # What leaves the frame goes further than 15°; further out pixels have less of the sphere.
    assert 96 <= y.sum() <= 100.5


@pytest.mark.parametrize("level", LEVELS)
def test_a_nan_pixel_is_black_and_spreads_nothing(level: GlareLevel) -> None:
    rgb = np.full((80, 96, 3), 1.0, np.float32)
    black = rgb.copy()
    black[40, 30] = 0.0
    rgb[40, 30] = math.nan
    cleaned, expected = (np.asarray(Frame.from_rgb(pixels, 40.0).rgb_cd_m2[0]) for pixels in (rgb, black))
    view = View(96, 80, 40.0)
    clear = np.ones_like(cleaned)
    kernel = wave(view.ppd_centre)
    images = [scattered(pixels, view, kernel, level) for pixels in (cleaned, expected, clear)]
    assert np.isfinite(images[0]).all()
    assert np.array_equal(images[0], images[1])
    # Ten pixels away its light is hardly missed.
    y, x = np.indices((80, 96))
    far = np.hypot(y - 40, x - 30) > 10
    assert np.abs(images[0] - images[2])[:, far].max() < 1e-3


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1), (2, 2), (5, 3)])
def test_a_kernel_larger_than_the_frame(size: tuple[int, int], level: GlareLevel) -> None:
    """At 14 pixels per degree a kernel has 253² pixels, these frames have few; light that leaves them is lost."""
    height, width = size
    view = View(width, height, 1.0)
    rgb = np.random.default_rng(height).lognormal(3, 2, (3, height, width)).astype(np.float32)
    kernel = wave(13.5)
    image = scattered(rgb, view, kernel, level)
    assert image.shape == rgb.shape
    assert np.isfinite(image).all()
    assert np.asarray(luminance(jnp.asarray(image))).min() >= 0
    expected = sphere.glare(rgb, view, alike(cie135(30.0, 0.5)))
    np.testing.assert_allclose(scattered(rgb, view, cie(), level), expected, rtol=0.1, atol=0.02 * rgb.max())


@pytest.mark.parametrize("pupil_diameter_mm", [0.0, -1.0, math.nan, math.inf])
def test_an_impossible_pupil_is_refused_by_name(pupil_diameter_mm: float) -> None:
    with pytest.raises(FrameError, match="pupil"):
        EyePose(pupil_diameter_mm=pupil_diameter_mm)


@pytest.mark.parametrize(("pupil_diameter_mm", "counts_as"), [(0.5, 2.0), (1.9999, 2.0), (12.0, 8.0)])
def test_a_pupil_out_of_range_counts_as_the_nearest(pupil_diameter_mm: float, counts_as: float) -> None:
    at = [
        models.mixture(glare.GlareModel.IJSPEERT, OBSERVER, Pose(mm), 1.0, 8.0) for mm in (pupil_diameter_mm, counts_as)
    ]
    assert at[0] == at[1]
    assert models.pupil_steps(pupil_diameter_mm) == models.pupil_steps(counts_as)
