import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from entoptic.pipeline.frame import View
from entoptic.pipeline.scenes.image_file import band_solid_angles, read
from entoptic.pipeline.scenes.panorama import Panorama, prepare
from entoptic.pipeline.scenes.scene import Head, rotation
from entoptic.tracker_bridge.wire import Eye

ONE_EYE = (Eye.LEFT,)


def seen(panorama: Panorama, view: View, head: Head) -> np.ndarray:
    return np.asarray(panorama.frame(0.0, view, head, ONE_EYE).rgb_cd_m2[0], np.float64)


def solid_angles(view: View) -> np.ndarray:
    """Of each pixel of a view, sr."""
    x = (np.arange(view.width_px) + 0.5 - view.width_px / 2) / view.focal_px
    y = (np.arange(view.height_px) + 0.5 - view.height_px / 2) / view.focal_px
    return np.asarray((1 + x**2 + y[:, None] ** 2) ** -1.5 / view.focal_px**2)


def one_texel(rows: int, azimuth_deg: float, elevation_deg: float) -> tuple[np.ndarray, float, float, float]:
    """A black panorama with one texel of 1e6 cd/m²; where its middle is; its illuminance over the sphere, lx."""
    row, column = int((0.5 - elevation_deg / 180) * rows), int((0.5 + azimuth_deg / 360) * 2 * rows)
    rgb = np.zeros((3, rows, 2 * rows), np.float32)
    rgb[:, row, column] = 1e6
    azimuth, elevation = ((column + 0.5) / rows - 1) * 180, (0.5 - (row + 0.5) / rows) * 180
    return rgb, azimuth, elevation, 1e6 * band_solid_angles(rows)[row] * 4 * math.pi / (2 * rows)


@pytest.mark.parametrize("head", [Head(), Head(180, 0, 0), Head(77, 88, 12), Head(-30, -90, 0)])
def test_constant_panorama_is_constant_everywhere(head: Head) -> None:
    panorama = Panorama(np.full((3, 60, 120), 3.5, np.float32), "constant")
    np.testing.assert_allclose(seen(panorama, View(80, 90, 104.0), head), 3.5, rtol=2e-6)


@pytest.mark.parametrize("fov_deg", [60.0, 104.0])
@pytest.mark.parametrize(
    "head", [Head(), Head(20, 0, 0), Head(0, -15, 0), Head(10, 10, 0), Head(5, -5, 40), Head(365, 0, -10)]
)
def test_bright_texel_lands_on_its_direction(head: Head, fov_deg: float) -> None:
    rgb, azimuth, elevation, _ = one_texel(180, 14.0, 9.0)
    view = View(200, 220, fov_deg)
    image = seen(Panorama(rgb, "sun"), view, head)[1]
    y, x = np.mgrid[: view.height_px, : view.width_px] + 0.5
    centroid = ((image * x).sum() / image.sum(), (image * y).sum() / image.sum())
    world = np.array(
        [
            math.sin(math.radians(azimuth)) * math.cos(math.radians(elevation)),
            math.sin(math.radians(elevation)),
            math.cos(math.radians(azimuth)) * math.cos(math.radians(elevation)),
        ]
    )
    right, up, forward = world @ rotation(head)
    turned = math.degrees(math.atan2(right, forward)), math.degrees(math.atan2(up, math.hypot(right, forward)))
    assert centroid == pytest.approx(view.pixel_of(*turned), abs=0.3)


def test_a_whole_turn_is_none() -> None:
    rgb = np.random.default_rng(0).uniform(0, 1, (3, 64, 128)).astype(np.float32)
    panorama, view = Panorama(rgb, "noise"), View(90, 100, 104.0)
    np.testing.assert_allclose(
        seen(panorama, view, Head(375, 4, 2)), seen(panorama, view, Head(15, 4, 2)), rtol=1e-4, atol=1e-5
    )


def test_there_is_no_seam_behind() -> None:
    azimuth = (np.arange(256) + 0.5) / 256 * 2 * np.pi
    wave = np.broadcast_to((2 + np.cos(azimuth - 1)).astype(np.float32), (3, 128, 256))
    image = seen(Panorama(np.ascontiguousarray(wave), "wave"), View(201, 101, 60.0), Head(180, 0, 0))
    steps = np.diff(image[0, 50])
    assert np.abs(np.diff(steps)).max() < 1e-3  # a wave has no kink


@pytest.mark.parametrize("rows", [90, 64, 30])
def test_light_stays_when_a_panorama_is_prepared(rows: int) -> None:
    rgb = np.random.default_rng(2).lognormal(0, 2, (3, 90, 180)).astype(np.float32)
    texels, counts = (np.asarray(part) for part in prepare(rgb, rows))
    means = np.stack([texels[:, row, 1 : 1 + count].mean(axis=1) for row, count in enumerate(counts)], axis=1)
    np.testing.assert_allclose(
        means @ band_solid_angles(rows), rgb.mean(axis=2, dtype=np.float64) @ band_solid_angles(90), rtol=2e-4
    )


@pytest.mark.parametrize("rows", [128, 300, 1024])
@pytest.mark.parametrize("elevation_deg", [2.0, 40.0, 75.0])
def test_one_texel_keeps_its_light_within_4_percent_wherever_the_head_turns(rows: int, elevation_deg: float) -> None:
    rgb, azimuth, elevation, lux = one_texel(rows, 40.0, elevation_deg)
    panorama, view = Panorama(rgb, "sun"), View(180, 200, 104.0)
    random = np.random.default_rng(1)
    for _ in range(25):
        yaw, pitch, roll = random.uniform(-30, 30, 3)
        image = seen(panorama, view, Head(azimuth + yaw, elevation + pitch, roll))
        assert (image[1] * solid_angles(view)).sum() == pytest.approx(lux, rel=0.04)


def test_both_eyes_see_the_same_and_time_changes_nothing() -> None:
    rgb = np.random.default_rng(0).uniform(0, 1, (3, 16, 32)).astype(np.float32)
    panorama, view = Panorama(rgb, "noise"), View(20, 24, 90.0)
    both = np.asarray(panorama.frame(0.0, view, Head(5, 5, 5), (Eye.RIGHT, Eye.LEFT)).rgb_cd_m2)
    again = np.asarray(panorama.frame(9.0, view, Head(5, 5, 5), (Eye.LEFT,)).rgb_cd_m2)
    assert both.shape == (2, 3, 24, 20)
    assert both.dtype == np.float32
    np.testing.assert_array_equal(both[0], both[1])
    np.testing.assert_array_equal(both[:1], again)


@pytest.mark.shared_data
def test_the_real_sun_keeps_its_light_within_1_percent(shared: Callable[[str], Path]) -> None:
    file = read(shared("hdr/pmndrs_sunrise.hdr"))
    sun = np.where(file.rgb[1] > 1e3, file.rgb, 0)
    row, column = np.unravel_index(sun[1].argmax(), sun[1].shape)
    azimuth, elevation = ((column + 0.5) / 512 - 1) * 180, (0.5 - (row + 0.5) / 512) * 180
    lux = float(sun[1].sum(axis=1, dtype=np.float64) @ band_solid_angles(512)) * 4 * math.pi / 1024
    panorama, view = Panorama(sun, "sun"), View(720, 800, 104.0)
    random = np.random.default_rng(1)
    for _ in range(12):
        yaw, pitch, roll = random.uniform(-30, 30, 3)
        image = seen(panorama, view, Head(azimuth + yaw, elevation + pitch, roll))
        assert (image[1] * solid_angles(view)).sum() == pytest.approx(lux, rel=0.01)


@pytest.mark.shared_data
def test_the_six_faces_of_a_cube_hold_the_light_of_the_whole_sphere(shared: Callable[[str], Path]) -> None:
    file = read(shared("hdr/pmndrs_studio.hdr"))
    panorama, view = Panorama(file.rgb, "studio"), View(256, 256, 90.0)
    heads = [Head(yaw, 0, 0) for yaw in (0, 90, 180, 270)] + [Head(0, 90, 0), Head(0, -90, 0)]
    total = sum((seen(panorama, view, head) * solid_angles(view)).sum(axis=(1, 2)) for head in heads)
    expected = file.rgb.mean(axis=2, dtype=np.float64) @ band_solid_angles(512) * 4 * math.pi
    np.testing.assert_allclose(total, expected, rtol=0.005)
