import math

import numpy as np
import pytest

from pipeline.frame import LUMINANCE_WEIGHTS, View
from pipeline.scenes.night_street import (
    GREEN,
    MOON,
    MOON_CD_M2,
    MOON_DEG,
    PERIOD_S,
    PUPIL_DISTANCE_M,
    RED,
    NightStreet,
)
from pipeline.scenes.scene import Head, rotation
from tracker_bridge.wire import Eye

VIEW = View(240, 268, 104.0)
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
    assert rgb.shape == (3, 268, 240)
    assert rgb.dtype == np.float32
    assert np.isfinite(rgb).all()
    assert rgb.min() >= 0


def test_luminances_are_those_of_a_street_at_night() -> None:
    y = luminance(street(4.2, View(720, 800, 104.0)))
    assert 1e-3 < y.min() < 1e-2  # the darkest sky
    assert 0.05 < np.median(y) < 1  # lamp-lit asphalt and walls
    assert 1e5 < y.max() < 1e6  # full beam
    assert 0.05 < y[700:, 200:500].mean() < 2  # the road before the feet
    assert 1e-3 < y[:100, 300:400].mean() < 0.1  # moonlit sky


def test_the_sky_straight_ahead_has_no_seam() -> None:
    # The middle column of an odd view looks along the street, at neither side of it.
    y = luminance(street(0.0, View(61, 67, 104.0)))[2:22, 29:32]
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
    lights = [(np.where(y > 500, y, 0)[120:150].sum(axis=0) * columns)[:115] for y in (left, right)]
    weights = [np.where(y > 500, y, 0)[120:150].sum(axis=0)[:115] for y in (left, right)]
    at_left, at_right = (float(place.sum() / weight.sum()) for place, weight in zip(lights, weights, strict=True))
    assert at_left - at_right == pytest.approx(VIEW.focal_px * PUPIL_DISTANCE_M / 15.5, abs=0.15)


def test_the_moon_keeps_its_light_when_the_head_moves_by_parts_of_a_pixel() -> None:
    pixel_deg = 1 / VIEW.ppd_centre
    fluxes = [
        flux_around(VIEW, Head(MOON_AT[0] + part * pixel_deg, MOON_AT[1] + part * pixel_deg / 3, 0), MOON, 0.0, 8)
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
