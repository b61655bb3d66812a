"""Lights of their own with a real eye: their energy, their colour, and that they follow the pupil."""

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
    RenderState,
    View,
    perceive,
)
from entoptic.pipeline.effects.glare import GLARE, mixture
from entoptic.pipeline.effects.glare.light_glare import add_lights
from entoptic.pipeline.measure import luminance
from entoptic.pipeline.optics import OpticsError
from entoptic.pipeline.optics.aperture import Pose

VIEW = View(161, 161, 40.0)
EYE = Observer(gratings=60)
POSE = Pose(5.0)
BLACK = np.zeros((3, 161, 161), np.float32)


def drawn(*lights: Light, view: View = VIEW) -> np.ndarray:
    black = np.zeros((3, view.height_px, view.width_px), np.float32)
    return np.asarray(add_lights(black, lights, view, EYE, POSE), np.float64)


def test_a_light_is_what_a_pixel_of_the_same_flux_is() -> None:
    """In the middle of a pixel, of D65: kernel and veil, near and far."""
    rgb = BLACK.copy()
    rgb[:, 80, 80] = 1e4
    kernel = mixture(GlareModel.WAVE, EYE, POSE, 1.0, VIEW.ppd_centre)
    pixel = np.asarray(luminance(glared(rgb, VIEW, kernel, EYE, POSE, Glare(level=GlareLevel.FRAME))), np.float64)
    light = np.asarray(luminance(drawn(Light(0, 0, 1e4 / VIEW.focal_px**2))), np.float64)
    assert light.sum() == pytest.approx(pixel.sum(), rel=2e-3)
    y, x = np.indices(light.shape) - 80
    for low, high in ((0, 1), (4, 8), (8, 15), (15, 40), (40, 80)):
        ring = (np.hypot(x, y) >= low) & (np.hypot(x, y) < high)
        # Around the centre the light is a point and the pixel a square.
        assert light[ring].mean() == pytest.approx(pixel[ring].mean(), rel=0.02), (low, high)


def test_a_lights_glare_has_its_own_colour() -> None:
    y, x = np.indices((161, 161)) - 80
    ring = np.hypot(x, y) > 10
    warm, cold = (drawn(Light(0, 0, 1.0, spectrum=name))[:, ring].mean(axis=1) for name in ("A", "D75"))
    assert warm[0] / warm[2] > 2 * cold[0] / cold[2]


def test_a_light_beyond_the_frame_still_veils_it() -> None:
    beyond, further = (np.asarray(luminance(drawn(Light(deg, 0, 10.0)))) for deg in (30.0, 60.0))
    assert beyond.min() > further.min() > 0
    assert beyond[:, -1].mean() > beyond[:, 0].mean()


def test_a_distant_light_does_not_flicker_as_it_moves_within_a_pixel() -> None:
    """1 km away, circling a third of a pixel: all light, and the glare 1° and 5° away, to 1 %."""
    steps = np.linspace(0, 2 * np.pi, 9)
    pixel_deg = 1 / VIEW.ppd_centre
    y, x = np.indices((161, 161)) - 80
    away_deg = np.hypot(x, y) / VIEW.ppd_centre
    seen = []
    for angle in steps:
        image = drawn(Light(pixel_deg * np.cos(angle) / 3, pixel_deg * np.sin(angle) / 3, 1e-4))
        light = np.asarray(luminance(image), np.float64)
        rings = [light[np.abs(away_deg - deg) < 0.5].sum() for deg in (1.0, 5.0)]
        seen.append([light.sum(), *rings])
    assert np.ptp(seen, axis=0) / np.mean(seen, axis=0) == pytest.approx(0, abs=0.01)


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
