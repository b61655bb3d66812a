"""Values that the papers give, or that follow from their equations by hand."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from entoptic.pipeline import mesopic, threshold
from entoptic.pipeline.effects import acuity, adaptation, night_colour, tone
from entoptic.pipeline.effects.acuity import larson
from entoptic.pipeline.effects.night_colour import tints
from entoptic.pipeline.optics import analytic, pupil, radial


def test_watson_yellott() -> None:
    assert pupil.watson_yellott_mm(1, 900, 45) == pytest.approx(5.240, abs=5e-4)


@pytest.mark.parametrize(("luminance", "pupil_diameter_mm"), [(0.01, 6.040), (10.0, 2.908), (1000.0, 2.135)])
def test_moon_and_spencers_pupil(luminance: float, pupil_diameter_mm: float) -> None:
    """4.9 − 3·tanh(0.4·(log10 L + 1)): the pupil by which rods' colour counts trolands."""
    assert tints._pupil_diameter_mm(luminance) == pytest.approx(pupil_diameter_mm, abs=5e-4)


@pytest.mark.parametrize(
    ("luminance", "cones", "rods", "k", "both"),
    [
        (0.01, 0.19328, 0.0054723, 0.0, 0.0054723),
        (0.1, 0.23164, 0.040272, 0.13334, 0.065789),
        (1, 0.39130, 0.40272, 0.66386, 0.39514),
    ],
)
def test_thresholds(luminance: float, cones: float, rods: float, k: float, both: float) -> None:
    assert threshold.cone_threshold_cd_m2(luminance) == pytest.approx(cones, rel=2e-5)
    assert threshold.rod_threshold_cd_m2(luminance) == pytest.approx(rods, rel=2e-5)
    assert threshold.cone_share(luminance) == pytest.approx(k, abs=5e-6)
    assert threshold.threshold_cd_m2(luminance) == pytest.approx(both, rel=2e-5)


def test_threshold_of_cones_in_daylight() -> None:
    assert threshold.cone_threshold_cd_m2(100) == pytest.approx(5.5590, rel=2e-5)


@pytest.mark.parametrize("luminance", [0.0, 0.03, 0.0300000001, 0.03006, 1e-30, 1e12])
def test_thresholds_are_finite_at_their_branch_points(luminance: float) -> None:
    assert math.isfinite(threshold.threshold_cd_m2(luminance))


@pytest.mark.parametrize(("adapted", "key"), [(0.001, 0.0302), (0.01, 0.0322), (0.1, 0.0503)])
def test_key(adapted: float, key: float) -> None:
    assert adaptation.exposure(adapted) * adapted == pytest.approx(key, abs=5e-5)


@pytest.mark.parametrize(("component", "volume"), [("f0", 0.99909), ("f1", 0.99991), ("f2", 0.99994), ("f3", 1.0001)])
def test_volume_of_spe_components(component: str, volume: float) -> None:
    assert radial.hemisphere_volume(getattr(analytic, component)) == pytest.approx(volume, abs=5e-5)


@pytest.mark.parametrize(("age", "scattered"), [(20, 0.363), (60, 0.445)])
def test_light_scattered_beyond_a_twentieth_of_a_degree(age: float, scattered: float) -> None:
    def density(deg: np.ndarray) -> np.ndarray:
        return analytic.spe(deg, 1000, age)

    beyond = radial.hemisphere_volume(density) - float(radial.encircled(density, 0.05))
    assert beyond == pytest.approx(scattered, abs=5e-4)


@pytest.mark.parametrize(
    ("adapted", "weights"), [(100, analytic.PHOTOPIC), (1e-4, analytic.SCOTOPIC), (math.sqrt(0.03), analytic.MESOPIC)]
)
def test_spe_weights_at_its_three_states(adapted: float, weights: np.ndarray) -> None:
    assert analytic.spe_weights(adapted, 0) == pytest.approx(weights, abs=1e-12)


def test_lightness_is_cielab() -> None:
    import colour

    y = np.geomspace(1e-4, 1e4, 200).astype(np.float32)
    expected = colour.colorimetry.lightness_CIE1976(y, 100)
    assert np.asarray(acuity.lightness(y)) == pytest.approx(expected, rel=1e-5, abs=1e-5)
    assert np.asarray(acuity.luminance_of(acuity.lightness(y))) == pytest.approx(y, rel=2e-5)


def test_acuity_ends_at_lightness_one() -> None:
    assert pytest.approx(0.1107, abs=1e-4) == acuity.LIMIT_CD_M2


def test_aces_is_monotonic_from_black_to_white() -> None:
    x = np.concatenate([[0], np.geomspace(1e-6, 1e9, 1000)]).astype(np.float32)
    frame = np.broadcast_to(x, (1, 3, 1, x.size))
    y = np.asarray(tone.aces(frame, np.ones(1), 100.0))[0, 0, 0]
    assert y[0] == 0
    assert y[-1] == 1
    assert np.all(np.diff(y) >= 0)


JOINTS = [
    (threshold.cone_threshold_cd_m2, 10**-2.6, 1e-3),
    (threshold.cone_threshold_cd_m2, 10**1.9, 0.01),
    (threshold.rod_threshold_cd_m2, 10**-3.94, 1e-3),
    (threshold.rod_threshold_cd_m2, 10**-1.44, 0.03),
    (threshold.threshold_cd_m2, 0.03, 1e-6),
    (threshold.threshold_cd_m2, 3.0, 1e-3),
]


@pytest.mark.parametrize(("of", "joint", "rounding"), JOINTS)
def test_thresholds_meet_at_their_joints(of: Callable[[float], float], joint: float, rounding: float) -> None:
    """As near as the papers' three digits let them: 3 % where rods leave their curve for Weber's law."""
    assert of(joint * (1 - 1e-9)) == pytest.approx(of(joint * (1 + 1e-9)), rel=rounding)


@pytest.mark.parametrize(("luminance", "tau_s"), [(0.04, 0.25), (0.0, 0.4), (0.36, 0.13), (4e6, 0.1)])
def test_time_constants_between_rods_and_cones(luminance: float, tau_s: float) -> None:
    """LUI 5.3–5.4: after τ, 1/e of the way is left."""
    assert adaptation.adapt_cd_m2(luminance + 1, luminance, tau_s) - luminance == pytest.approx(1 / math.e, rel=1e-6)


@pytest.mark.parametrize(("luminance", "rods"), [(0.0, 1.0), (0.01, 0.8), (0.04, 0.5), (0.36, 0.1), (3.96, 0.01)])
def test_rods_share(luminance: float, rods: float) -> None:
    assert adaptation.rod_sensitivity(luminance) == pytest.approx(rods, rel=1e-12)


@pytest.mark.parametrize("rods", [0.0, 0.5, 1.0])
def test_lui_tint_of_grey(rods: float) -> None:
    grey = np.full((1, 3, 1, 1), 0.25, np.float32)
    tinted = np.asarray(night_colour.night_tint(grey, np.array([rods])))[0, :, 0, 0]
    assert tinted == pytest.approx(0.25 * (1 - rods + np.array([1.05, 0.97, 1.27]) * rods), rel=1e-6)


@pytest.mark.parametrize(("lightness", "sigma_px"), [(0.0, 1.0), (0.25, 0.75), (0.5, 0.5), (1.0, 0.0)])
def test_the_fast_fit_blurs_by_one_less_lightness(lightness: float, sigma_px: float) -> None:
    """LUI 5.16, read off a point of light between alike dark pixels, whose own weight is what the blur leaves."""
    y = lightness * acuity.LIMIT_CD_M2
    weights = [math.exp(-k * k / (2 * sigma_px**2)) if sigma_px else float(k == 0) for k in range(-3, 4)]
    spot = 1e-3 * acuity.LIMIT_CD_M2
    frame = np.full((1, 3, 9, 9), y, np.float32)
    frame[:, :, :, 4] += np.float32(spot)  # a line: the vertical pass finds nothing to blur
    change = np.asarray(acuity.dark_acuity(frame), np.float64)[0, 1, 4, 4] - y
    assert change == pytest.approx(spot * weights[3] / sum(weights), rel=3e-3)


@pytest.mark.parametrize("peak_cd_m2", [50.0, 100.0, 400.0, 1000.0])
def test_the_curves_are_inverted_exactly(peak_cd_m2: float) -> None:
    """Where the display is full, and where it shows middle grey."""
    full = tone.ceiling_cd_m2(0.2, peak_cd_m2)
    frame = np.array([full * (1 - 1e-4), full * (1 + 1e-4)], np.float32)
    below, above = np.asarray(tone.aces(np.broadcast_to(frame, (1, 3, 1, 2)), np.array([0.2]), peak_cd_m2))[0, 0, 0]
    assert 0.9999 < below < above == 1
    # 0.18 through the curve by hand: 0.086724/0.324932 of 100 cd/m², on a brighter display too; a dimmer one is dimmer.
    grey = np.full((1, 3, 1, 1), 0.18 / 0.2, np.float32)
    shown_cd_m2 = np.asarray(tone.aces(grey, np.array([0.2]), peak_cd_m2)) * peak_cd_m2
    assert shown_cd_m2 == pytest.approx(26.690 * min(peak_cd_m2 / 100, 1), rel=2e-5)


def test_larsons_scotopic_luminance_of_d65() -> None:
    """1.33·(1 + (Y + Z)/X) − 1.68, with X and Z the right way round (E4)."""
    x, y, z = 0.9505, 1.0, 1.089
    assert y * float(mesopic.larson_ratio((y + z) / x)) == pytest.approx(2.573, abs=1e-3)


@pytest.mark.parametrize(("y", "cpd"), [(1e-3, 3.007), (0.1, 11.75), (1.0, 31.53), (100.0, 47.51)])
def test_resolved_frequency(y: float, cpd: float) -> None:
    assert float(larson.resolved_cpd(y)) == pytest.approx(cpd, abs=5e-3)
