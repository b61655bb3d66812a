"""What is bleached, where, and how it comes back."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from entoptic.pipeline.effects.afterimage import HALF_TD, TAU_S, Afterimage, Retina, geometry, rested, step
from entoptic.pipeline.effects.afterimage.retina import cone_matrix, low_resolution
from entoptic.pipeline.frame import View

VIEW = View(180, 150, 80.0)
SETTINGS = Afterimage(on=True, cell_deg=1.5)
MIDDLE = (90.0, 75.0)
PUPIL_MM = 4.0
AREA_MM2 = math.pi * 4


def wall(cd_m2: float, view: View = VIEW) -> jnp.ndarray:
    return jnp.full((3, view.height_px, view.width_px), cd_m2, jnp.float32)


def lamp(cd_m2: float, x: int, y: int, half: int = 12) -> jnp.ndarray:
    image = np.full((3, VIEW.height_px, VIEW.width_px), 1.0, np.float32)
    image[:, y - half : y + half, x - half : x + half] = cd_m2
    return jnp.asarray(image)


def after(
    retina: Retina,
    image: jnp.ndarray,
    dt_s: float,
    gaze_px: tuple[float, float] = MIDDLE,
    openness: float = 1.0,
    pupil_diameter_mm: float = PUPIL_MM,
    view: View = VIEW,
) -> Retina:
    return step(
        retina, image, view, gaze_px, pupil_diameter_mm=pupil_diameter_mm, openness=openness, dt_s=dt_s, exposure=0.01
    )


def fovea(retina: Retina) -> np.ndarray:
    """Bleached share of the three kinds of cones in the middle of the map."""
    middle = retina.bleached.shape[1] // 2
    return np.asarray(retina.bleached[:, middle, middle], np.float64)


def test_the_half_bleaching_light_bleaches_half() -> None:
    white = wall(HALF_TD / AREA_MM2)
    np.testing.assert_allclose(fovea(after(rested(SETTINGS), white, 1e9)), 0.5, rtol=1e-5)


@pytest.mark.parametrize("seconds", [0.04, 1.0, 30.0, 600.0])
@pytest.mark.parametrize("relative", [1e-3, 1.0, 1e3])
def test_bleaching_takes_the_closed_form(seconds: float, relative: float) -> None:
    retina = after(rested(SETTINGS), wall(relative * HALF_TD / AREA_MM2), seconds)
    expected = relative / (1 + relative) * -math.expm1(-seconds * (1 + relative) / TAU_S)
    np.testing.assert_allclose(fovea(retina), expected, rtol=1e-5)


def test_a_short_flash_bleaches_by_its_energy() -> None:
    """1 − exp(−I·t/Q), Q = τ·I0 = 10^6.34 td·s: CVRL's second formula, 10^6.4 td·s of them."""
    assert math.log10(TAU_S * HALF_TD) == pytest.approx(6.4, abs=0.1)
    trolands, seconds = 1e8, 1e-2
    retina = after(rested(SETTINGS), wall(trolands / AREA_MM2), seconds)
    np.testing.assert_allclose(fovea(retina), -math.expm1(-trolands * seconds / (TAU_S * HALF_TD)), rtol=1e-3)


def test_pigment_comes_back_exponentially_to_the_end() -> None:
    bleached = after(rested(SETTINGS), wall(1e6), 60.0)
    for seconds in (1.0, TAU_S, 10 * TAU_S):
        expected = fovea(bleached) * math.exp(-seconds / TAU_S)
        np.testing.assert_allclose(fovea(after(bleached, wall(0.0), seconds)), expected, rtol=1e-5, atol=1e-7)
    assert not np.asarray(after(bleached, wall(0.0), 1e9).bleached).any()


def test_two_half_steps_are_one() -> None:
    image = lamp(1e5, 90, 75)
    once = after(rested(SETTINGS), image, 3.0)
    twice = after(after(rested(SETTINGS), image, 1.2), image, 1.8)
    np.testing.assert_allclose(once.bleached, twice.bleached, rtol=3e-6, atol=1e-9)


@pytest.mark.parametrize("dt_s", [0.0, -1.0, -1e9])
def test_time_that_stands_still_or_goes_back_changes_nothing(dt_s: float) -> None:
    bleached = after(rested(SETTINGS), wall(1e6), 5.0)
    np.testing.assert_array_equal(after(bleached, wall(1e9), dt_s).bleached, bleached.bleached)


@pytest.mark.parametrize("dt_s", [0.0, 1e-9, 1 / 24, 1e9, 1e30])
@pytest.mark.parametrize("cd_m2", [0.0, 1e-6, 1e9, 1e30])
def test_it_stays_a_share_for_any_light_and_time(dt_s: float, cd_m2: float) -> None:
    for start in (0.0, 1.0):
        before = Retina(jnp.full((3, 101, 101), start, jnp.float32), 0.01)
        bleached = np.asarray(after(before, lamp(cd_m2, 90, 75), dt_s).bleached)
        assert np.isfinite(bleached).all()
        assert 0 <= bleached.min() <= bleached.max() <= 1


def test_ten_thousand_frames_end_where_the_closed_form_does() -> None:
    relative, small = 0.5, View(12, 10, 60.0)
    image, start = wall(relative * HALF_TD / AREA_MM2, small), rested(Afterimage(cell_deg=5.0)).bleached

    def one(_: int, bleached: jax.Array) -> jax.Array:
        return after(Retina(bleached, 0.01), image, 1 / 24, (6.0, 5.0), view=small).bleached

    retina = Retina(jax.lax.fori_loop(0, 10_000, one, start), 0.01)
    expected = relative / (1 + relative) * -math.expm1(-10_000 / 24 * (1 + relative) / TAU_S)
    np.testing.assert_allclose(fovea(retina), expected, rtol=1e-5)


def test_no_light_comes_through_closed_lids_and_bleaching_outlasts_a_blink() -> None:
    bleached = after(rested(SETTINGS), lamp(1e5, 90, 75), 2.0)
    blink = after(bleached, lamp(1e5, 90, 75), 0.3, openness=0.0)
    np.testing.assert_allclose(blink.bleached, bleached.bleached * math.exp(-0.3 / TAU_S), rtol=1e-5, atol=1e-12)
    half = after(rested(SETTINGS), wall(200.0), 1.0, openness=0.5)
    np.testing.assert_allclose(half.bleached, after(rested(SETTINGS), wall(100.0), 1.0).bleached, rtol=1e-5)


def test_a_pupil_twice_as_wide_lets_four_times_the_light_in() -> None:
    wide = after(rested(SETTINGS), wall(100.0), 1.0, pupil_diameter_mm=6.0)
    narrow = after(rested(SETTINGS), wall(400.0), 1.0, pupil_diameter_mm=3.0)
    np.testing.assert_allclose(wide.bleached, narrow.bleached, rtol=1e-5)


def test_red_bleaches_the_long_cones_most_and_blue_the_short_ones() -> None:
    import colour

    catches = colour.adaptation.CHROMATIC_ADAPTATION_TRANSFORMS["Von Kries"] @ (
        colour.RGB_COLOURSPACES["ITU-R BT.709"].matrix_RGB_to_XYZ
    )
    np.testing.assert_allclose(cone_matrix(), catches / catches.sum(1, keepdims=True), atol=5e-4)
    for channel, order in ((0, (0, 1, 2)), (2, (2, 1, 0))):
        image = np.zeros((3, 150, 180), np.float32)
        image[channel] = 1e4
        shares = fovea(after(rested(SETTINGS), jnp.asarray(image), 1.0))
        assert shares[order[0]] > shares[order[1]] > shares[order[2]]


def test_a_lamp_that_is_looked_at_bleaches_the_fovea_wherever_it_stands() -> None:
    expected = fovea(after(rested(SETTINGS), lamp(1e5, 90, 75), 1.0))
    assert expected.min() > 0.01
    for x, y in ((40, 40), (140, 75), (90, 120)):
        found = fovea(after(rested(SETTINGS), lamp(1e5, x, y), 1.0, gaze_px=(float(x), float(y))))
        np.testing.assert_allclose(found, expected, rtol=0.02)
    assert fovea(after(rested(SETTINGS), lamp(1e5, 40, 40), 1.0)).max() < 1e-3


def test_a_lamp_beside_the_gaze_bleaches_at_its_angle() -> None:
    """Seen from the middle, a lamp at pixel x lies at atan((x − w/2)/f)."""
    x = 150
    bleached = np.asarray(after(rested(SETTINGS), lamp(1e5, x, 75, 6), 0.1).bleached[0], np.float64)
    middle = bleached.shape[0] // 2
    centre = (bleached.sum(0) @ np.arange(bleached.shape[1])) / bleached.sum()
    expected = math.degrees(math.atan((x - 90) / VIEW.focal_px)) / 1.5
    assert centre - middle == pytest.approx(expected, abs=0.3)


@pytest.mark.parametrize("gaze_px", [(90.0, 75.0), (0.0, 0.0), (179.0, 20.0), (-4000.0, 9000.0), (1e6, 75.0)])
def test_an_eye_turns_rigidly_and_looks_where_it_looks(gaze_px: tuple[float, float]) -> None:
    turn = geometry.turn(VIEW, gaze_px).astype(np.float64)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(turn) == pytest.approx(1, abs=1e-6)
    right, up, ahead = turn @ [0, 0, 1]
    place = (90 + VIEW.focal_px * right / ahead, 75 - VIEW.focal_px * up / ahead)
    np.testing.assert_allclose(place, gaze_px, rtol=1e-3, atol=1e-2)
    bleached = np.asarray(after(rested(SETTINGS), wall(1e4), 1.0, gaze_px).bleached)
    assert np.isfinite(bleached).all()


def test_directions_of_cells_come_back_to_their_cells() -> None:
    count = geometry.cells(1.5)
    row, column = geometry.cell_places(geometry.cell_directions(count), count)
    np.testing.assert_allclose(row, np.broadcast_to(np.arange(count)[:, None], row.shape), atol=2e-3)
    np.testing.assert_allclose(column, np.broadcast_to(np.arange(count)[None], row.shape), atol=2e-3)


def test_low_resolution_is_the_mean_around_each_node() -> None:
    view = View(300, 131, 60.0)  # three pixels a node, since 131 is prime; the last row has two
    rgb = np.random.default_rng(0).random((3, 131, 300)).astype(np.float32)
    small = np.asarray(low_resolution(jnp.asarray(rgb), view))
    assert (geometry.node_px(view), small.shape[1:]) == ((3, 3), geometry.node_counts(view))
    np.testing.assert_allclose(small[:, 5, 7], rgb[:, 15:18, 21:24].mean((1, 2)), rtol=1e-5)
    np.testing.assert_allclose(small[:, -1, -1], rgb[:, 129:, 297:].mean((1, 2)), rtol=1e-5)


@pytest.mark.parametrize(("size", "sides"), [((1440, 1600), (16, 15)), ((128, 90), (1, 1)), ((1087, 700), (10, 9))])
def test_nodes_leave_no_rest_where_they_can(size: tuple[int, int], sides: tuple[int, int]) -> None:
    assert geometry.node_px(View(*size)) == sides
    for count, pixels, side in zip(geometry.node_counts(View(*size)), (size[1], size[0]), sides, strict=True):
        assert count <= geometry.NODES
        assert (count - 1) * side < pixels <= count * side


def test_an_eye_sees_its_own_image_of_a_frame() -> None:
    images = [lamp(1e5, 90, 75), lamp(1e5, 40, 40)]
    for k, image in enumerate(images):
        of_frame = step(
            rested(SETTINGS),
            jnp.stack(images),
            VIEW,
            MIDDLE,
            image=k,
            pupil_diameter_mm=4.0,
            openness=1.0,
            dt_s=1.0,
            exposure=1.0,
        )
        np.testing.assert_array_equal(of_frame.bleached, after(rested(SETTINGS), image, 1.0).bleached)


def test_a_new_resolution_goes_on_with_the_same_retina() -> None:
    fine = View(360, 300, 80.0)
    bleached = after(rested(SETTINGS), lamp(1e5, 90, 75), 1.0)
    gone_on = after(bleached, wall(0.0, fine), 10.0, (180.0, 150.0), view=fine)
    np.testing.assert_allclose(gone_on.bleached, bleached.bleached * math.exp(-10 / TAU_S), rtol=1e-5, atol=1e-12)
