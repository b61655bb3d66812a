"""The direct sum over the sphere: published numbers, and what must hold of any sum of this kind."""

import math

import numpy as np
import pytest

from entoptic.pipeline.frame import View
from entoptic.pipeline.oracles import point_spread, sphere

CIE = point_spread.cie135(30, 0.5)
DISTANCES_DEG = (1, 3, 6, 10, 20)
LAMP_CD_M2 = 1e6
PUBLISHED = {
    0: (3.1602e-6, (59.316, 3.2031, 0.59929, 0.19235, 0.048403)),
    20: (2.6222e-6, (49.218, 2.6579, 0.49727, 0.15961, 0.040164)),
    40: (1.4206e-6, (26.664, 1.4399, 0.26940, 0.086469, 0.021759)),
}
"""By the lamp's azimuth: its pixel's solid angle, and what it brings so far towards the middle, in cd/m²."""


def lamp(view: View, row: int, column: int) -> np.ndarray:
    light = np.zeros((3, view.height_px, view.width_px))
    light[:, row, column] = LAMP_CD_M2
    return light


@pytest.mark.parametrize("azimuth_deg", PUBLISHED)
def test_a_lamp_of_one_pixel_brings_what_is_published(azimuth_deg: int) -> None:
    view = View(1440, 3, 104.0)
    solid_angle, expected = PUBLISHED[azimuth_deg]
    place = (1, int(view.pixel_of(azimuth_deg, 0)[0]))
    there = sphere.directions(view)[place]
    shown = sphere.arrives(lamp(view, *place), view, CIE)[1, 1]
    angles = np.degrees(2 * np.arcsin(np.linalg.norm(sphere.directions(view)[1] - there, axis=1) / 2))
    inwards = np.flatnonzero((np.arange(1440) < place[1]) & (angles > 0.8) & (angles < 25))[::-1]
    read_off = np.exp(np.interp(np.log(DISTANCES_DEG), np.log(angles[inwards]), np.log(shown[inwards])))
    # Not the azimuth itself but the nearest pixel's middle; and the pixel has a width, which counts up to 3°.
    of_pixel = sphere.solid_angles(view)[place]
    assert of_pixel == pytest.approx(solid_angle, rel=2e-3)
    where, step = np.array(DISTANCES_DEG, np.float64), 0.01
    curved = (CIE(where + step) - 2 * CIE(where) + CIE(where - step)) / step**2
    sloping = (CIE(where + step) - CIE(where - step)) / (2 * step * where)
    wide = 1 + of_pixel * math.degrees(1) ** 2 / 24 * (curved + sloping) / CIE(where)
    np.testing.assert_allclose(read_off * solid_angle / of_pixel / wide, expected, rtol=1e-3)


@pytest.mark.parametrize(
    "density",
    [
        *(point_spread.cie135(age, pigmentation) for age in (20, 80) for pigmentation in (0.0, 1.2)),
        *(point_spread.ijspeert(pupil_mm, 30, 0.142) for pupil_mm in (2.0, 8.0)),
        *(point_spread.spe(adaptation) for adaptation in point_spread.SPE_WEIGHTS),
    ],
)
def test_a_function_carries_all_light_within_the_hemisphere(density: point_spread.Density) -> None:
    """By another rule than the one that scales it: even steps in the logarithm of the angle."""
    log_deg = np.linspace(math.log(1e-6), math.log(90), 200_001)
    deg = np.exp(log_deg)
    ring = 2 * math.pi * np.sin(np.radians(deg)) * density(deg) * np.radians(deg)
    assert np.trapezoid(ring, log_deg) == pytest.approx(1, abs=1e-6)


def test_functions_as_printed_have_the_volumes_that_the_papers_leave_them() -> None:
    """CIE 135 at 30 years with brown eyes 1.03231; IJspeert's 1 whatever the pupil."""
    middle = np.array([0.0])
    printed = (1 - 0.08 * (3 / 7) ** 4) * (9.2e6 + 1.5e5) + (1 + 1.6 * (3 / 7) ** 4) * (400 + 0.5 * 1300.8) + 1.25e-3
    assert printed / CIE(middle)[0] == pytest.approx(1.03231, abs=1e-5)


@pytest.mark.parametrize("view", [View(41, 33, 6.0), View(40, 40, 104.0)])
@pytest.mark.parametrize("row_column", [(0, 0), (20, 20), (12, 31)])
def test_what_stays_in_a_pixel_is_what_a_dense_sum_over_its_area_gives(view: View, row_column: tuple[int, int]) -> None:
    def density(deg: np.ndarray) -> np.ndarray:
        return point_spread.ijspeert(3.0, 30, 0.142)(np.hypot(deg, 0.5))

    place = np.array([row_column])
    where, weights = sphere._nodes(view, place, 32)
    middle = sphere.directions(view)[row_column]
    angles = np.degrees(2 * np.arcsin(np.linalg.norm(where - middle, axis=-1) / 2))
    dense = float((density(angles) * weights).sum())
    assert sphere.own_share(view, density, place)[0] == pytest.approx(dense, rel=1e-5)


def test_a_narrow_function_loses_no_light() -> None:
    """Of one that no view's edge cuts, all that leaves a pixel arrives at others, at 10 and at 0.3 a pixel."""
    for view, reach_deg in ((View(61, 61, 6.1), 0.5), (View(61, 61, 60.0), 1.0), (View(61, 61, 104.0), 0.4)):

        def density(deg: np.ndarray, width: float = reach_deg) -> np.ndarray:
            bell = np.exp(-((deg / width) ** 2))
            return bell / (math.pi * math.radians(width) ** 2)

        for row, column in ((30, 30), (30, 44), (20, 38)):
            light = lamp(view, row, column)
            before, after = (
                float((image[0] * sphere.solid_angles(view)).sum())
                for image in (light, sphere.glare(light, view, density))
            )
            assert after == pytest.approx(before, rel=0.02)


def test_what_a_frame_loses_is_what_leaves_it() -> None:
    """A lamp in the middle of a frame of 20°: with CIE, what falls outside a square of that width."""
    view = View(101, 101, 20.0)
    light = lamp(view, 50, 50)
    kept = float((sphere.glare(light, view, CIE)[0] * sphere.solid_angles(view)).sum())
    kept /= LAMP_CD_M2 * float(sphere.solid_angles(view)[50, 50])
    assert kept == pytest.approx(float(sphere.own_share(View(1, 1, 20.0), CIE)[0]), abs=2e-4)


def test_an_even_field_shows_itself_but_for_the_dark_around() -> None:
    view = View(24, 24, 60.0)
    density = point_spread.ijspeert(4.0, 30, 0.142)
    shown = sphere.glare(np.ones((3, 24, 24)), view, density)
    middle = float(sphere.own_share(View(1, 1, 60.0), density)[0])
    assert shown[1, 11:13, 11:13].mean() == pytest.approx(middle, rel=2e-3)
    assert shown.max() < 1


def test_two_places_bring_each_other_the_same_for_each_steradian() -> None:
    view = View(60, 50, 90.0)
    solid_angles = sphere.solid_angles(view)
    for a, b in (((3, 4), (40, 51)), ((25, 30), (27, 33)), ((0, 0), (0, 59))):
        there = sphere.glare(lamp(view, *a), view, CIE, np.array([b]))[0, 0] / solid_angles[a]
        back = sphere.glare(lamp(view, *b), view, CIE, np.array([a]))[0, 0] / solid_angles[b]
        assert there == pytest.approx(back, rel=1e-2)


def test_mirrored_light_makes_a_mirrored_image_and_places_are_as_the_whole() -> None:
    view = View(21, 17, 80.0)
    light = np.random.default_rng(4).random((3, 17, 21))
    whole = sphere.glare(light, view, CIE)
    np.testing.assert_allclose(sphere.glare(light[:, ::-1, ::-1], view, CIE), whole[:, ::-1, ::-1], rtol=1e-9)
    places = np.array([[0, 0], [5, 20], [16, 3]])
    np.testing.assert_allclose(sphere.glare(light, view, CIE, places), whole[:, places[:, 0], places[:, 1]], rtol=1e-9)


def test_a_function_without_azimuth_is_the_same_as_one_that_has_it() -> None:
    view = View(15, 11, 50.0)
    light = np.random.default_rng(5).random((3, 11, 15))

    def density(deg: np.ndarray) -> np.ndarray:
        return point_spread.spe("photopic")(deg + 0.3)

    def directed(deg: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
        return np.eye(3)[:, :, None, None] * density(deg)

    direct = sphere.arrives_directed(light, view, directed, origin_deg=(8.0, -5.0), nodes=20)
    np.testing.assert_allclose(direct, sphere.arrives(light, view, density), rtol=1e-3)


def test_at_the_axis_azimuth_is_that_of_rows_and_columns() -> None:
    ahead = np.array([[[0.0, 0.0, 1.0]]])
    towards = np.array([[0.1, 0.0, 1.0], [0.0, 0.2, 1.0], [-0.1, -0.1, 1.0]])
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    _, azimuth = sphere.angle_and_azimuth(ahead, towards)
    np.testing.assert_allclose(azimuth[0], [0, math.pi / 2, -3 * math.pi / 4], atol=1e-12)


def test_transport_is_what_small_steps_along_the_great_circle_come_to() -> None:
    start, end = np.array([0.0, 0.0, 1.0]), np.array([0.7, -0.4, 0.59161])
    end /= np.linalg.norm(end)
    carried = np.array([0.6, 0.8, 0.0])
    span = math.acos(start @ end)
    for turn in np.linspace(0, span, 20_001)[1:]:
        here = (math.sin(span - turn) * start + math.sin(turn) * end) / math.sin(span)
        carried = carried - (carried @ here) * here
        carried /= np.linalg.norm(carried)
    np.testing.assert_allclose(sphere.transported(np.array([0.6, 0.8, 0.0]), start, end), carried, atol=1e-4)


def test_a_chord_of_the_stereographic_plane_lies_between_the_azimuths_at_its_ends() -> None:
    """The plane is conformal and its axes are carried ones; a great circle is an arc there, its chord halfway."""
    generator = np.random.default_rng(6)
    for origin_deg in ((0.0, 0.0), (25.0, 10.0)):
        right, down = sphere.frame_at(_direction(*origin_deg), origin_deg)
        for _ in range(20):
            a, b = (_direction(*generator.uniform(-50, 50, 2)) for _ in range(2))
            plane = [2 * np.array([p @ right, p @ down]) / (1 + p @ _direction(*origin_deg)) for p in (a, b)]
            chord = math.atan2(*(plane[1] - plane[0])[::-1])
            _, there = sphere.angle_and_azimuth(a[None, None], b[None], origin_deg)
            _, back = sphere.angle_and_azimuth(b[None, None], a[None], origin_deg)
            turns = [math.remainder(turn - chord, 2 * math.pi) for turn in (there[0, 0], back[0, 0] + math.pi)]
            assert turns[0] + turns[1] == pytest.approx(0, abs=1e-9)


def _direction(azimuth_deg: float, elevation_deg: float) -> np.ndarray:
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    across = math.cos(elevation)
    return np.array([math.sin(azimuth) * across, -math.sin(elevation), math.cos(azimuth) * across])
