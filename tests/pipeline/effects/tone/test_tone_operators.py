"""Tone curves: the papers' formulas in float64, their fixed points, and what holds for all of them."""

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from entoptic.pipeline.effects import tone
from entoptic.pipeline.effects.adaptation import exposure
from entoptic.pipeline.effects.tone import Hue, Operator, Tone, filmic
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, Display
from entoptic.pipeline.measure import luminance
from entoptic.pipeline.threshold import cone_threshold_cd_m2, rod_threshold_cd_m2, threshold_cd_m2

WITHOUT_FILE = [operator for operator in Operator if operator is not Operator.CURVE]
ADAPTED_CD_M2 = 1e-6, 1e-3, 0.03, 0.5, 20.0, 3e3
RGB_TO_XYZ = np.array([[0.4124564, 0.3575761, 0.1804375], LUMINANCE_WEIGHTS, [0.0193339, 0.1191920, 0.9503041]])


def greys(cd_m2: np.ndarray) -> np.ndarray:
    return np.broadcast_to(np.asarray(cd_m2, np.float32), (1, 3, 1, np.size(cd_m2)))


def shown(
    rgb: np.ndarray, adapted: float, tone_: Tone, display: Display = Display(), target: float | None = None
) -> np.ndarray:
    """(3, pixel)."""
    target = adapted if target is None else target
    return np.asarray(tone.show(rgb, [adapted], [target], tone_, display), np.float64)[0].reshape(3, -1)


def colours(count: int) -> np.ndarray:
    """(1, 3, 1, pixel), 1e-4 to 1e4 cd/m²."""
    random = np.random.default_rng(4)
    rgb = random.random((3, count)) * 10 ** random.uniform(-4, 4, count)
    return rgb.astype(np.float32)[None, :, None]


@pytest.mark.parametrize("hue", Hue)
@pytest.mark.parametrize("operator", WITHOUT_FILE)
@pytest.mark.parametrize("adapted", ADAPTED_CD_M2)
def test_more_light_is_never_shown_darker(operator: Operator, hue: Hue, adapted: float) -> None:
    """From denormals to a million suns; in the last place float32 may fall."""
    ramp = np.concatenate([[0, 1e-45, 1e-40, 1e-38], np.geomspace(1e-12, 1e15, 4000)])
    for target in (adapted, 30 * adapted):
        y = luminance(shown(greys(ramp), adapted, Tone(operator, hue), target=target)[:, None])[0]
        assert np.all(np.isfinite(y))
        assert np.diff(y).min() >= -3e-7
        assert y[-1] == pytest.approx(1, abs=1e-6)
        assert y.min() >= 0
        if operator is not Operator.WARD:
            assert y[0] == 0


@pytest.mark.parametrize("operator", WITHOUT_FILE)
def test_a_colour_below_zero_is_shown_as_black_and_touches_nothing_else(operator: Operator) -> None:
    rgb = colours(50)
    spoiled = rgb.copy()
    spoiled[0, 1, 0, 7] = -1e6
    before, after = (shown(image, 1.0, Tone(operator)) for image in (rgb, spoiled))
    assert np.array_equal(np.delete(before, 7, 1), np.delete(after, 7, 1))
    assert after[:, 7].max() < 1e-20
    assert after.min() >= 0


@pytest.mark.parametrize("hue", Hue)
@pytest.mark.parametrize("operator", WITHOUT_FILE)
def test_each_eye_is_shown_by_its_own_adaptation(operator: Operator, hue: Hue) -> None:
    rgb, tone_ = colours(64), Tone(operator, hue)
    both = np.asarray(tone.show(np.concatenate([rgb, rgb]), [0.01, 50.0], [0.1, 5.0], tone_, Display()))
    for eye, (adapted, target) in enumerate([(0.01, 0.1), (50.0, 5.0)]):
        alone = np.asarray(tone.show(rgb, [adapted], [target], tone_, Display()))[0]
        assert both[eye] == pytest.approx(alone, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("operator", WITHOUT_FILE)
@pytest.mark.parametrize("peak", [40.0, 100.0, 1000.0])
def test_the_display_is_full_from_the_stated_luminance_on(operator: Operator, peak: float) -> None:
    display, tone_ = Display(peak), Tone(operator)
    for adapted, target in ((0.01, 0.01), (0.01, 0.3), (5.0, 5.0), (300.0, 2.0)):
        full = tone.full_cd_m2(adapted, target, tone_, display)
        below, above = shown(greys([full * 0.999, full * 1.001]), adapted, tone_, display, target)[1]
        assert 0.99 < below < 1
        assert above == pytest.approx(1, abs=1e-6)


# ACES


@pytest.mark.parametrize("peak", [80.0, 100.0, 250.0])
def test_aces_is_narkowiczs_formula_of_each_component(peak: float) -> None:
    """In float64, exposed such that middle grey keeps its luminance on a brighter display."""

    def formula(x: np.ndarray) -> np.ndarray:
        return (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)

    rgb = colours(300)
    grey = formula(np.array(0.18)) * min(100 / peak, 1)
    scale = brentq(lambda scale: float(formula(np.array(0.18 * scale)) - grey), 0.01, 2) * exposure(0.2)
    expected = np.minimum(formula(rgb[0, :, 0].astype(np.float64) * scale), 1)
    np.testing.assert_allclose(shown(rgb, 0.2, Tone(hue=Hue.CLIP), Display(peak)), expected, rtol=2e-6)


def test_aces_turns_where_the_bounds_say() -> None:
    def gain(x: float) -> float:
        return float(filmic.curve(np.array(x))) / x

    assert minimize_scalar(lambda x: -gain(x), (0.1, 0.3)).x == pytest.approx(filmic._CREST, rel=1e-6)
    fall = minimize_scalar(lambda x: float(filmic._per_x_slope(np.array(x))), (0.3, 0.6))
    assert fall.x == pytest.approx(filmic._TURN, rel=1e-6)
    steep = minimize_scalar(lambda x: -float(filmic.slope(np.array(x))), (0.05, 0.2))
    assert steep.x == pytest.approx(filmic.INFLECTION, rel=1e-6)
    x = np.geomspace(1e-4, 1e3, 500)
    numeric = (filmic.curve(x * (1 + 1e-6)) - filmic.curve(x * (1 - 1e-6))) / (2e-6 * x)
    assert filmic.slope(x) == pytest.approx(numeric, rel=1e-4)
    assert float(filmic.curve(np.array(filmic.FULL))) == pytest.approx(1, abs=1e-12)


def test_a_grey_looks_the_same_whether_its_hue_is_kept_or_not() -> None:
    ramp = greys(np.geomspace(1e-3, 1e5, 300))
    for hue in Hue:
        assert shown(ramp, 1.0, Tone(hue=hue)) == pytest.approx(shown(ramp, 1.0, Tone(hue=Hue.CLIP)), rel=2e-6)


# Reinhard


@pytest.mark.parametrize("adapted", ADAPTED_CD_M2)
@pytest.mark.parametrize("white", [0.5, 2.0, 50.0])
def test_reinhard_is_the_papers_formula(adapted: float, white: float) -> None:
    """KRI 4.18 and 4.20 with the key of E2, on the display the paper has: one of 100 cd/m²."""
    rgb = colours(200)
    key = 1.03 - 2 / (2 + np.log10(adapted + 1))
    y = np.einsum("c,cp->p", LUMINANCE_WEIGHTS, rgb[0, :, 0].astype(np.float64))
    exposed = key * y / adapted
    expected = rgb[0, :, 0] / y * exposed * (1 + exposed / white**2) / (1 + exposed)
    actual = shown(rgb, adapted, Tone(Operator.REINHARD, Hue.CLIP, white))
    assert actual == pytest.approx(np.minimum(expected, 1), rel=1e-5, abs=1e-12)


@pytest.mark.parametrize("operator", [Operator.ACES, Operator.REINHARD])
def test_middle_grey_has_the_same_luminance_on_every_display_that_can_show_it(operator: Operator) -> None:
    """As far as the reference display shows it; a dimmer display is darker as its peak is."""
    grey = greys([tone.MIDDLE_GREY / exposure(2.0)])
    light = {peak: shown(grey, 2.0, Tone(operator), Display(peak))[0, 0] * peak for peak in (50.0, 100.0, 400.0, 2e3)}
    assert light[400.0] == pytest.approx(light[100.0], rel=1e-5)
    assert light[2e3] == pytest.approx(light[100.0], rel=1e-5)
    assert light[50.0] == pytest.approx(light[100.0] / 2, rel=1e-5)


# Ward


@pytest.mark.parametrize("adapted", [1e-4, 0.01, 0.1, 1.0, 100.0, 1e4])
@pytest.mark.parametrize("peak", [60.0, 100.0, 600.0])
def test_what_is_just_seen_in_the_scene_is_just_seen_on_the_display(adapted: float, peak: float) -> None:
    """TVI there and back: a threshold of the adapted eye becomes the threshold of who looks at the display."""
    dark, light = shown(greys([0, threshold_cd_m2(adapted)]), adapted, Tone(Operator.WARD), Display(peak))[0] * peak
    assert light - dark == pytest.approx(cone_threshold_cd_m2(peak / 2), rel=1e-6)


def test_ward_of_a_moonlit_wall() -> None:
    """BAR 9 by hand: t_p(50)/t_m(0.01)·0.01 = 3.0879/0.0054723·0.01 cd/m²."""
    log = np.log10(50)
    of_display = 10 ** ((0.249 * log + 0.65) ** 2.7 - 0.72)
    wall = shown(greys([0.01]), 0.01, Tone(Operator.WARD))[0, 0] * 100
    assert wall == pytest.approx(of_display / 0.0054723 * 0.01, rel=2e-5)


@pytest.mark.parametrize(("adapted", "target"), [(1e-3, 1.0), (0.1, 0.2), (2.0, 500.0)])
def test_an_eye_that_adapts_to_light_sees_its_target_where_it_will_and_less_contrast_around_it(
    adapted: float, target: float
) -> None:
    """BAR 10: L_d(target) stays; a difference of t* = t_m(target)²/t_m(adapted) is just seen."""
    ward = Tone(Operator.WARD)
    settled = shown(greys([target]), target, ward)[0, 0]
    overshoot = threshold_cd_m2(target) ** 2 / threshold_cd_m2(adapted)
    at, above = shown(greys([target, target + 0.1 * overshoot]), adapted, ward, target=target)[0]
    assert at == pytest.approx(settled, rel=1e-5)
    assert (above - at) * 100 == pytest.approx(0.1 * cone_threshold_cd_m2(50), rel=1e-4)


def test_ward_does_not_jump_where_light_adaptation_begins_or_ends() -> None:
    ramp, ward = greys(np.geomspace(1e-3, 1e2, 100)), Tone(Operator.WARD)
    before, at, after = (shown(ramp, 1.0, ward, target=target) for target in (1 - 1e-6, 1.0, 1 + 1e-6))
    assert before == pytest.approx(at, abs=1e-5)
    assert after == pytest.approx(at, abs=1e-5)


@pytest.mark.parametrize("operator", WITHOUT_FILE)
@pytest.mark.parametrize("joint", [0.01, 0.03, 3.0, 10**-2.6, 10**1.9, 10**-3.94, 10**-1.44])
def test_no_adapted_luminance_makes_the_picture_jump(operator: Operator, joint: float) -> None:
    """The published pieces of the rods' threshold miss each other by 2.7 % at 0.036 cd/m², all others by less."""
    ramp = greys(joint * np.geomspace(0.1, 10, 50))
    below, above = (shown(ramp, joint * (1 + side), Tone(operator)) for side in (-1e-9, 1e-9))
    assert above == pytest.approx(below, rel=0.028 if joint == 10**-1.44 else 0.009)


# Durand


@pytest.mark.parametrize("adapted", ADAPTED_CD_M2)
def test_durand_is_the_papers_formula(adapted: float) -> None:
    """KRI 4.21–4.26 in float64, V by another implementation (E4)."""
    rgb = colours(200)
    xyz = np.einsum("oc,cp->po", RGB_TO_XYZ, rgb[0, :, 0].astype(np.float64))
    x, y, z = xyz.T
    v = np.where(x > 0, y * (1.33 * (1 + (y + z) / np.where(x > 0, x, 1)) - 1.68), 0)
    viewer = cone_threshold_cd_m2(50)
    cones, rods = viewer / cone_threshold_cd_m2(adapted), viewer / rod_threshold_cd_m2(adapted)
    expected = (cones * y + 0.04 / (0.04 + y) * rods * v) / 100
    actual = shown(rgb, adapted, Tone(Operator.DURAND, Hue.CLIP))
    assert actual == pytest.approx(np.minimum(rgb[0, :, 0] / y * expected, 1), rel=2e-5)


def test_in_the_dark_durand_shows_blue_brighter_than_red_of_the_same_luminance() -> None:
    """Purkinje: rods see blue 18 times as well as red, by Larson's ratio."""
    rgb = np.zeros((1, 3, 1, 2), np.float32)
    rgb[0, 0, 0, 0], rgb[0, 2, 0, 1] = 1e-4 / 0.2126, 1e-4 / 0.0722
    red, blue = luminance(shown(rgb, 1e-4, Tone(Operator.DURAND))[:, None])[0]
    assert blue / red == pytest.approx(7.187 / 0.3979, rel=0.15)


# Hues


@pytest.mark.parametrize("operator", WITHOUT_FILE)
def test_components_keep_their_ratio_when_divided_by_the_largest(operator: Operator) -> None:
    """KRI 4.30."""
    rgb = colours(300)
    image = shown(rgb, 0.5, Tone(operator, Hue.RGB))
    visible = rgb[0, :, 0].min(0) > 1e-3
    assert image.max() <= 1
    ratio = rgb[0, :, 0] / rgb[0, :, 0].max(0)
    assert (image / image.max(0))[:, visible] == pytest.approx(ratio[:, visible], rel=1e-5)
    assert np.any(image.max(0) == 1)


def test_luminance_ends_at_one_when_chromaticity_is_kept() -> None:
    """KRI 4.28 with E5, by colour-science, for colours that the display has at that luminance."""
    import colour

    random = np.random.default_rng(2)
    rgb = (random.uniform(0.8, 1.0, (3, 200)) * 10 ** random.uniform(-1, 3, 200)).astype(np.float32)
    tone_ = Tone(Operator.WARD, Hue.XYY)
    image = shown(rgb[None, :, None], 10.0, tone_)
    scene, display = (colour.XYZ_to_xyY((RGB_TO_XYZ @ values).T) for values in (rgb.astype(np.float64), image))
    gain = shown(greys([1.0]), 10.0, tone_)[0, 0]
    inside = image.max(0) < 1
    assert display[inside, :2] == pytest.approx(scene[inside, :2], abs=1e-6)
    assert display[inside, 2] == pytest.approx(np.minimum(1, gain * scene[inside, 2]), rel=1e-5)
    assert inside.sum() > 50
    assert (gain * scene[~inside, 2]).min() > 0.8


def test_a_bright_red_lamp_is_red_if_hue_is_kept_and_turns_white_if_it_is_not() -> None:
    """KRI figure 6.16."""
    lamp = np.array([500.0, 50.0, 30.0], np.float32)[None, :, None, None]
    for operator in (Operator.ACES, Operator.REINHARD, Operator.WARD):
        clipped = shown(lamp, 1.0, Tone(operator, Hue.CLIP))[:, 0]
        kept = shown(lamp, 1.0, Tone(operator, Hue.RGB))[:, 0]
        assert clipped == pytest.approx([1, 1, 1], abs=0.05)
        assert kept == pytest.approx([1, 0.1, 0.06], rel=1e-5)


def test_by_day_ward_and_durand_agree() -> None:
    ramp = greys(np.geomspace(300, 3e4, 20))
    ward, durand = (shown(ramp, 1e4, Tone(operator)) for operator in (Operator.WARD, Operator.DURAND))
    assert durand == pytest.approx(ward, rel=2e-3)
    assert rod_threshold_cd_m2(1e-4) < cone_threshold_cd_m2(1e-4) / 50
