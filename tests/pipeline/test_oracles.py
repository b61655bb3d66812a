"""The plain effects against closed forms, and the program's own against them."""

from __future__ import annotations

import colour
import jax.numpy as jnp
import numpy as np
import pytest

from entoptic.pipeline.cost import scenes
from entoptic.pipeline.effects import acuity as own_acuity
from entoptic.pipeline.effects import adaptation as own_adaptation
from entoptic.pipeline.effects import night_colour as own_night_colour
from entoptic.pipeline.effects import tone as own_tone
from entoptic.pipeline.effects.encode import srgb_codes
from entoptic.pipeline.frame import Display, View
from entoptic.pipeline.oracles import acuity, adaptation, chain, night_colour, tone

VIEW = View(40, 36, 60.0)


def colours(low: float, high: float, shape: tuple[int, int] = (24, 30)) -> np.ndarray:
    random = np.random.default_rng(2)
    return np.asarray(10 ** random.uniform(np.log10(low), np.log10(high), (3, *shape)))


class TestAdaptation:
    def test_a_uniform_frame_is_adapted_to_itself(self) -> None:
        assert adaptation.target_cd_m2(np.full((3, 36, 40), 7.0), VIEW, 3.0, -9.0) == pytest.approx(7.0, rel=1e-12)

    def test_the_key_is_krawczyks(self) -> None:
        """E2."""
        for luminance, key in ((0.001, 0.0302), (0.01, 0.0322), (0.1, 0.0503)):
            assert adaptation.exposure(luminance) * luminance == pytest.approx(key, abs=5e-5)


class TestAcuity:
    def test_lightness_is_cielabs(self) -> None:
        y = np.geomspace(1e-4, 1e3, 60)
        np.testing.assert_allclose(acuity.lightness(y), colour.colorimetry.lightness_CIE1976(y, 100.0), rtol=1e-9)
        np.testing.assert_allclose(acuity.luminance_of(acuity.lightness(y)), y, rtol=1e-9)

    @pytest.mark.parametrize("blur", [acuity.fit, acuity.true_filter])
    def test_even_dark_stays_and_light_stays_sharp(self, blur: object) -> None:
        assert callable(blur)
        even = np.full((3, 9, 9), 0.01)
        np.testing.assert_allclose(blur(even), even, rtol=1e-12)
        bright = colours(0.5, 50)
        np.testing.assert_array_equal(blur(bright), bright)

    def test_in_blackness_a_point_becomes_the_gaussian_of_one_pixel(self) -> None:
        point = np.zeros((3, 21, 21))
        point[:, 10, 10] = 1e-9
        at = np.arange(-3, 4)
        taps = np.exp(-at * at / 2) / np.exp(-at * at / 2).sum()
        for blur in (acuity.fit, acuity.true_filter):
            np.testing.assert_allclose(blur(point)[0, 7:14, 7:14], 1e-9 * np.outer(taps, taps), rtol=1e-6)


class TestTone:
    def test_encoding_is_srgbs(self) -> None:
        linear = np.linspace(0, 1, 300).reshape(3, 10, 10)
        np.testing.assert_allclose(tone.srgb(linear), colour.models.eotf_inverse_sRGB(linear), atol=2e-6)

    @pytest.mark.parametrize("peak", [40.0, 100.0, 1000.0])
    def test_middle_grey_keeps_its_luminance_up_to_the_reference_and_above(self, peak: float) -> None:
        grey = np.full((3, 1, 1), 0.18)
        shown = tone.aces(grey, 1.0, peak)[0, 0, 0] * peak
        at_reference = tone.aces(grey, 1.0, 100.0)[0, 0, 0] * 100
        assert shown == pytest.approx(at_reference * min(1, peak / 100), rel=1e-12)


def test_a_grey_in_the_dark_has_the_tint() -> None:
    grey = np.full((3, 1, 1), 0.3)
    np.testing.assert_allclose(
        night_colour.night_tint(grey, 1e-9)[:, 0, 0], 0.3 * np.array(night_colour.TINT), rtol=1e-6
    )


def test_the_programs_effects_in_a_row_are_the_plain_ones() -> None:
    """Codes differ by rounding alone."""
    scene = scenes.scene("moonlight", 72, 80)
    adapted = own_adaptation.target_cd_m2(scene.measured, 0.0, 0.0)
    image = own_acuity.dark_acuity(scene.frame.rgb_cd_m2)
    shown = own_tone.show(image, [adapted], [adapted], own_tone.Tone(), Display())
    shown = own_night_colour.night_tint(shown, jnp.asarray([own_adaptation.rod_sensitivity(adapted)]))
    ours = np.asarray(srgb_codes(shown, 0.0))[0]
    codes, milliseconds = chain.perceived(scene.frame.rgb_cd_m2[0], scene.frame.view, lambda rgb: rgb)
    assert list(milliseconds) == ["adaptation", "glare", "acuity", "tone", "night_colour", "encode"]
    difference = np.abs(codes.astype(int) - ours.astype(int))
    assert difference.max() <= 1
    assert (difference > 0).mean() < 0.03
