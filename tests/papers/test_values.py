"""Values that the papers give, or that follow from their equations by hand."""

import math

import numpy as np
import pytest

from pipeline import threshold
from pipeline.effects import acuity, adaptation, tone
from pipeline.optics import analytic, pupil, radial


def test_watson_yellott() -> None:
    assert pupil.watson_yellott_mm(1, 900, 45) == pytest.approx(5.240, abs=5e-4)


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
