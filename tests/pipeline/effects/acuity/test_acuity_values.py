"""What an eye resolves, how wide the blur is, and the functions that make it cheap."""

import math

import colour
import jax
import jax.numpy as jnp
import msgspec
import numpy as np
import pytest

from entoptic.pipeline import fast_math
from entoptic.pipeline.effects.acuity import (
    Acuity,
    AcuityMethod,
    larson,
    lightness,
    limit_cd_m2,
    luminance_of,
)


@pytest.mark.parametrize(("y", "cpd"), [(1e-3, 3.007), (0.1, 11.75), (1, 31.53), (100, 47.51)])
def test_larson_resolves(y: float, cpd: float) -> None:
    assert larson.resolved_cpd(y) == pytest.approx(cpd, rel=5e-4)


@pytest.mark.parametrize("ppd", [4.0, 9.82, 30.0, 60.0, 100.0])
def test_the_limit_is_where_the_eye_resolves_what_the_display_shows(ppd: float) -> None:
    limit = limit_cd_m2(ppd, Acuity(AcuityMethod.KRAWCZYK))
    assert larson.resolved_cpd(limit) == pytest.approx(ppd / 2, rel=1e-9)
    assert larson.variance_px2(limit * 1.001, ppd, True) == 0
    assert 0 < larson.variance_px2(limit * 0.999, ppd, True) < 0.01


def test_a_display_finer_than_any_eye_is_blurred_by_day_and_a_coarse_one_never() -> None:
    # Larson's R lies between 0.756 cpd in starlight and 52.8.
    assert limit_cd_m2(106, Acuity(AcuityMethod.KRAWCZYK)) == math.inf
    assert limit_cd_m2(1.5, Acuity(AcuityMethod.KRAWCZYK)) == 0


def test_without_the_display_blur_is_krawczyks_own() -> None:
    y = np.geomspace(1e-5, 1e-2, 50)
    sigma = 9.82 / (1.86 * (17.25 * np.arctan(1.4 * np.log10(y) + 0.35) + 25.72))
    assert larson.variance_px2(y, 9.82, False) == pytest.approx(sigma**2 - (1 / 6) ** 2, rel=1e-12)


def test_blur_falls_with_light_and_stays_finite_in_the_dark() -> None:
    variance = larson.variance_px2(np.r_[0, np.geomspace(1e-12, 1e9, 500)], 20.0, True)
    assert np.isfinite(variance).all()
    assert (np.diff(variance) <= 0).all()


def test_the_frame_wide_blur_is_the_same_in_float32() -> None:
    y = np.geomspace(1e-7, 1e3, 3000)
    least = larson.display_px2(True)
    ours = larson.variance_map(jnp.asarray(y, jnp.float32), np.float32(20), np.float32(least))
    assert np.asarray(ours) == pytest.approx(larson.variance_px2(y, 20.0, True), rel=2e-4, abs=2e-5)


def test_lightness_is_cielab_there_and_back() -> None:
    y = np.r_[0, np.geomspace(1e-6, 1.6e9, 5000)].astype(np.float32)
    assert np.asarray(lightness(y)) == pytest.approx(colour.colorimetry.lightness_CIE1976(y, 100), rel=2e-6)
    assert np.asarray(luminance_of(lightness(y))) == pytest.approx(y, rel=2e-5)


def test_cheap_functions_are_the_real_ones() -> None:
    x = np.geomspace(1e-37, 1e37, 100001).astype(np.float32)
    assert np.abs(np.asarray(jax.jit(fast_math.cube_root)(x)) / np.cbrt(x.astype(float)) - 1).max() < 3e-7
    x = np.linspace(-126, 126, 100001).astype(np.float32)
    assert np.abs(np.asarray(jax.jit(fast_math.exp2)(x)) / np.exp2(x.astype(float)) - 1).max() < 3e-7
    x = np.r_[-np.geomspace(1e-20, 1e30, 50001)[::-1], 0, np.geomspace(1e-20, 1e30, 50001)].astype(np.float32)
    assert np.abs(np.asarray(jax.jit(fast_math.arctan)(x)) - np.arctan(x.astype(float))).max() < 5e-7


def test_settings_refuse_what_they_do_not_know() -> None:
    with pytest.raises(msgspec.ValidationError, match="method"):
        msgspec.convert({"method": "sharp"}, Acuity)
    with pytest.raises(msgspec.ValidationError, match="unknown field"):
        msgspec.convert({"sigma": 1.0}, Acuity)
