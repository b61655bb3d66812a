"""Wave optics over the sphere, written anew: what its light adds up to, and the program's own kernel beside it."""

import math

import numpy as np
import pytest

from entoptic.pipeline.effects.glare.models import wave_component
from entoptic.pipeline.frame import View
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.oracles import sphere, wave_spread

PIXEL_DEG = 1 / 9


def test_it_is_the_kernel_that_the_program_prepares() -> None:
    """Around a light on the axis, from the first pixels to where the veil begins."""
    function = wave_spread.wave(Observer(), Pose(5.0), 24, PIXEL_DEG)
    kernel = np.asarray(wave_component(Observer(), Pose(5.0), 1 / PIXEL_DEG, wavelengths=24).scatters, np.float64)
    middle = kernel.shape[-1] // 2
    row, column = np.indices(kernel.shape[-2:]) - middle
    distance = np.hypot(row, column)
    for first, last in ((2, 4), (8, 12), (20, 24), (26, 30), (34, 39)):
        ring = (distance >= first) & (distance < last)
        angle, azimuth = distance[ring] * PIXEL_DEG, np.arctan2(row[ring], column[ring])
        own = math.radians(PIXEL_DEG) ** 2 * function(angle, azimuth)
        assert np.abs(kernel[:, :, ring] - own).max() < 5e-3 * np.abs(own).max()


def test_its_light_adds_up() -> None:
    """Over rows and columns to 4.5° and rings beyond: each primary's light to 1 in its own channel, to 0 elsewhere."""
    step = 0.05
    function = wave_spread.wave(Observer(), Pose(3.0), 8, step)
    row, column = (np.arange(-100, 101) * step)[:, None], (np.arange(-100, 101) * step)[None, :]
    angle, azimuth = np.hypot(row, column), np.arctan2(row, column) + np.zeros((201, 201))
    inside = math.radians(step) ** 2 * function(angle, azimuth)[:, :, angle < 4.95].sum(axis=-1)
    log_deg = np.linspace(math.log(4.95), math.log(90), 4001)
    deg = np.exp(log_deg)
    ring = 2 * math.pi * np.sin(np.radians(deg)) * function(deg, 0 * deg + 0.3) * np.radians(deg)
    np.testing.assert_allclose(inside + np.trapezoid(ring, log_deg, axis=-1), np.eye(3), atol=5e-3)


def test_a_lamp_on_the_axis_has_the_functions_azimuth() -> None:
    view = View(41, 41, 4.5)
    light = np.zeros((3, 41, 41))
    light[1, 20, 20] = 1e4
    pixel_deg = 1 / view.ppd_centre
    shown = sphere.arrives_directed(light, view, wave_spread.wave(Observer(), Pose(4.0), 8, pixel_deg / 8))
    function = wave_spread.wave(Observer(), Pose(4.0), 8, pixel_deg)
    expected = 1e4 * math.radians(pixel_deg) ** 2 * function(np.array([10 * pixel_deg]), np.array([math.pi / 2]))
    np.testing.assert_allclose(shown[1, 30, 20], expected[1, 1, 0], rtol=0.01)


def test_an_eye_out_of_focus_is_refused() -> None:
    with pytest.raises(ValueError, match="out of focus"):
        wave_spread.wave(Observer(), Pose(4.0, 0.5), 8, 0.1)
