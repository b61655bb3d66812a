import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import Array
from scipy.ndimage import gaussian_filter, map_coordinates

from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, View
from entoptic.pipeline.scenes.night_street import (
    GREEN,
    LAMP_CD_M2,
    MOON,
    MOON_CD_M2,
    MOON_DEG,
    PERIOD_S,
    POST_M,
    PUPIL_DISTANCE_M,
    RED,
    SIGNALS_X_M,
    SIGNALS_Z_M,
    NightStreet,
    _boxes,
    _discs,
    _Lights,
    _lights,
    _lit,
    _posts,
    _silhouettes,
    _street,
)
from entoptic.pipeline.scenes.scene import Head, rays, rotation
from entoptic.pipeline.scenes.street_facades import sky_share
from entoptic.pipeline.scenes.street_patterns import stripes
from entoptic.pipeline.scenes.street_plan import FLOOR_M, LAMPS_M, PARAPET_M, PAVEMENT_M
from entoptic.pipeline.scenes.street_surfaces import surfaces
from entoptic.tracker_bridge.wire import Eye

VIEW = View(241, 241, 104.0)  # square, and with a middle column: one compilation serves all
LOWEST_ROOF_M, HIGHEST_ROOF_M = 3 * FLOOR_M + PARAPET_M, 5 * FLOOR_M + PARAPET_M
MOON_AT = math.degrees(math.atan2(MOON[0], MOON[2])), math.degrees(math.asin(MOON[1]))
MOON_LX = MOON_CD_M2 * math.pi * math.radians(MOON_DEG) ** 2


def street(t_s: float, view: View = VIEW, head: Head = Head(), eye: Eye = Eye.RIGHT) -> np.ndarray:  # noqa: B008
    return np.asarray(NightStreet().frame(t_s, view, head, (eye,)).rgb_cd_m2[0])


def luminance(rgb: np.ndarray) -> np.ndarray:
    return np.tensordot(np.array(LUMINANCE_WEIGHTS), rgb.astype(np.float64), 1)


def solid_angles(view: View) -> np.ndarray:
    x = (np.arange(view.width_px) + 0.5 - view.width_px / 2) / view.focal_px
    y = (np.arange(view.height_px) + 0.5 - view.height_px / 2) / view.focal_px
    return np.asarray((1 + x**2 + y[:, None] ** 2) ** -1.5 / view.focal_px**2)


def flux_around(view: View, head: Head, direction: np.ndarray, t_s: float, radius_px: int) -> float:
    """Illuminance at the eye, lx, of what lies within some pixels of a direction in the world."""
    right, up, forward = direction @ rotation(head)
    x = view.width_px / 2 + view.focal_px * right / forward
    y = view.height_px / 2 - view.focal_px * up / forward
    rows = slice(int(y) - radius_px, int(y) + radius_px + 1)
    columns = slice(int(x) - radius_px, int(x) + radius_px + 1)
    return float((luminance(street(t_s, view, head)) * solid_angles(view))[rows, columns].sum())


@pytest.mark.parametrize("head", [Head(), Head(90, 0, 0), Head(180, -20, 0), Head(0, 90, 0), Head(0, -90, 45)])
def test_every_pixel_is_a_luminance(head: Head) -> None:
    rgb = street(2.5, head=head)
    assert rgb.shape == (3, 241, 241)
    assert rgb.dtype == np.float32
    assert np.isfinite(rgb).all()
    assert rgb.min() >= 0


@given(st.floats(-1e4, 1e4), st.floats(-720, 720), st.floats(-90, 90), st.floats(-720, 720))
def test_any_head_at_any_time_sees_luminances(t_s: float, yaw_deg: float, pitch_deg: float, roll_deg: float) -> None:
    rgb = street(t_s, VIEW, Head(yaw_deg, pitch_deg, roll_deg))
    assert np.isfinite(rgb).all()
    assert rgb.min() > 0
    assert rgb.max() < 1e6


def test_a_head_that_lies_on_its_side_sees_the_same_street_turned() -> None:
    eye = np.float32([0.6, 1.5, 0])
    upright, lying = (
        luminance(np.asarray(_street(6.0, rotation(head), eye, VIEW))[0]) for head in (Head(), Head(0, 0, 90))
    )
    # The right ear goes down, so the picture turns the other way. Within a pixel's edge smoothing may differ.
    same = np.isclose(np.rot90(upright), lying, rtol=0.02)
    assert same.mean() > 0.9995


def test_luminances_are_those_of_a_street_at_night() -> None:
    y = luminance(street(4.2, View(720, 800, 104.0)))
    assert 1e-3 < y.min() < 1e-2  # the darkest sky
    assert 0.05 < np.median(y) < 1  # lamp-lit asphalt and walls
    assert 1e5 < y.max() < 1e6  # full beam
    assert 0.05 < y[700:, 200:500].mean() < 2  # the road before the feet
    assert 1e-3 < y[:100, 300:400].mean() < 0.1  # moonlit sky


def test_nothing_that_lies_behind_is_seen() -> None:
    y = luminance(street(4.2, VIEW, Head(180, 0, 0)))
    assert 0.5 * LAMP_CD_M2 < y.max() < 1.1 * LAMP_CD_M2  # a lamp behind, not the full beam ahead


def test_a_lamp_in_a_narrow_view_has_its_luminance() -> None:
    x, y, z = LAMPS_M[1] - np.float32([0.6, 1.5, 0.0])
    head = Head(math.degrees(math.atan2(x, z)), math.degrees(math.atan2(y, math.hypot(x, z))), 0)
    view = View(180, 200, 1.0)
    lamp = _Lights(*(part[1:2] for part in _lights(np.float32(80), np.float32(20), np.bool_(False))))
    image = _discs(jnp.zeros((3, 200, 180), np.float32), lamp, rotation(head), np.float32([0.6, 1.5, 0.0]), view)
    middle = luminance(np.asarray(image))[80:120, 70:110]
    np.testing.assert_allclose(middle, LAMP_CD_M2, rtol=0.01)


def test_a_post_thinner_than_a_pixel_darkens_by_its_width() -> None:
    # The last row of pixels above the horizon; the post of the lamp 45 m ahead, from the middle to the picture's edge.
    eye = np.float32([0.6, 1.5, 0.0])
    x, _, z = LAMPS_M[3] - eye
    for yaw_deg in (0.0, 6.0, -30.0, 50.0):
        for part in np.arange(0, 1, 0.125):
            axes = rotation(Head(yaw_deg + part / VIEW.ppd_centre, 0, 0))
            hidden = np.asarray(_posts(rays(VIEW, axes), axes, eye, VIEW))[119]
            right, _, forward = np.float32([x, 0, z]) @ axes
            at = int(VIEW.width_px / 2 + VIEW.focal_px * right / forward)
            width_px = POST_M / math.hypot(x, z) * VIEW.focal_px * (1 + (right / forward) ** 2)
            assert hidden[at - 3 : at + 4].sum() == pytest.approx(width_px, rel=0.005)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_signals_post_thinner_than_a_pixel_darkens_by_its_width(side: int) -> None:
    eye, behind = np.float32([0.6, 1.5, 0.0]), np.float32(-10)  # both cars
    at = (side * SIGNALS_X_M - eye[0]) / (SIGNALS_Z_M + 0.05)
    for yaw_deg in (0.0, -25.0, 25.0, side * 40.0):
        for part in np.arange(0, 1, 0.125):
            yaw = math.radians(yaw_deg + part / VIEW.ppd_centre)
            axes = rotation(Head(math.degrees(yaw), 0, 0))
            row = np.asarray(_boxes(rays(VIEW, axes), axes, eye, behind, behind, VIEW))[120]
            forward = at * math.sin(yaw) + math.cos(yaw)
            column = int(VIEW.width_px / 2 + VIEW.focal_px * (at * math.cos(yaw) - math.sin(yaw)) / forward)
            width_px = 0.1 / (SIGNALS_Z_M + 0.05) * VIEW.focal_px / forward**2
            assert row[column - 3 : column + 4].sum() == pytest.approx(width_px, rel=0.005)


@pytest.mark.parametrize(("fov_deg", "head"), [(104.0, Head()), (104.0, Head(-30, 0, 20)), (40.0, Head())])
def test_nothing_far_away_shimmers(fov_deg: float, head: Head) -> None:
    """The light around each direction, seen through a Gaussian of two pixels, as the head moves by parts of a pixel."""
    view = View(241, 241, fov_deg)
    eye, size, middle = np.float32([0.6, 1.5, 0.0]), 241, 241 / 2 - 0.5
    directions = np.asarray(rays(view, rotation(head)), np.float64)
    to_ground = np.where(directions[1] < 0, -1.5 / np.minimum(directions[1], -1e-9), np.inf)
    to_wall = (PAVEMENT_M - np.sign(directions[0]) * 0.6) / np.maximum(np.abs(directions[0]), 1e-9)
    distance = np.minimum(to_ground, to_wall) * np.linalg.norm(directions, axis=0)
    seen = []
    for part in np.arange(0, 1, 0.2):
        moved = Head(
            head.yaw_deg + part / view.ppd_centre, head.pitch_deg + 2.3 * part / view.ppd_centre, head.roll_deg
        )
        axes = rotation(moved)
        image = luminance(np.asarray(surfaces(axes, eye, np.float32(1e3), np.float32(0), view)))
        right, up, forward = np.tensordot(axes.T.astype(np.float64), directions, 1)
        places = middle - view.focal_px * up / forward, middle + view.focal_px * right / forward
        seen.append(map_coordinates(gaussian_filter(image, 2.0), places, mode="nearest"))
    spread = np.ptp(seen, axis=0) / np.mean(seen, axis=0)
    inside = np.zeros((size, size), bool)
    inside[8:-8, 8:-8] = True
    far = spread[inside & (distance > 40)]
    assert np.percentile(far, 95) < 0.08
    assert np.percentile(far, 99) < 0.2
    assert far.max() < 0.4


@given(st.floats(-50, 50), st.floats(0.01, 30))
def test_stripes_are_averaged_over_a_footprint_of_any_size(at: float, footprint: float) -> None:
    inside = (np.linspace(at - footprint / 2, at + footprint / 2, 20001) - 0.5) % 8.0 < 3.0
    share = float(stripes(np.float32(at), 8.0, 0.5, 3.0, np.float32(footprint)))
    assert share == pytest.approx(inside.mean(), abs=2e-3)


def test_buildings_hide_the_sky_up_to_their_roofs() -> None:
    elevation = np.radians(np.arange(91))
    across, along = np.cos(elevation) * math.cos(0.3), np.cos(elevation) * math.sin(0.3)
    for x, z in ((across, along), (-across, along), (across, -along), (-across, -along)):
        rays_there, eye = np.float32([x, np.sin(elevation), z]), np.float32([0.0, 1.5, 0.0])
        share = np.asarray(sky_share(rays_there, rotation(Head()), eye, View(2410, 2410, 104.0)))
        assert (np.diff(share) >= 0).all()
        assert share[(elevation < math.atan2(LOWEST_ROOF_M - 1.6, 8 / math.cos(0.3)))].max() == 0
        assert share[(elevation > math.atan2(HIGHEST_ROOF_M - 1.4, 8 / math.cos(0.3)))].min() == 1


def test_the_sky_straight_ahead_has_no_seam() -> None:
    # The middle column of an odd view looks along the street, at neither side of it.
    y = luminance(street(0.0))[2:72, 119:122]
    assert (y[:, 1] > 0.98 * y[:, [0, 2]].min(axis=1)).all()  # a neighbour may hold a star


def test_frames_are_the_same_in_any_order() -> None:
    first = street(1.0)
    street(7.7, head=Head(20, 5, 1))
    np.testing.assert_array_equal(street(1.0), first)


def test_eyes_stand_apart_to_the_sides_of_the_head() -> None:
    frame = NightStreet().frame(6.5, VIEW, Head(), (Eye.RIGHT, Eye.LEFT))
    right, left = (luminance(np.asarray(image)) for image in frame.rgb_cd_m2)
    # Headlights at 15.5 m move by f·b/z between the eyes.
    columns = np.arange(VIEW.width_px) + 0.5
    lights = [(np.where(y > 500, y, 0)[107:137].sum(axis=0) * columns)[:115] for y in (left, right)]
    weights = [np.where(y > 500, y, 0)[107:137].sum(axis=0)[:115] for y in (left, right)]
    at_left, at_right = (float(place.sum() / weight.sum()) for place, weight in zip(lights, weights, strict=True))
    assert at_left - at_right == pytest.approx(VIEW.focal_px * PUPIL_DISTANCE_M / 15.5, abs=0.15)


def test_the_moon_keeps_its_light_when_the_head_moves_by_parts_of_a_pixel() -> None:
    pixel_deg = 1 / VIEW.ppd_centre
    fluxes = [
        flux_around(VIEW, Head(MOON_AT[0] + part * pixel_deg, MOON_AT[1] + part * pixel_deg / 3, 0), MOON, 0.0, 5)
        for part in np.arange(0, 1, 0.1)
    ]
    assert max(fluxes) / min(fluxes) < 1.01
    assert np.mean(fluxes) == pytest.approx(MOON_LX, rel=0.01)


@pytest.mark.parametrize("away_deg", [0.0, 20.0, 40.0])
def test_the_moon_keeps_its_light_off_the_middle(away_deg: float) -> None:
    view = View(720, 800, 104.0)
    flux = flux_around(view, Head(MOON_AT[0] + away_deg, MOON_AT[1] - 5, 0), MOON, 0.0, 14)
    assert flux == pytest.approx(MOON_LX, rel=0.05)


def test_headlights_smaller_than_a_pixel_do_not_flicker() -> None:
    oncoming = np.array([-2.6, -0.82, 48.0])  # full beam at 4.0 s, two discs of half a pixel
    pixel_deg = 1 / VIEW.ppd_centre
    fluxes = [
        flux_around(VIEW, Head(part * pixel_deg, 0, 0), oncoming / np.linalg.norm(oncoming), 4.0, 7)
        for part in np.arange(0, 1, 0.1)
    ]
    assert max(fluxes) / min(fluxes) < 1.01


def test_the_oncoming_car_comes_without_a_jump_and_repeats() -> None:
    ahead = np.array([-0.03, -0.01, 1.0])
    at_end, at_start = (flux_around(VIEW, Head(), ahead, t_s, 20) for t_s in (PERIOD_S - 1e-3, PERIOD_S + 1e-3))
    later = flux_around(VIEW, Head(), ahead, PERIOD_S + 3.9, 20)
    assert at_start == pytest.approx(at_end, rel=0.02)
    assert later > 1.2 * at_start
    # Two periods bring the other car back as well.
    np.testing.assert_allclose(street(3.0 + 2 * PERIOD_S), street(3.0), rtol=1e-4, atol=1e-4)


def test_signals_have_their_chromaticities() -> None:
    rgb = street(0.0, View(720, 800, 104.0))
    y = luminance(rgb)
    for colour, channel in ((RED, 0), (GREEN, 1)):
        match = rgb[channel] / np.maximum(y, 1e-9)
        bright = (y > 1000) & (np.abs(match / colour[channel] - 1) < 0.02)
        assert bright.any()


def test_every_number_of_a_pixel_is_float32() -> None:
    """One constant of NumPy's float64 would make all that it meets twice as slow."""
    eye = np.float32([0.6, 1.5, 0.0])

    def computed(axes: np.ndarray) -> Array:
        hidden = _silhouettes(axes, eye, np.float32(40), np.float32(20), VIEW)
        image = surfaces(axes, eye, np.float32(40), hidden, VIEW)
        return _lit(image, axes, eye, np.float32(40), np.float32(20), np.bool_(True), VIEW)

    assert "f32[241,241]" in (traced := str(jax.make_jaxpr(computed)(rotation(Head(3, 2, 1)))))
    assert "f64[241,241]" not in traced
