"""The veil at low resolution against sums over all pixels, against the sphere, and where tiles, frames or light end."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.effects.glare import veil
from entoptic.pipeline.effects.glare.kernel import Mixture, Veil, component
from entoptic.pipeline.frame import View
from entoptic.pipeline.measure import luminance
from entoptic.pipeline.optics import analytic, radial
from entoptic.pipeline.oracles import glare as reference

CIE = Veil(analytic.cie135, (35.0, 0.5))
SHARE = radial.hemisphere_volume(CIE.density)
WIDE = View(360, 400, 104.0)
NOTHING = np.zeros((1, 1))


def only(wide: Veil, share: float | None = None) -> Mixture:
    """A kernel that leaves all light but a veil's where it is."""
    return ((component(NOTHING, wide, radial.hemisphere_volume(wide.density) if share is None else share), 1.0),)


def arrives(light: np.ndarray, view: View, mixture: Mixture) -> np.ndarray:
    """What a frame gets from its veil, in float64."""
    shares = veil.amounts(mixture)
    low = veil.points(jnp.asarray(light, jnp.float32), view, shares)
    return np.asarray(veil.at_pixels(low, veil.grid(view).rows.weights, view.height_px), np.float64)


def exactly(light: np.ndarray, view: View, wide: Veil, share: float) -> np.ndarray:
    """The same as a sum over all pixels; the view may have 112 pixels a side, or the light few lit ones."""
    return reference.reference_change(light, view, NOTHING, [(wide, share)]) + share * np.asarray(light, np.float64)


def point(view: View, y: int, x: int, cd_m2: float = 1e6) -> np.ndarray:
    light = np.zeros((3, view.height_px, view.width_px), np.float32)
    light[:, y, x] = cd_m2
    return light


def degrees_from(view: View, y: int, x: int) -> np.ndarray:
    v, u = np.meshgrid(
        (np.arange(view.height_px) + 0.5 - view.height_px / 2) / view.focal_px,
        (np.arange(view.width_px) + 0.5 - view.width_px / 2) / view.focal_px,
        indexing="ij",
    )
    towards = np.stack([u, v, np.ones_like(u)])
    towards /= np.linalg.norm(towards, axis=0)
    return np.degrees(np.arccos(np.clip(np.einsum("cyx,c->yx", towards, towards[:, y, x]), -1, 1)))


@pytest.mark.parametrize(
    ("view", "bounds"),
    [
        (WIDE, {(0, 4.5): 0.015, (4.5, 9): 0.024, (9, 10): 0.024, (10, 12): 0.017, (12, 20): 0.008, (20, 80): 0.001}),
        (View(512, 512, 36.5), {(0, 4.5): 0.006, (4.5, 9): 0.008, (9, 12): 0.008, (12, 20): 0.001, (20, 80): 0.0005}),
    ],
)
def test_a_points_veil_is_the_exact_one(view: View, bounds: dict[tuple[float, float], float]) -> None:
    """Errors by angle from the light, as shares of all that the eye scatters to that angle."""
    random = np.random.default_rng(1)
    height, width = view.height_px, view.width_px
    places = [
        (height // 2, width // 2),
        (3, 3),
        *zip(random.integers(height, size=4), random.integers(width, size=4), strict=True),
    ]
    for y, x in places:
        light = point(view, y, x)
        deg = degrees_from(view, y, x)
        got, truth = arrives(light, view, only(CIE))[1], exactly(light, view, CIE, SHARE)[1]
        whole = truth.max() / CIE.density(np.array(deg.ravel()[truth.argmax()])) * analytic.cie135(deg, *CIE.parameters)
        error = np.abs(got - truth) / whole
        for (low, high), bound in bounds.items():
            at = (deg >= low) & (deg < high)
            if at.any():
                assert error[at].max() < bound, (y, x, low, high)


def test_a_random_fields_veil_is_the_exact_one() -> None:
    """Its brightest pixel has 2000 times the median: within 4.5° of it the veil is faint, and off by more."""
    view = View(88, 90, 104.0)
    light = np.random.default_rng(2).lognormal(0, 2, (3, 90, 88)).astype(np.float32)
    error = arrives(light, view, only(CIE)) / exactly(light, view, CIE, SHARE) - 1
    assert np.abs(error).max() < 0.05
    assert np.sqrt((error**2).mean()) < 0.005


def test_what_a_point_scatters_adds_up_over_the_sphere() -> None:
    """A veil that ends at 40° lands in a view of 104° as a whole, seen from its middle."""

    def short(deg: np.ndarray) -> np.ndarray:
        return np.clip(1 - (deg / 40) ** 2, 0, 1) ** 2

    wide = Veil(short)
    volume = radial.hemisphere_volume(wide.density)
    solid_angles = reference.pixel_solid_angles(WIDE)
    # Of one place in the middle and one 10° beside it.
    for y, x in ((200, 180), (200, 205)):
        got = arrives(point(WIDE, y, x), WIDE, only(wide, 0.1))[1]
        assert volume > 0.1
        assert (got * solid_angles).sum() / (1e6 * solid_angles[y, x]) == pytest.approx(0.1, rel=1e-3)


def test_a_uniform_frame_gets_no_more_than_it_scatters() -> None:
    for view in (WIDE, View(100, 100, 175.0), View(64, 64, 5.0)):
        got = arrives(np.ones((3, view.height_px, view.width_px)), view, only(CIE))
        assert 0 <= got.min() <= got.max() <= SHARE * (1 + 1e-5)
        change = veil.veil_change(jnp.ones((3, view.height_px, view.width_px), jnp.float32), view, only(CIE))
        assert np.asarray(change).max() <= 1e-6


def test_solid_angles_add_up_to_the_views() -> None:
    for view in (WIDE, View(33, 21, 175.0), View(1, 1, 90.0)):
        half_x, half_y = view.width_px / 2 / view.focal_px, view.height_px / 2 / view.focal_px
        cone = 4 * math.asin(math.sin(math.atan(half_x)) * math.sin(math.atan(half_y)))
        assert reference.pixel_solid_angles(view).sum() == pytest.approx(cone, rel=1e-12)


def test_the_veil_does_not_depend_on_the_resolution() -> None:
    """The same discs at 256 and at 1024 pixels."""
    seen = []
    for pixels in (256, 1024):
        view = View(pixels, pixels, 40.0)
        place = (np.arange(pixels) + 0.5) / pixels
        light = np.full((3, pixels, pixels), 0.1, np.float32)
        for y, x, radius, cd_m2 in ((0.2, 0.3, 0.02, 3e4), (0.8, 0.55, 0.05, 2e3), (0.5, 0.95, 0.03, 1e4)):
            # The disc's edge is a ramp two pixels of the coarser frame wide: the same light at both.
            distance = np.hypot(place[:, None] - y, place[None, :] - x)
            light += cd_m2 * np.clip((radius - distance) * 128 + 0.5, 0, 1).astype(np.float32)
        seen.append(arrives(light, view, only(CIE)))
    finer = seen[1].reshape(3, 256, 4, 256, 4).mean(axis=(2, 4))
    np.testing.assert_allclose(seen[0], finer, rtol=0.01, atol=1e-3 * finer.mean())


def test_a_light_that_crosses_tiles_does_not_jump() -> None:
    """From pixel to pixel, what a place 9–40° away gets changes as it should, to 0.4 % of itself (bound by test)."""
    y = 150
    at = np.s_[1, 300, 100:260:20]
    got, truth = [], []
    for x in range(100, 160):
        light = point(WIDE, y, x)
        got.append(arrives(light, WIDE, only(CIE))[at])
        density = CIE.density(degrees_from(WIDE, y, x))
        truth.append((1e6 * reference.pixel_solid_angles(WIDE)[y, x] * density)[at[1:]])
    steps = np.abs(np.diff(got, axis=0) - np.diff(truth, axis=0)) / np.array(truth)[1:]
    assert steps.max() < 0.004


@pytest.mark.parametrize(
    "view",
    [View(1, 1, 50.0), View(7, 1, 50.0), View(1, 7, 5.0), View(33, 51, 104.0), View(2, 2, 175.0), View(51, 40, 1.0)],
    ids=str,
)
def test_tiny_and_odd_frames_have_the_exact_veil(view: View) -> None:
    light = np.random.default_rng(3).random((3, view.height_px, view.width_px))
    got, truth = arrives(light, view, only(CIE)), exactly(light, view, CIE, SHARE)
    np.testing.assert_allclose(got, truth, rtol=5e-3, atol=2e-3 * SHARE)


@given(
    st.sampled_from([View(31, 8, 140.0), View(9, 40, 17.0), View(20, 21, 90.0), View(5, 5, 175.0)]),
    st.integers(0, 2**32 - 1),
)
def test_no_light_is_negative_and_none_is_made(view: View, seed: int) -> None:
    height, width = view.height_px, view.width_px
    random = np.random.default_rng(seed)
    light = np.where(random.random((3, height, width)) < 0.1, random.lognormal(0, 6, (3, height, width)), 0)
    got = arrives(light, view, only(CIE))
    assert np.isfinite(got).all()
    assert got.min() >= 0
    solid_angles = reference.pixel_solid_angles(view)
    assert (got * solid_angles).sum() <= SHARE * 1.01 * (light * solid_angles).sum()


def test_the_sun_beside_starlight_in_float32() -> None:
    """Up to 80° from the sun; beyond 90°, where it gives none, tiles blur that edge."""
    light = point(WIDE, 5, 5, 1.6e9)
    light[light == 0] = 1e-3
    got, truth = arrives(light, WIDE, only(CIE))[1], exactly(light, WIDE, CIE, SHARE)[1]
    deg = degrees_from(WIDE, 5, 5)
    lit, unlit = (deg > 40) & (deg < 80), deg > 95
    np.testing.assert_allclose(got[lit], truth[lit], rtol=0.01)
    illuminance_lx = 1.6e9 * reference.pixel_solid_angles(WIDE)[5, 5]
    np.testing.assert_allclose(got[unlit], truth[unlit], rtol=0.01, atol=1e-5 * illuminance_lx)


def test_a_black_frame_stays_black() -> None:
    assert not np.asarray(veil.veil_change(jnp.zeros((3, 400, 360), jnp.float32), WIDE, only(CIE))).any()


def test_it_is_linear_in_the_light() -> None:
    random = np.random.default_rng(4)
    one, two = (random.random((3, 400, 360)).astype(np.float32) for _ in range(2))
    both = arrives(one + 3 * two, WIDE, only(CIE))
    np.testing.assert_allclose(both, arrives(one, WIDE, only(CIE)) + 3 * arrives(two, WIDE, only(CIE)), rtol=1e-5)


def test_the_change_is_what_arrives_less_what_has_left_and_may_be_added_to_a_frame() -> None:
    light = jnp.asarray(np.random.default_rng(5).random((3, 400, 360)), jnp.float32)
    change = np.asarray(veil.veil_change(light, WIDE, only(CIE)))
    np.testing.assert_allclose(change, arrives(light, WIDE, only(CIE)) - SHARE * np.asarray(light), atol=1e-6)
    onto = np.asarray(veil.veil_change(light, WIDE, only(CIE), onto=2 * light))
    np.testing.assert_allclose(onto, change + 2 * np.asarray(light), atol=1e-6)


def test_equal_veils_are_one_and_weights_count() -> None:
    first, second = (component(NOTHING, Veil(analytic.cie135, (35.0, 0.5)), share) for share in (0.03, 0.05))
    other = component(NOTHING, Veil(analytic.f2), 0.1)
    none = component(NOTHING, None, 0.0)
    mixture = ((first, 0.5), (second, 0.25), (other, 0.1), (none, 0.1), (other, 0.0))
    assert veil.amounts(mixture) == pytest.approx({CIE: 0.0275, Veil(analytic.f2): 0.01})
    light = np.random.default_rng(6).random((3, 400, 360))
    parts = [(component(NOTHING, CIE, 0.0275), 1.0)], [(component(NOTHING, Veil(analytic.f2), 0.01), 1.0)]
    summed = sum(arrives(light, WIDE, tuple(part)) for part in parts)
    np.testing.assert_allclose(arrives(light, WIDE, mixture), summed, rtol=1e-5)


def test_a_kernel_without_a_veil_changes_nothing() -> None:
    light = jnp.ones((3, 5, 6), jnp.float32)
    mixture = ((component(np.ones((1, 1)), None, 0.0), 1.0),)
    assert not np.asarray(veil.veil_change(light, View(6, 5), mixture)).any()
    assert veil.veil_change(light, View(6, 5), mixture, onto=light) is light


def test_it_is_instant_and_keeps_nothing_of_other_frames() -> None:
    random = np.random.default_rng(7)
    one, two = (jnp.asarray(random.random((3, 400, 360)), jnp.float32) for _ in range(2))
    before = np.asarray(veil.veil_change(one, WIDE, only(CIE)))
    veil.veil_change(two, WIDE, only(CIE))
    assert np.array_equal(np.asarray(veil.veil_change(one, WIDE, only(CIE))), before)


def test_colour_stays_the_lights_own() -> None:
    light = point(WIDE, 100, 100)
    light[1] *= 0.5
    light[2] = 0
    got = arrives(light, WIDE, only(CIE))
    np.testing.assert_allclose(got[1], got[0] / 2, rtol=1e-5)
    assert not got[2].any()
    assert float(luminance(jnp.asarray(got)).min()) >= 0
