"""The direct sum over the sphere, which judges all else of glare, against printed figures and its own laws."""

import math

import numpy as np
import pytest

from entoptic.pipeline import View
from entoptic.pipeline.oracles import sphere
from entoptic.pipeline.oracles.point_spread import alike, cie135, ijspeert
from entoptic.pipeline.oracles.sphere import Function

CIE = alike(cie135(30.0, 0.5))
TABLE = {
    0.0: (3.1602e-6, (59.316, 3.2031, 0.59929, 0.19235, 0.048403)),
    20.0: (2.6222e-6, (49.218, 2.6579, 0.49727, 0.15961, 0.040164)),
    40.0: (1.4206e-6, (26.664, 1.4399, 0.26940, 0.086469, 0.021759)),
}
"""Of one pixel of 1e6 cd/m² at an azimuth: its solid angle, and the luminance at 1, 3, 6, 10 and 20° towards the
middle, for CIE 135 at 30 years and brown eyes over its volume of 1.03231."""


@pytest.mark.parametrize("azimuth_deg", TABLE)
def test_a_lamp_glares_as_the_function_says_anywhere_in_the_view(azimuth_deg: float) -> None:
    steradians, expected = TABLE[azimuth_deg]
    view = View(1440, 1440, 104.0)
    focal = view.focal_px
    lamp = math.tan(math.radians(azimuth_deg)) * focal
    assert math.cos(math.radians(azimuth_deg)) ** 3 / focal**2 == pytest.approx(steradians, rel=1e-4)
    source = sphere.directions(view, np.array([719.5]), np.array([lamp + 719.5]))
    for deg, cd_m2 in zip((1, 3, 6, 10, 20), expected, strict=True):
        there = math.tan(math.radians(azimuth_deg - deg)) * focal
        away = sphere.angle_deg(source, sphere.directions(view, np.array([719.5]), np.array([there + 719.5])))
        assert away == pytest.approx(deg, rel=1e-9)
        assert 1e6 * steradians * float(CIE.far(away)[0]) == pytest.approx(cd_m2, rel=1e-3)


@pytest.mark.parametrize("at", [(40, 31), (5, 60), (40, 2)])
def test_the_sum_gives_a_single_pixel_that_light(at: tuple[int, int]) -> None:
    view = View(62, 80, 104.0)
    light = np.zeros((3, 80, 62))
    light[1, *at] = 1e3
    shown = sphere.glare(light, view, CIE)
    here = sphere.directions(view, *np.array(at)[:, None])
    rows, columns = np.indices((80, 62)).reshape(2, -1)
    deg = sphere.angle_deg(here, sphere.directions(view, rows, columns)).reshape(80, 62)
    far = np.maximum(np.abs(np.arange(80) - at[0])[:, None], np.abs(np.arange(62) - at[1])) > max(sphere.PARTS)
    expected = 1e3 * sphere.solid_angles(view)[at] * CIE.far(np.maximum(deg, 1e-3).ravel()).reshape(80, 62)
    assert shown[1][far] == pytest.approx(expected[far], rel=2e-3)
    assert not shown[[0, 2]].any()


@pytest.mark.parametrize("function", [CIE, alike(ijspeert(3.0, 30.0, 0.142))])
def test_no_light_is_made_and_none_is_lost_but_over_the_edge(function: Function) -> None:
    view = View(61, 61, 150.0)
    light = np.zeros((3, 61, 61))
    light[:, 30, 30] = 7.0
    steradians = sphere.solid_angles(view)
    shown = (sphere.glare(light, view, function) * steradians).sum(axis=(1, 2))
    sent = (light * steradians).sum(axis=(1, 2))
    assert (shown < sent * 1.002).all()
    assert (shown > 0.95 * sent).all()


def test_a_function_that_scatters_nothing_changes_nothing() -> None:
    light = np.random.default_rng(1).random((3, 20, 30))
    needle = Function(
        lambda deg, azimuth: np.zeros((1, 1, *deg.shape)), np.zeros_like, lambda deg: np.zeros((1, 1, *deg.shape))
    )
    np.testing.assert_array_equal(sphere.glare(light, View(30, 20, 50.0), needle), light)


def test_azimuths_are_carried_as_small_steps_along_the_great_circle_carry_them() -> None:
    end = np.array([0.5, -0.3, 0.0])
    end[2] = math.sqrt(1 - (end**2).sum())
    right = np.array([1.0, 0.0, 0.0])
    for share in np.linspace(0, 1, 4001)[1:]:
        angle = share * math.acos(end[2])
        towards = end[:2] / np.linalg.norm(end[:2]) * math.sin(angle)
        at = np.array([*towards, math.cos(angle)])
        right = right - at * (right @ at)
        right /= np.linalg.norm(right)
    # A direction a little way along it has the azimuth 0.
    ahead = end * math.cos(1e-4) + right * math.sin(1e-4)
    assert float(sphere.azimuth(ahead[:, None], end[:, None])[0]) == pytest.approx(0, abs=1e-3)
