"""Every effect in float32 beside the same equations plainly in float64: how far apart at most, effect by effect.

The tolerances are stated in docs/hard-cases.md; those of what is off by default are in test_float32_options.py. Those
of light are relative to the pixel; where an effect sums a frame's light, also to what it sums.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from eye_contexts import glared
from hard_frames import SMALL, VIEW, every_adapted, every_frame, of_name, see

from entoptic.pipeline import Display, EyePose, Frame, Glare, GlareLevel, GlareModel
from entoptic.pipeline.effects import acuity, adaptation, night_colour, tone
from entoptic.pipeline.effects.encode import srgb_codes
from entoptic.pipeline.effects.glare import mixture
from entoptic.pipeline.effects.glare.settings import Edge
from entoptic.pipeline.effects.night_colour import NightColour, NightMethod
from entoptic.pipeline.effects.tone import Hue, Operator, Tone
from entoptic.pipeline.measure import measure
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.oracles import acuity as plain_acuity
from entoptic.pipeline.oracles import adaptation as plain_adaptation
from entoptic.pipeline.oracles import chain as plain_whole
from entoptic.pipeline.oracles import night_colour as plain_night
from entoptic.pipeline.oracles import operators as plain_operators
from entoptic.pipeline.oracles import sphere
from entoptic.pipeline.oracles import tone as plain_tone
from entoptic.pipeline.oracles.point_spread import alike, cie135

DISPLAY = Display()


@every_frame
@pytest.mark.parametrize("gaze_deg", [(0.0, 0.0), (-21.0, 13.0), (80.0, -80.0)])
def test_adaptation_is_within_2e_6(name: str, gaze_deg: tuple[float, float]) -> None:
    rgb, exact = of_name(name)
    target = adaptation.target_cd_m2(measure(Frame(jnp.asarray(rgb)[None], VIEW))[0], *gaze_deg)
    assert target == pytest.approx(plain_adaptation.target_cd_m2(exact, VIEW, *gaze_deg), rel=2e-6)


@every_adapted
def test_exposure_and_the_rods_share_are_float64_themselves(adapted: float) -> None:
    assert adaptation.exposure(adapted) == pytest.approx(plain_adaptation.exposure(adapted), rel=1e-14)
    assert adaptation.rod_sensitivity(adapted) == pytest.approx(plain_adaptation.rod_share(adapted), rel=1e-14)


@every_frame
def test_glare_is_within_1_5_percent_of_the_direct_sum_at_half_the_pixels(name: str) -> None:
    """The direct sum has no levels: what is left is what pooling and B-splines cost, most in frames of noise."""
    rgb, exact = of_name(name)
    kernel = mixture(GlareModel.CIE, SMALL, Pose(4.0), 0.01, VIEW.ppd_centre)
    image = glared(rgb, VIEW, kernel, GlareLevel.HALF)
    truth = sphere.glare(exact, VIEW, alike(cie135(SMALL.age_years, 0.5)))
    off = np.abs(image - truth) / (truth + 0.1 * float(np.median(truth)))
    assert np.median(off) < 0.015
    assert np.percentile(off, 90) < 0.06


@every_frame
def test_acuity_is_within_3e_5_of_the_pixel_and_2e_7_cd_m2(name: str) -> None:
    """Where a dark pixel takes light from a lamp's edge: rounding of lightness counts three times in luminance."""
    rgb, exact = of_name(name)
    image = np.asarray(acuity.dark_acuity(jnp.asarray(rgb)[None]))[0]
    truth = plain_acuity.fit(exact)
    if name != "sun":
        assert np.abs(truth - exact).max() > 1e-3
    np.testing.assert_allclose(image, truth, rtol=3e-5, atol=2e-7)


@every_frame
@every_adapted
def test_tone_is_within_2e_6(name: str, adapted: float) -> None:
    rgb, exact = of_name(name)
    exposure = plain_adaptation.exposure(adapted)
    image = np.asarray(tone.aces(jnp.asarray(rgb)[None], np.array([exposure]), 100.0))[0]
    np.testing.assert_allclose(image, plain_tone.aces(exact, exposure, 100.0), rtol=2e-6, atol=1e-30)


OPERATORS = {
    Operator.ACES: plain_operators.filmic,
    Operator.REINHARD: plain_operators.reinhard,
    Operator.WARD: plain_operators.ward,
    Operator.DURAND: plain_operators.durand,
}
HUES = {
    Hue.CLIP: plain_operators.clipped,
    Hue.RGB: plain_operators.divided,
    Hue.XYY: plain_operators.same_chromaticity,
}
# ACES with clipping is the curve of each component: the test above.
# Oklab's hue on the display's edge is a table's: tests/pipeline/effects/tone/test_gamut.py.
WAYS = [(operator, hue) for operator in OPERATORS for hue in HUES if (operator, hue) != (Operator.ACES, Hue.CLIP)]


@every_frame
@every_adapted
@pytest.mark.parametrize(("operator", "hue"), WAYS)
def test_every_tone_operator_is_within_5e_6(name: str, adapted: float, hue: Hue, operator: Operator) -> None:
    rgb, exact = of_name(name)
    shown = tone.show(jnp.asarray(rgb)[None], [adapted], [adapted], Tone(operator, hue), DISPLAY)
    truth = HUES[hue](OPERATORS[operator](exact, adapted))
    np.testing.assert_allclose(np.asarray(shown)[0], truth, rtol=5e-6, atol=1e-12)


WITHIN = {NightMethod.KRI_XY: 2e-4, NightMethod.BAR: 1e-5}
"""KRI's primaries have four digits or seven; BAR's step at 3 cd/m² is spread over its curve. The others: rounding."""
METHODS = (NightMethod.LUI, NightMethod.KRI_XY, NightMethod.KRI_RGB, NightMethod.BAR)


@every_frame
@every_adapted
@pytest.mark.parametrize("method", METHODS)
def test_night_colour_is_within_its_tolerance(name: str, adapted: float, method: NightMethod) -> None:
    _, scene = of_name(name)
    exact = plain_tone.aces(scene, plain_adaptation.exposure(adapted), 100.0)
    image = np.asarray(night_colour.shift(jnp.asarray(exact, jnp.float32)[None], [adapted], NightColour(method)))[0]
    truth = plain_night.shifted(exact, scene, adapted, NightColour(method))
    apart = np.abs(image - truth) / np.maximum(exact.max(axis=0), 1e-30)
    assert apart.max() <= WITHIN.get(method, 2e-6)


@pytest.mark.parametrize("black", [0.0, 0.01])
def test_encoding_is_off_by_one_code_value_in_fewer_than_1_of_10000(black: float) -> None:
    linear = np.concatenate([[0.0, 1.0, 2.0, 0.0031308], np.random.default_rng(2).random(300_000) ** 3])
    linear = np.asarray(np.resize(linear, (3, 250, 400)), np.float32)
    image = np.asarray(srgb_codes(jnp.asarray(linear)[None], black)[0])
    apart = np.abs(image.astype(int) - plain_tone.encode(linear.astype(np.float64), black).astype(int))
    assert apart.max() <= 1
    assert (apart > 0).mean() < 1e-4


@pytest.mark.parametrize("name", ["night", "starlight"])
def test_a_whole_frame_is_within_two_code_values_at_nine_of_ten_pixels(name: str) -> None:
    """From pixels to code values, all effects: the direct sum for glare, the plain ones for all else.

    In frames of noise over decades, glare's levels are off where a dark pixel stands beside a bright one.
    """
    rgb, exact = of_name(name)
    function = alike(cie135(SMALL.age_years, 0.5))
    codes, _ = plain_whole.perceived(exact, VIEW, lambda light: sphere.glare(light, VIEW, function))
    glare = Glare(GlareModel.CIE, GlareLevel.HALF, Edge.DARK)
    image = see(rgb.transpose(1, 2, 0), EyePose(pupil_diameter_mm=4.0), glare=glare).image[0]
    apart = np.abs(image.astype(int) - codes.astype(int))
    assert np.median(apart) == 0
    assert np.percentile(apart, 90) <= 2
