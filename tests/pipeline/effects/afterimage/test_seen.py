"""How afterimages look, where they stand, and that their bounds hold."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.effects.adaptation import exposure
from entoptic.pipeline.effects.afterimage import Afterimage, Retina, geometry, propagate, rested, show, skip_bound, step
from entoptic.pipeline.effects.afterimage.seen import HELD_STILL, OWN_CD_M2, seen
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, View
from entoptic.pipeline.ranges import Range

VIEW = View(180, 150, 80.0)
MIDDLE = (90.0, 75.0)
SETTINGS = Afterimage(on=True, cell_deg=1.5)
TILE_PX = 17


def looked_at(rgb: tuple[float, float, float], seconds: float = 10.0, adapted_cd_m2: float = 50.0) -> Retina:
    """After a coloured patch of 10° has been looked at in a dim room."""
    image = np.full((3, VIEW.height_px, VIEW.width_px), 1.0, np.float32)
    image[:, 66:84, 81:99] = np.array(rgb, np.float32)[:, None, None]
    return step(
        rested(SETTINGS),
        jnp.asarray(image),
        VIEW,
        MIDDLE,
        pupil_diameter_mm=4.0,
        openness=1.0,
        dt_s=seconds,
        exposure=exposure(adapted_cd_m2),
    )


def shown(retina: Retina, grey: float, gaze_px: tuple[float, float] = MIDDLE) -> np.ndarray:
    displayed = jnp.full((1, 3, VIEW.height_px, VIEW.width_px), grey, jnp.float32)
    return np.asarray(show(displayed, [retina], VIEW, [gaze_px]))[0]


def dark(retina: Retina) -> Retina:
    """The same without the light of its own: what it takes away alone."""
    return Retina(retina.bleached, 0.0)


def random_retina(seed: int, largest: float = 0.9) -> Retina:
    random = np.random.default_rng(seed)
    count = geometry.cells(5.0)
    bleached = random.uniform(0, largest, (3, count, count)) * (random.random((1, count, count)) < 0.5)
    return Retina(jnp.asarray(bleached, jnp.float32), float(10 ** random.uniform(-5, 0)))


def range_of(image: np.ndarray) -> Range:
    channels = np.concatenate([image, np.einsum("k,kyx->yx", LUMINANCE_WEIGHTS, image)[None]]).astype(np.float64)
    low, high = channels, channels
    for axis in (1, 2):
        begins = range(0, channels.shape[axis], TILE_PX)
        low, high = np.minimum.reduceat(low, begins, axis=axis), np.maximum.reduceat(high, begins, axis=axis)
    return Range(low, high, TILE_PX)


def largest_by_tile(difference: np.ndarray) -> np.ndarray:
    """Of RGB and, from it with its signs, luminance."""
    y = np.einsum("k,kyx->yx", LUMINANCE_WEIGHTS, difference)
    return range_of_changes(np.abs(np.concatenate([difference, y[None]])))


def range_of_changes(channels: np.ndarray) -> np.ndarray:
    for axis in (1, 2):
        channels = np.maximum.reduceat(channels, range(0, channels.shape[axis], TILE_PX), axis=axis)
    return channels


def test_a_rested_retina_changes_nothing() -> None:
    image = np.random.default_rng(0).random((1, 3, VIEW.height_px, VIEW.width_px)).astype(np.float32)
    same = show(jnp.asarray(image), [rested(SETTINGS, 0.02)], VIEW, [MIDDLE])
    np.testing.assert_array_equal(same, image)
    np.testing.assert_array_equal(skip_bound(range_of(image[0]), rested(SETTINGS, 0.02), VIEW, MIDDLE), 0)


def test_a_wall_that_fills_the_frame_leaves_nothing() -> None:
    image = jnp.full((3, VIEW.height_px, VIEW.width_px), 5e4, jnp.float32)
    retina = step(
        rested(SETTINGS), image, VIEW, MIDDLE, pupil_diameter_mm=4.0, openness=1.0, dt_s=5.0, exposure=exposure(1.0)
    )
    assert float(retina.bleached.max()) > 0.5
    np.testing.assert_allclose(shown(retina, 0.5), 0.5, atol=2e-4)


def test_on_a_bright_wall_the_patch_is_dark_by_the_pigment_that_it_lost() -> None:
    retina = dark(looked_at((1e4, 1e4, 1e4)))
    picture = shown(retina, 0.5)
    field = 1 - np.asarray(seen(retina, VIEW, MIDDLE).change).mean((1, 2))
    np.testing.assert_allclose(field, 1, atol=1e-6)  # the mean field is what it was
    middle = retina.bleached.shape[1] // 2
    directions = geometry.node_directions(VIEW)
    rows, columns = geometry.cell_places(directions, retina.bleached.shape[1])
    mean = np.asarray(geometry.sample(retina.bleached, rows, columns)).mean()
    left = (1 - float(retina.bleached[0, middle, middle])) / (1 - mean)
    expected = 0.5 + (1 - 0.5**2) * 0.5 * (left - 1)
    np.testing.assert_allclose(picture[:, 75, 90], expected, rtol=2e-3)
    assert picture[0, 75, 90] < 0.42 < 0.5 < picture[0, 20, 20]
    np.testing.assert_allclose(shown(retina, 1e-3)[:, 75, 90], 1e-3 * left, rtol=2e-3)  # in full in the dark
    np.testing.assert_array_equal(shown(retina, 1.0), 1.0)  # and not at all at the display's peak


@pytest.mark.parametrize("channel", [0, 2])
def test_a_coloured_patch_leaves_its_complement(channel: int) -> None:
    rgb = tuple(2e4 if k == channel else 20.0 for k in range(3))
    picture = shown(dark(looked_at(rgb)), 0.5)[:, 75, 90]  # type: ignore[arg-type]
    assert picture[channel] < min(value for k, value in enumerate(picture) if k != channel) - 0.05


def test_in_the_dark_it_shines_and_fades() -> None:
    retina = looked_at((1e5, 1e5, 1e5), 1.0, adapted_cd_m2=1.0)
    brightness = []
    for _ in range(4):
        picture = shown(retina, 0.0)
        assert picture[:, 10, 10].max() < 1e-6
        brightness.append(float(picture[1, 75, 90]))
        closed = jnp.zeros((3, VIEW.height_px, VIEW.width_px), jnp.float32)
        retina = step(
            retina, closed, VIEW, MIDDLE, pupil_diameter_mm=4.0, openness=0.0, dt_s=60.0, exposure=exposure(1.0)
        )
    assert 0.5 < brightness[0] < 1
    assert brightness == sorted(brightness, reverse=True)
    assert brightness[3] < brightness[0] / 3


def test_the_light_of_its_own_is_that_of_the_raised_threshold() -> None:
    """Half of the pigment gone raises the threshold by 10^1.5: as light of 3.43·(10^1.5 − 1) cd/m² would."""
    assert pytest.approx(10**0.535, rel=1e-3) == OWN_CD_M2
    count = geometry.cells(1.5)
    bleached = np.zeros((3, count, count), np.float32)
    bleached[:, count // 2 - 1 : count // 2 + 2, count // 2 - 1 : count // 2 + 2] = 0.5
    # So few cells that the mean of the field counts for nothing but its own small light.
    retina = Retina(jnp.asarray(bleached), 1e-3)
    nodes = np.asarray(seen(retina, VIEW, MIDDLE).change)[0]
    field_light = OWN_CD_M2 * np.expm1(3 * math.log(10) * 0.5 * (nodes < -0.01).mean())
    light = shown(retina, 0.0)[1, 75, 90]
    expected = -math.expm1(-1e-3 * HELD_STILL * OWN_CD_M2 * (10**1.5 - 1))
    assert light == pytest.approx(expected, rel=0.01 + field_light / (OWN_CD_M2 * 30))


def test_it_moves_with_the_gaze() -> None:
    retina = looked_at((1e5, 1e5, 1e5), 1.0, adapted_cd_m2=1.0)
    for gaze_px in ((90.0, 75.0), (130.0, 60.0), (40.0, 110.0)):
        light = shown(retina, 0.0, gaze_px)[1].astype(np.float64)
        x = light.sum(0) @ (np.arange(VIEW.width_px) + 0.5) / light.sum()
        y = light.sum(1) @ (np.arange(VIEW.height_px) + 0.5) / light.sum()
        np.testing.assert_allclose((x, y), gaze_px, atol=2.0)
    assert shown(retina, 0.0, (-2000.0, 75.0)).max() < 1e-6  # an eye that looks away takes it along


def test_each_eye_has_its_own() -> None:
    displayed = jnp.full((2, 3, VIEW.height_px, VIEW.width_px), 0.5, jnp.float32)
    bleached = looked_at((1e5, 1e5, 1e5))
    both = np.asarray(show(displayed, [rested(SETTINGS), bleached], VIEW, [MIDDLE, MIDDLE]))
    np.testing.assert_array_equal(both[0], 0.5)
    np.testing.assert_allclose(both[1], shown(bleached, 0.5), atol=1e-6)


def test_shown_between_nodes_as_by_interpolation_in_float64() -> None:
    import scipy.ndimage

    view = View(300, 131, 80.0)
    retina = random_retina(3)
    displayed = jnp.zeros((1, 3, 131, 300), jnp.float32)
    picture = np.asarray(show(displayed, [retina], view, [(150.0, 65.0)]))[0]
    light = np.asarray(seen(retina, view, (150.0, 65.0)).light, np.float64)
    rows, columns = (np.arange(131) + 0.5) / 3 - 0.5, (np.arange(300) + 0.5) / 3 - 0.5
    places = np.meshgrid(rows, columns, indexing="ij")
    for k in range(3):
        expected = scipy.ndimage.map_coordinates(light[k], places, order=1, mode="nearest")
        np.testing.assert_allclose(picture[k], expected, atol=2e-6)


@given(
    seed=st.integers(0, 10_000),
    brightest=st.floats(0.01, 1.0),
    gaze_px=st.tuples(st.floats(-300, 500), st.floats(-300, 500)),
)
def test_leaving_it_out_changes_no_more_than_the_bound(
    seed: int, brightest: float, gaze_px: tuple[float, float]
) -> None:
    random = np.random.default_rng(seed)
    image = (brightest * random.random((3, VIEW.height_px, VIEW.width_px)) ** 3).astype(np.float32)
    retina = random_retina(seed)
    picture = np.asarray(show(jnp.asarray(image)[None], [retina], VIEW, [gaze_px]))[0]
    bound = skip_bound(range_of(image), retina, VIEW, gaze_px)
    assert (largest_by_tile(picture.astype(np.float64) - image) <= bound * (1 + 1e-5) + 2e-6).all()


@given(seed=st.integers(0, 10_000), size=st.floats(1e-4, 0.5))
def test_a_change_before_it_becomes_no_more_than_the_bound(seed: int, size: float) -> None:
    random = np.random.default_rng(seed)
    image = (random.random((3, VIEW.height_px, VIEW.width_px)) ** 3).astype(np.float32)
    other = np.maximum(image + size * random.uniform(-1, 1, image.shape), 0).astype(np.float32)
    retina = random_retina(seed)
    both = (np.asarray(show(jnp.asarray(one)[None], [retina], VIEW, [MIDDLE]), np.float64)[0] for one in (image, other))
    change = largest_by_tile(other.astype(np.float64) - image)
    bound = propagate(change, range_of(image), retina, VIEW, MIDDLE)
    assert (largest_by_tile(np.subtract(*both)) <= bound * (1 + 1e-5) + 2e-6).all()


def test_bounds_are_tight_where_it_matters() -> None:
    """A white patch's afterimage on a grey wall: no more than twice what it is; far from it next to nothing."""
    retina = dark(looked_at((1e4, 1e4, 1e4)))
    image = np.full((3, VIEW.height_px, VIEW.width_px), 0.5, np.float32)
    bound = skip_bound(range_of(image), retina, VIEW, MIDDLE)
    actual = largest_by_tile(shown(retina, 0.5).astype(np.float64) - image)
    assert bound.max() <= 1.2 * actual.max()
    assert bound[:, 0, 0].max() <= 1.2 * actual[:, 0, 0].max() + 1e-6
