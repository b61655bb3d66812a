"""Night colour against the papers' equations in float64, the CIE's chromaticities, and spectra from colour-science."""

from __future__ import annotations

import jax.numpy as jnp
import msgspec
import numpy as np
import pytest

from entoptic.pipeline import mesopic
from entoptic.pipeline.effects.night_colour import NightColour, NightMethod, night_tint, shift
from entoptic.pipeline.effects.night_colour.share import adapted_share, share
from entoptic.pipeline.effects.night_colour.tints import CONE_PEAKS, CONES, ROD_XY, TINT, tint
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, FrameError
from entoptic.pipeline.oracles import gamut as oracle
from entoptic.pipeline.primaries import RGB_TO_XYZ, SUM_WEIGHTS

RNG = np.random.default_rng(7)
DISPLAYED = (0.5 * RNG.random((2, 3, 9, 11))).astype(np.float32)
"""No tint brings it above the peak."""
SCENE = (DISPLAYED * np.geomspace(1e-5, 30, 11)).astype(np.float32)
ADAPTED = (0.03, 0.4)


def luminance(rgb: np.ndarray) -> np.ndarray:
    return np.tensordot(np.array(LUMINANCE_WEIGHTS), rgb.astype(np.float64), (0, 1))


def xy(rgb: np.ndarray) -> np.ndarray:
    xyz = np.tensordot(np.array(RGB_TO_XYZ), rgb, (1, 0))
    return xyz[:2] / xyz.sum(0)


def test_lui_is_equation_5_18() -> None:
    sigma = (0.04 / (0.04 + np.array(ADAPTED)))[:, None, None, None]
    tint_ = np.array([1.05, 0.97, 1.27])[:, None, None]
    expected = DISPLAYED * (1 - sigma) + tint_ * luminance(DISPLAYED)[:, None] * sigma
    shown = shift(jnp.asarray(DISPLAYED), ADAPTED, NightColour())
    assert shown.dtype == jnp.float32
    np.testing.assert_allclose(shown, expected, rtol=2e-6)
    np.testing.assert_array_equal(shown, night_tint(jnp.asarray(DISPLAYED), jnp.asarray(sigma[:, 0, 0, 0])))


def test_kri_rgb_is_equation_4_29_of_each_pixels_luminance() -> None:
    sigma = (0.04 / (0.04 + luminance(SCENE)))[:, None]
    tint_ = np.array([1.016784, 0.983176, 1.107126])[:, None, None]
    expected = DISPLAYED * (1 - sigma) + tint_ * luminance(DISPLAYED)[:, None] * sigma
    settings = NightColour(NightMethod.KRI_RGB, per_pixel=True)
    np.testing.assert_allclose(
        shift(jnp.asarray(DISPLAYED), ADAPTED, settings, jnp.asarray(SCENE)), expected, rtol=2e-6
    )


def test_kri_xy_is_equation_4_28() -> None:
    settings = NightColour(NightMethod.KRI_XY, per_pixel=True)
    shown = np.asarray(shift(jnp.asarray(DISPLAYED), ADAPTED, settings, jnp.asarray(SCENE)), dtype=np.float64)
    np.testing.assert_allclose(luminance(shown), luminance(DISPLAYED), rtol=2e-6)
    for eye in range(2):
        sigma = 0.04 / (0.04 + luminance(SCENE)[eye])
        expected = xy(DISPLAYED[eye]) * (1 - sigma) + 0.25 * sigma
        np.testing.assert_allclose(xy(shown[eye]), expected, rtol=1e-5)


@pytest.mark.parametrize("method", NightMethod)
def test_what_a_tint_brings_above_the_peak_goes_to_white_at_its_luminance_and_hue(method: NightMethod) -> None:
    """A white lamp's glow by night: pale blue, then white, without the purple of a blue that ends before red does."""
    grey = np.broadcast_to(np.linspace(0.4, 1, 400, dtype=np.float32), (1, 3, 1, 400))
    scene = np.full((1, 3, 1, 400), 0.02, np.float32)
    settings = NightColour(method, per_pixel=True)
    shown = np.asarray(shift(jnp.asarray(grey), [0.02], settings, jnp.asarray(scene)), np.float64)[0, :, 0]
    below = np.asarray(shift(jnp.asarray(grey * 0.3), [0.02], settings, jnp.asarray(scene)), np.float64)[0, :, 0]
    assert shown.max() <= 1 + 2e-7
    assert np.diff(shown).min() >= -1e-6
    y, of_the_tint = (np.array(LUMINANCE_WEIGHTS) @ rgb for rgb in (shown, below))
    np.testing.assert_allclose(y, np.minimum(of_the_tint / 0.3, 1), rtol=1e-5)
    hue, wanted = oracle.hue(shown), oracle.hue(below)
    coloured = shown.max(0) - shown.min(0) > 0.01
    if method is not NightMethod.BAR:
        assert coloured.sum() > 50
        turned = np.degrees((hue - wanted + np.pi) % (2 * np.pi) - np.pi)[coloured]
        assert np.abs(turned).max() < 3.5


def test_bar_is_equations_11_and_12() -> None:
    scene = luminance(SCENE)[:, None]
    sigma = np.where(scene > 3, 1.0, 0.069 / (0.069 + 1.409 * np.exp(-4.267 * scene)))
    expected = sigma * DISPLAYED + (1 - sigma) * luminance(DISPLAYED)[:, None]
    settings = NightColour(NightMethod.BAR, per_pixel=True)
    # The step of 5.6e-5 that the paper leaves at 3 cd/m² is spread over the curve.
    np.testing.assert_allclose(
        shift(jnp.asarray(DISPLAYED), ADAPTED, settings, jnp.asarray(SCENE)), expected, atol=6e-5
    )


def test_rods_see_reds_dark_and_blues_bright_as_the_cie_has_it() -> None:
    settings = NightColour(NightMethod.RODS, mesopic=True)
    primaries = np.eye(3, dtype=np.float32).T[None, :, None, :]
    for adapted in (0.001, 0.02, 0.4, 6.0):
        shown = np.asarray(shift(jnp.asarray(primaries), [adapted], settings))
        white_m = mesopic.adaptation_coefficient(adapted, adapted * mesopic.WHITE_RATIO)
        of_white = mesopic.mesopic_cd_m2(1.0, mesopic.WHITE_RATIO, white_m)
        expected = [
            mesopic.mesopic_cd_m2(photopic, scotopic, white_m) / of_white
            for photopic, scotopic in zip(LUMINANCE_WEIGHTS, mesopic.SCOTOPIC_WEIGHTS, strict=True)
        ]
        np.testing.assert_allclose(luminance(shown)[0, 0], expected, rtol=1e-5)


def test_white_to_rods_alone_is_jensens_blue_and_whiter_in_the_light() -> None:
    np.testing.assert_allclose(xy(tint(NightMethod.RODS, 1e-12)[:, None])[:, 0], ROD_XY, atol=1e-6)
    blue = [tint(NightMethod.RODS, luminance_cd_m2)[2] for luminance_cd_m2 in np.geomspace(1e-6, 1e3, 50)]
    assert (np.diff(blue) < 0).all()
    # The direction in which rods were matched by cones: M over L, and S, rise (Cao 2008).
    white, seen = np.array(CONES).sum(1), np.array(CONES) @ tint(NightMethod.RODS, 0.01)
    assert seen[1] / seen[0] > white[1] / white[0]
    assert seen[2] / seen[:2].sum() > white[2] / white[:2].sum()


def test_cone_responses_are_those_of_the_primaries_spectra() -> None:
    import colour

    shape = colour.SpectralShape(380, 780, 5)
    basis = colour.recovery.MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019.copy().align(shape).values
    light = colour.SDS_ILLUMINANTS["D65"].copy().align(shape).values
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape).values
    cones = colour.MSDS_CMFS["Smith & Pokorny 1975 Normal Trichromats"].copy().align(shape).values * CONE_PEAKS
    expected = (cones * light[:, None]).T @ basis / (light * observer[:, 1]).sum()
    np.testing.assert_allclose(CONES, expected, rtol=1e-5)


def test_kri_xy_of_the_primaries_is_what_their_chromaticities_say() -> None:
    """X + Y + Z over Y is 1/y, which ITU-R BT.709 says of each primary."""
    ratios = np.array(SUM_WEIGHTS) / np.array(LUMINANCE_WEIGHTS)
    np.testing.assert_allclose(ratios, 1 / np.array([0.33, 0.60, 0.06]), rtol=5e-4)


@pytest.mark.parametrize("method", NightMethod)
@pytest.mark.parametrize("settings", [{}, {"mesopic": True}, {"per_pixel": True}])
def test_black_stays_black_daylight_stays_as_it_is_and_grey_keeps_its_luminance(
    method: NightMethod, settings: dict[str, bool]
) -> None:
    night = NightColour(method, **settings)
    black = jnp.zeros((1, 3, 4, 4), jnp.float32)
    assert not np.asarray(shift(black, [1e-6], night, black)).any()
    by_day = np.asarray(shift(jnp.asarray(DISPLAYED), [1e4, 1e4], night, jnp.full_like(DISPLAYED, 1e4)))
    np.testing.assert_allclose(by_day, DISPLAYED, atol=6e-6)
    grey = jnp.full((1, 3, 2, 2), 0.3, jnp.float32)
    # LUI's tint has a luminance of 1.0087, KRI's of 0.9993.
    np.testing.assert_allclose(luminance(np.asarray(shift(grey, [0.01], night, grey))), 0.3, rtol=0.009)


@pytest.mark.parametrize("method", NightMethod)
def test_no_share_has_a_step(method: NightMethod) -> None:
    joints = np.array([0.0, 0.005 / mesopic.WHITE_RATIO, 3.0, 5.0])
    for settings in (NightColour(method), NightColour(method, mesopic=True)):
        below = adapted_share(np.maximum(joints * (1 - 1e-7), 0), settings)
        above = adapted_share(joints * (1 + 1e-7) + 1e-12, settings)
        np.testing.assert_allclose(below, above, atol=1e-6)
        shares = adapted_share(np.geomspace(1e-7, 1e5, 500), settings)
        assert (np.diff(shares) <= 0).all()
        assert shares.min() >= 0
        assert shares.max() <= 1


def test_published_shares() -> None:
    values = np.array([0.0, 0.04, 0.36])
    np.testing.assert_allclose(share(values, NightMethod.LUI), [1.0, 0.5, 0.1])
    # 1 − 0.069/1.478 at 0 (BAR 11).
    np.testing.assert_allclose(share(np.array([0.0, 3.0, 100.0]), NightMethod.BAR), [0.95332, 0, 0], atol=1e-5)


def test_a_lamp_keeps_its_colour_pixel_by_pixel() -> None:
    displayed = jnp.asarray(np.array([[0.1, 0.9], [0.05, 0.4], [0.02, 0.1]])[None, :, None], jnp.float32)
    scene = displayed * jnp.asarray([0.01, 1000.0])
    adapted = shift(displayed, [0.01], NightColour())
    by_pixel = shift(displayed, [0.01], NightColour(per_pixel=True), scene.astype(jnp.float32))
    assert float(jnp.abs(by_pixel - displayed)[..., 1].max()) < 1e-4
    assert float(jnp.abs(adapted - displayed)[..., 1].max()) > 0.1


def test_a_grey_changes_by_no_more_than_its_blue() -> None:
    """Blue, which changes most, gains 0.27·σ of itself, and v·dE/dv of the sRGB encoding E(v) is 0.44 at most."""

    def code(linear: np.ndarray) -> np.ndarray:
        return 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)

    greys = np.repeat(np.linspace(0, 1 / 1.27, 200, dtype=np.float32)[None, None, None], 3, axis=1)
    for rods in (0.01, 0.1, 1.0):
        shown = np.asarray(night_tint(jnp.asarray(greys), jnp.asarray([rods])), dtype=np.float64)
        assert np.abs(code(shown) - code(greys.astype(np.float64))).max() <= 255 * 0.44 * (max(TINT) - 1) * rods


def test_bad_settings_are_refused() -> None:
    with pytest.raises(FrameError, match="in cd/m²"):
        shift(jnp.asarray(DISPLAYED), ADAPTED, NightColour(per_pixel=True))
    with pytest.raises(ValueError, match="mesopic and per_pixel"):
        NightColour(mesopic=True, per_pixel=True)
    with pytest.raises(msgspec.ValidationError, match="mesopic and per_pixel"):
        msgspec.convert({"mesopic": True, "per_pixel": True}, NightColour)
