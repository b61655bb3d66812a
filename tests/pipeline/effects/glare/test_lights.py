"""Lights of their own: their energy, their place, their colour, and that they follow the pupil."""

import dataclasses

import numpy as np
import pytest
from eye_contexts import glared

from entoptic.pipeline import (
    Effects,
    EyePose,
    Frame,
    Glare,
    GlareLevel,
    GlareModel,
    Light,
    Observer,
    Planning,
    RenderState,
    View,
    perceive,
)
from entoptic.pipeline.effects.glare import GLARE, lights, mixture
from entoptic.pipeline.measure import luminance
from entoptic.pipeline.optics import OpticsError
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.oracles import sphere

VIEW = View(161, 161, 40.0)
WIDE = View(480, 480, 104.0)
EYE = Observer(gratings=60)
POSE = Pose(5.0)


def drawn(*own: Light, view: View = VIEW, level: GlareLevel = GlareLevel.QUARTER) -> np.ndarray:
    black = np.zeros((3, view.height_px, view.width_px), np.float32)
    kernel = mixture(GlareModel.CIE, EYE, POSE, 1.0, view.ppd_centre)
    return glared(black, view, kernel, level, *own)


def lux(image: np.ndarray, view: View) -> float:
    """All the light that comes from an image."""
    return float((np.asarray(luminance(image)) * sphere.solid_angles(view)).sum())


def test_a_light_is_what_a_pixel_of_the_same_flux_is() -> None:
    """In the middle of a pixel, of D65: what stays, and near and far."""
    rgb = np.zeros((3, 161, 161), np.float32)
    rgb[:, 80, 80] = 1e4
    kernel = mixture(GlareModel.WAVE, EYE, POSE, 1.0, VIEW.ppd_centre)
    pixel = np.asarray(luminance(glared(rgb, VIEW, kernel)))
    light = np.asarray(luminance(drawn(Light(0, 0, 1e4 / VIEW.focal_px**2))))
    assert light.sum() == pytest.approx(pixel.sum(), rel=2e-3)
    y, x = np.indices(light.shape) - 80
    for low, high in ((0, 1), (4, 8), (8, 15), (15, 40), (40, 80)):
        ring = (np.hypot(x, y) >= low) & (np.hypot(x, y) < high)
        # Around the centre the light is a point and the pixel a square.
        assert light[ring].mean() == pytest.approx(pixel[ring].mean(), rel=0.05), (low, high)


@pytest.mark.parametrize("level", [GlareLevel.EIGHTH, GlareLevel.QUARTER, GlareLevel.HALF])
@pytest.mark.parametrize("azimuth_deg", [0.0, 20.3, 45.2])
def test_its_lux_are_kept_wherever_it_stands(azimuth_deg: float, level: GlareLevel) -> None:
    """But for what leaves the view: CIE 135 has 1.5 % beyond 30°."""
    image = drawn(Light(azimuth_deg, 3.1, 10.0), view=WIDE, level=level)
    assert 9.65 <= lux(image, WIDE) <= 10.05


@pytest.mark.parametrize("radius_deg", [0.0, 0.1, 0.5, 3.0])
def test_a_disc_has_the_lux_that_it_was_said_to_have(radius_deg: float) -> None:
    image = drawn(Light(11.0, -4.0, 10.0, radius_deg), view=WIDE)
    assert 9.7 <= lux(image, WIDE) <= 10.05


def test_without_glare_a_light_is_still_there() -> None:
    black = np.zeros((3, 480, 480), np.float32)
    for light in (Light(20.3, 4.4, 10.0), Light(-30.0, 0.0, 10.0, 2.0)):
        image = np.asarray(lights.without_glare(black, [light], WIDE), np.float64)
        assert lux(image, WIDE) == pytest.approx(10.0, rel=0.02)
        assert (image.any(axis=0).sum() <= 4) == (light.radius_deg == 0)


def test_a_lights_glare_has_its_own_colour() -> None:
    y, x = np.indices((161, 161)) - 80
    ring = np.hypot(x, y) > 10
    warm, cold = (drawn(Light(0, 0, 1.0, spectrum=name))[:, ring].mean(axis=1) for name in ("A", "D75"))
    assert warm[0] / warm[2] > 2 * cold[0] / cold[2]


@pytest.mark.parametrize("azimuth_deg", [20.6, 22.0, 30.0, 60.0, 95.0])
def test_a_light_beyond_the_frame_veils_it_at_its_true_angle(azimuth_deg: float) -> None:
    """Half a degree beyond the edge, and further; beside the eye too."""
    seen = np.asarray(luminance(drawn(Light(azimuth_deg, 0, 10.0))))
    row, columns = 80, np.array([3, 40, 80, 120, 150])
    ahead = lights.towards(Light(azimuth_deg, 0, 10.0))[:, None]
    deg = sphere.angle_deg(sphere.directions(VIEW, np.full(5, row), columns), ahead)
    kernel = mixture(GlareModel.WAVE, EYE, POSE, 1.0, VIEW.ppd_centre)
    veil = kernel[0][0].veil
    assert veil is not None
    far = (deg > 9) & (deg < 85)
    expected = 10.0 * veil.function(deg, *veil.parameters)
    np.testing.assert_allclose(seen[row, columns][far], expected[far], rtol=0.05)
    # Some of the view lies more than 90° from a light beside the eye.
    assert (seen[:, 100:] > 0).all()


def test_a_light_that_leaves_the_view_does_not_jump() -> None:
    steps = np.linspace(19.0, 21.5, 26)
    seen = np.array([drawn(Light(deg, 1.0, 10.0))[:, 80, 40].sum() for deg in steps])
    assert (np.abs(np.diff(seen)) < 0.05 * seen[:-1]).all()


def test_a_distant_light_does_not_flicker_as_it_moves_within_a_pixel() -> None:
    """Circling a third of a pixel: all light, and the glare 5° away to 1 %, 1° away to 3 %."""
    pixel_deg = 1 / VIEW.ppd_centre
    y, x = np.indices((161, 161)) - 80
    away_deg = np.hypot(x, y) / VIEW.ppd_centre
    seen = []
    for angle in np.linspace(0, 2 * np.pi, 9):
        image = drawn(Light(pixel_deg * np.cos(angle) / 3, pixel_deg * np.sin(angle) / 3, 1e-4))
        light = np.asarray(luminance(image))
        rings = [light[np.abs(away_deg - deg) < 0.5].sum() for deg in (1.0, 5.0)]
        seen.append([light.sum(), *rings])
    assert (np.ptp(seen, axis=0) / np.mean(seen, axis=0) < (0.01, 0.03, 0.01)).all()


def test_an_unknown_spectrum_is_named() -> None:
    with pytest.raises(OpticsError, match="nonesuch"):
        drawn(Light(0, 0, 1.0, spectrum="nonesuch"))


@pytest.mark.parametrize("model", GlareModel)
def test_a_light_follows_the_pupil_whatever_the_frames_own_function(model: GlareModel) -> None:
    frame = dataclasses.replace(Frame.from_rgb(np.full((60, 64, 3), 0.01, np.float32), 40.0), lights=(Light(0, 0, 1),))
    state, images = RenderState((0.05,)), []
    for pupil_diameter_mm in (3.0, 7.0):
        seen = perceive(
            frame,
            EyePose(pupil_diameter_mm=pupil_diameter_mm),
            observer=EYE,
            state=state,
            effects=Effects(glare=Glare(model)),
        )
        images.append(np.asarray(seen.state.reusable[GLARE.name].result))
        state = seen.state
    assert np.abs(images[0] - images[1]).max() > 0


def test_a_light_stays_where_glare_is_left_out() -> None:
    dark = Frame.from_rgb(np.full((60, 64, 3), 0.01, np.float32), 40.0)
    lit = dataclasses.replace(dark, lights=(Light(2.0, 1.0, 1.0),))
    seen, without = (
        perceive(frame, observer=EYE, planning=Planning(leave_out=frozenset({"glare"}))).image[0]
        for frame in (lit, dark)
    )
    assert (seen != without).any(axis=2).sum() >= 1
    assert seen.max() > 200
