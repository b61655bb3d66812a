"""What is measured when accuracy is set against time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import colour
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.cost import errors, scenes
from entoptic.pipeline.cost.glare import Setting, compare, pixels
from entoptic.pipeline.cost.sun_corner import PLAIN, angles_deg, plain_fft, sun_corner
from entoptic.pipeline.cost.timing import interleaved
from entoptic.pipeline.cost.whole_frame import pareto
from entoptic.pipeline.effects.glare.kernel import Part
from entoptic.pipeline.frame import Display, Frame, View
from entoptic.pipeline.optics.whole import kernel_radius_px

DISPLAY = Display()


def delta_e_itp(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Of each pixel of two images in the display's cd/m²."""
    one, other = (errors.OnDisplay(image, DISPLAY).ictcp for image in (first, second))
    return np.asarray(colour.difference.delta_E_ITP(one, other))


def grey(luminance: float, side: int = 8) -> np.ndarray:
    return np.full((3, side, side), luminance)


class TestErrors:
    def test_the_truth_has_none(self) -> None:
        image = np.random.default_rng(0).uniform(0, 50, (3, 9, 7))
        found = errors.errors_of(image, image, 0.01, DISPLAY)
        assert (found.relative_l2, found.worst_cd_m2, found.delta_e_mean, found.delta_e_p95) == (0, 0, 0, 0)
        assert found.share_changed == 0

    def test_one_wrong_pixel_is_found_with_its_sign_and_place(self) -> None:
        truth = grey(2.0)
        image = truth.copy()
        image[:, 5, 3] -= 0.5
        image[1, 2, 6] += 0.5  # green alone: 0.36 cd/m²
        found = errors.errors_of(image, truth, 0.01, DISPLAY)
        assert found.worst_cd_m2 == pytest.approx(-0.5)
        assert (found.worst_x_px, found.worst_y_px) == (3, 5)
        assert found.relative_l2 == pytest.approx(math.sqrt((3 + 1) * 0.25) / (2 * math.sqrt(3 * 64)))

    @given(st.floats(1e-3, 1e3), st.floats(1e-6, 1e6))
    def test_a_share_of_the_light_is_that_relative_error_at_any_luminance(self, off: float, luminance: float) -> None:
        found = errors.errors_of(grey(luminance) * (1 + off), grey(luminance), 1 / luminance, DISPLAY)
        assert found.relative_l2 == pytest.approx(off, rel=1e-9)

    def test_delta_e_is_that_of_the_recommendation(self) -> None:
        """Greys have no chroma: ΔE is 720 times the difference of PQ codes (BT.2124)."""
        one, other = (np.full((3, 1, 1), value) for value in (10.0, 10.5))
        codes = colour.models.eotf_inverse_ST2084(np.array([10.0, 10.5]))
        assert delta_e_itp(one, other)[0, 0] == pytest.approx(720 * np.diff(codes)[0], rel=1e-4)

    def test_colours_that_differ_in_hue_alone_differ(self) -> None:
        red, green = np.zeros((3, 1, 1)), np.zeros((3, 1, 1))
        red[0], green[1] = 10 / 0.2126, 10 / 0.7152
        assert delta_e_itp(red, green)[0, 0] > 100

    def test_what_the_display_cannot_show_makes_no_difference_to_see(self) -> None:
        found = errors.errors_of(grey(1e9), grey(1e8), 1e-2, DISPLAY)
        assert found.delta_e_p95 == 0
        assert found.relative_l2 == pytest.approx(9)

    def test_the_95th_percentile_leaves_five_pixels_of_a_hundred_out(self) -> None:
        truth = np.full((3, 10, 10), 10.0)
        image = truth.copy()
        image[:, 0, :4] = 90.0
        few = errors.errors_of(image, truth, 0.01, DISPLAY)
        image[:, 0, :6] = 90.0
        more = errors.errors_of(image, truth, 0.01, DISPLAY)
        assert few.delta_e_p95 == 0
        assert more.delta_e_p95 > 1
        assert 0 < few.delta_e_mean < more.delta_e_mean

    def test_changed_pixels_are_those_with_another_code_value(self) -> None:
        """Exposed to the middle of the scale, a hundredth of a code value is no other one, two code values are."""
        truth = np.full((3, 10, 10), 10.0)
        image = truth.copy()
        image[:, 0] *= 1 + 1e-7
        image[2, 1, :3] *= 1.05
        assert errors.errors_of(image, truth, 0.02, DISPLAY).share_changed == pytest.approx(0.03)


class TestTimes:
    def test_parts_take_turns_and_the_first_call_stands_apart(self) -> None:
        called: list[str] = []
        told: list[str] = []

        def part(name: str) -> str:
            if name not in called:
                time.sleep(0.05)
            called.append(name)
            return f"{name}{called.count(name)}"

        timed = interleaved({name: lambda name=name: part(name) for name in "ab"}, 3, told.append)
        assert called == told == ["a", "b"] * 4
        assert timed["a"].result == "a1"
        assert timed["a"].times.steady_ms.shape == (3,)
        assert timed["a"].times.first_ms >= 50

    def test_without_rounds_the_first_call_is_the_time(self) -> None:
        times = interleaved({"a": lambda: None}, 0)["a"].times
        assert times.steady_ms.tolist() == [times.first_ms]

    def test_quartiles_enclose_the_median(self) -> None:
        times = interleaved({"a": lambda: sum(range(1000))}, 9)["a"].times
        low, high = times.middle_half_ms
        assert 0 < low <= times.median_ms <= high


class TestComparison:
    scene = scenes.CostScene("grey", Frame(jnp.ones((1, 3, 8, 8), jnp.float32), View(8, 8, 40.0)))

    def test_a_setting_has_a_row_of_all_that_it_is_a_value_of(self) -> None:
        setting = Setting("a", ["grid", "precision"], lambda scene: scene.frame.rgb_cd_m2[0] * 1.25)
        rows = compare(
            [setting], self.scene, grey(1.0)[:, pixels(self.scene)[:, 0], pixels(self.scene)[:, 1]], "truth", 2
        )
        assert [(row.effect, row.setting, row.of, row.scene) for row in rows] == [
            ("grid", "a", "truth", "grey"),
            ("precision", "a", "truth", "grey"),
        ]
        assert rows[0].errors == rows[1].errors
        assert rows[0].errors.relative_l2 == pytest.approx(0.25)
        assert rows[0].times is not None
        assert rows[0].times.steady_ms.shape == (2,)

    def test_the_front_holds_what_none_beats(self) -> None:
        assert pareto([(3, 1), (1, 5), (2, 5), (2, 2), (4, 1.5)]) == [1, 3, 0]

    @given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=1, max_size=12))
    def test_every_point_is_on_the_front_or_beaten_by_one_on_it(self, points: list[tuple[int, int]]) -> None:
        front = pareto(points)
        for point in points:
            assert any(points[k][0] <= point[0] and points[k][1] <= point[1] for k in front)
        best = [points[k] for k in front]
        assert best == sorted(best)
        assert [y for _, y in best] == sorted({y for _, y in best}, reverse=True)


class TestScenes:
    def test_the_computed_frames_stand_over_the_dark(self) -> None:
        lamps, sun = scenes.lamps_over_dark(), scenes.sun_over_dark()
        assert lamps.frame.rgb_cd_m2.shape == sun.frame.rgb_cd_m2.shape == (1, 3, 512, 512)
        assert float(sun.frame.rgb_cd_m2.min()) == pytest.approx(1e-3)
        assert float(lamps.frame.rgb_cd_m2.min()) == pytest.approx(0.01)

    def test_the_suns_disc_has_its_flux(self) -> None:
        frame = scenes.sun_over_dark().frame
        pixels = math.pi * (0.266 * frame.view.ppd_centre) ** 2
        assert float(frame.rgb_cd_m2[0, 1].astype(jnp.float64).sum()) == pytest.approx(1.6e9 * pixels, rel=0.01)

    @pytest.mark.parametrize("make", [scenes.lamps_over_dark, scenes.sun_over_dark])
    def test_a_smaller_frame_shows_the_same_field(self, make: Callable[..., scenes.CostScene]) -> None:
        full, small = make(), make(8)
        assert small.frame.view.width_px == full.frame.view.width_px // 8
        assert small.frame.view.fov_deg == full.frame.view.fov_deg
        assert small.exposure == pytest.approx(full.exposure, rel=0.7)


def spot(per_deg: float, radius: int, wider: float) -> np.ndarray:
    """What stays and what scatters, each channel for itself."""
    x = np.arange(-radius, radius + 1)
    away = np.exp(-(x[:, None] ** 2 + x[None, :] ** 2) / 8.0)
    stays = np.pad([[0.8]], radius)
    return np.asarray(np.eye(3)[:, :, None, None] * (0.2 * away / away.sum() + stays))


SPOT = Part(spot, None)


class TestSunCorner:
    def test_a_plain_fft_convolves(self) -> None:
        view = View(30, 20, 33.0)
        rgb = jnp.zeros((3, 20, 30)).at[:, 4, 7].set(2.0)
        radius = kernel_radius_px(view.ppd_centre)
        whole = spot(view.ppd_centre, radius, 1.0)[0, 0]
        image = np.asarray(plain_fft(rgb, view, SPOT))
        rows, columns = np.indices((20, 30))
        inside = (np.abs(rows - 4) <= radius) & (np.abs(columns - 7) <= radius)
        expected = np.where(inside, 2 * whole[(rows - 4 + radius) * inside, (columns - 7 + radius) * inside], 0)
        np.testing.assert_allclose(image, np.stack([expected] * 3), atol=1e-7)

    def test_angles_are_those_of_the_pinhole(self) -> None:
        view = View(101, 41, 60.0)
        deg = angles_deg(view, (20, 50))
        assert deg[20, 50] == 0
        assert deg[20, 100] == pytest.approx(math.degrees(math.atan(50 / view.focal_px)))
        # Half a pixel from the middle is no corner: the frame's edge lies at half the field of view.
        assert deg[20, 100] < 30 < deg[20, 100] + 1 / view.ppd_centre

    def test_float32_of_the_whole_kernel_outshines_the_dark_and_the_truth_has_no_error(self) -> None:
        scene = scenes.sun_over_dark(8)
        view = scene.frame.view
        at = np.indices((view.height_px, view.width_px)).reshape(2, -1).T
        exact = np.asarray(plain_fft(scene.frame.rgb_cd_m2[0].astype(jnp.float64), view, SPOT))
        truth = exact.reshape(3, -1)
        found = sun_corner(scene, SPOT, {"itself": truth}, truth, at)
        assert found.error_cd_m2["itself"].max() == 0
        far = found.deg > 30
        assert found.error_cd_m2[PLAIN][far].min() > 10 * found.dark_cd_m2
