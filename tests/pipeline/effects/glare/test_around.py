"""Light from beyond a view's edges: a panorama's, against the sum over all of it, and what settings say of it."""

import math

import numpy as np
import pytest
from eye_contexts import viewing
from jax import Array

from entoptic.pipeline import EyePose, Frame, Glare, GlareModel, View, perceive
from entoptic.pipeline.effects.effect import SKIPPED, Picture
from entoptic.pipeline.effects.glare import GLARE
from entoptic.pipeline.effects.glare.settings import Edge
from entoptic.pipeline.measure import luminance
from entoptic.pipeline.oracles.point_spread import cie135
from entoptic.pipeline.scenes.image_file import band_solid_angles
from entoptic.pipeline.scenes.panorama import Panorama
from entoptic.pipeline.scenes.scene import Head
from entoptic.pipeline.viewing import prepare
from entoptic.tracker_bridge.wire import Eye

VIEW = View(180, 200, 92.0)
CIE = Glare(model=GlareModel.CIE)
ROWS = 360


def panorama(azimuth_deg: float, cd_m2: float = 2e5) -> Panorama:
    """A dim sky over a darker ground, and a lamp."""
    rgb = np.empty((3, ROWS, 2 * ROWS), np.float32)
    rgb[:, : ROWS // 2], rgb[:, ROWS // 2 :] = 0.3, 0.05
    rgb[:, ROWS // 2 - 4 : ROWS // 2 - 1, round((azimuth_deg / 360 + 0.5) * 2 * ROWS) :][:, :, :3] = cd_m2
    return Panorama(rgb, "sky and ground")


def glared(frame: Frame, settings: Glare) -> Array:
    (eye,) = prepare((viewing(frame, glare=settings),))
    return GLARE.apply(Picture(frame.rgb_cd_m2, frame.rgb_cd_m2), [eye], settings, "quarter", None)


def added(scene: Panorama, head: Head = Head()) -> tuple[Frame, np.ndarray]:  # noqa: B008
    """A frame, and the luminance that glare adds to it."""
    frame = scene.frame(0.0, VIEW, head, (Eye.LEFT,))
    return frame, np.asarray(luminance(glared(frame, CIE)) - luminance(frame.rgb_cd_m2))[0]


def truth(scene: Panorama, at: list[tuple[int, int]]) -> np.ndarray:
    """The sum over all of the panorama of what it scatters to pixels, less what they scatter to it."""
    elevation = math.pi / 2 - (np.arange(ROWS) + 0.5) * math.pi / ROWS
    azimuth = ((np.arange(2 * ROWS) + 0.5) / ROWS - 1) * math.pi
    towards = np.stack(
        np.broadcast_arrays(
            np.sin(azimuth) * np.cos(elevation)[:, None],
            -np.sin(elevation)[:, None],
            np.cos(azimuth) * np.cos(elevation)[:, None],
        )
    ).reshape(3, -1)
    steradians = np.repeat(4 * math.pi * band_solid_angles(ROWS)[:, None] / (2 * ROWS), 2 * ROWS, axis=1).ravel()
    light = scene.rgb_cd_m2[1].astype(np.float64).ravel()
    density = cie135(30.0, 0.5)
    deg = np.concatenate([[0], np.geomspace(1e-5, 90, 20_000)])
    sine = np.sin(np.radians(deg))
    volume = np.trapezoid(2 * math.pi * density(np.maximum(deg, 1e-9)) * sine, np.radians(deg))
    result = []
    for row, column in at:
        here = np.array([(column + 0.5 - VIEW.width_px / 2), (row + 0.5 - VIEW.height_px / 2), VIEW.focal_px])
        here /= np.linalg.norm(here)
        angle = np.degrees(np.arccos(np.clip(here @ towards, -1, 1)))
        own = light[angle.argmin()]
        scattered = np.where((angle < 90) & (angle > 1.0), density(np.maximum(angle, 1e-3)), 0) / volume
        result.append(((light - own) * steradians * scattered).sum())
    return np.array(result)


@pytest.mark.parametrize("azimuth_deg", [49.0, 60.0, 75.0, 150.0])
def test_a_lamp_that_has_left_the_view_veils_it_as_the_sum_over_the_panorama_says(azimuth_deg: float) -> None:
    scene = panorama(azimuth_deg)
    _, veil = added(scene)
    # Where nothing of the view's own is within some degrees: the middle of the sky and of the ground.
    at = [(40, 150), (40, 90), (40, 30), (160, 150), (160, 90)]
    expected = truth(scene, at)
    assert [veil[place] for place in at] == pytest.approx(list(expected), rel=0.06, abs=2e-4)


def test_its_veil_goes_on_smoothly_as_it_leaves_the_view() -> None:
    # The lamp is at 40 degrees; the edge of the view passes it.
    scene = panorama(40.0)
    veils = np.array([added(scene, Head(yaw_deg=yaw))[1][40, 60] for yaw in np.arange(-1.0, -12.0, -0.5)])
    steps = veils[1:] / veils[:-1]
    # Texels here are as large as pixels, and light smeared across the edge is lost on one side of it.
    assert steps.min() > 0.92
    assert steps.max() < 1.09
    assert 0.8 < veils[-1] / veils[0] < 1


def test_an_even_panorama_stays_even() -> None:
    scene = Panorama(np.full((3, 60, 120), 3.5, np.float32), "even")
    frame = scene.frame(0.0, VIEW, Head(20, 30, 40), (Eye.LEFT,))
    np.testing.assert_allclose(added(scene, Head(20, 30, 40))[1], 0, atol=1e-4)
    assert perceive(frame, EyePose(pupil_diameter_mm=5.0)).plan["glare"].level == SKIPPED


@pytest.mark.parametrize(
    ("edge", "least", "most"), [(Edge.AVERAGE, 99.9, 100.1), (Edge.MIRRORED, 99.9, 100.1), (Edge.DARK, 90, 99)]
)
def test_a_wall_is_as_bright_at_its_edges_as_settings_say(edge: Edge, least: float, most: float) -> None:
    frame = Frame.from_rgb(np.full((80, 96, 3), 100.0), 60.0)
    settings = Glare(edge=edge)
    seen = np.asarray(glared(frame, settings))[0, 1]
    assert least < seen[:, 0].min() <= seen.max() < most
    assert seen[40, 48] == pytest.approx(100, rel=0.03)
