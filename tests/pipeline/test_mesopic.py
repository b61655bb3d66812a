"""The CIE's mesopic photometry against its published examples, its own iteration, and spectra from colour-science."""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np
import pytest

from entoptic.pipeline import mesopic

PUBLISHED_PER_CENT = {
    # S/P: mesopic over photopic luminance, at 0.01, 0.03, 0.1, 0.3 and 1 cd/m² (CIE 191:2010, table of examples).
    0.25: (-75, -52, -29, -18, -9),
    0.65: (-31, -20, -13, -8, -4),
    1.05: (4, 3, 2, 1, 1),
    1.25: (18, 13, 8, 5, 3),
    1.45: (32, 22, 15, 9, 5),
    2.05: (69, 49, 32, 21, 11),
    2.65: (101, 73, 49, 31, 16),
}


@pytest.mark.parametrize("ratio", PUBLISHED_PER_CENT)
def test_mesopic_luminances_are_those_of_cie_191(ratio: float) -> None:
    for photopic, per_cent in zip((0.01, 0.03, 0.1, 0.3, 1.0), PUBLISHED_PER_CENT[ratio], strict=True):
        m = mesopic.adaptation_coefficient(photopic, ratio * photopic)
        seen = mesopic.mesopic_cd_m2(photopic, ratio * photopic, m)
        assert round(100 * (seen / photopic - 1)) == per_cent


@pytest.mark.parametrize("ratio", [0.4, 1.0, 1.7, 2.463])
@pytest.mark.parametrize("photopic", [0.006, 0.02, 0.3, 2.0, 4.9])
def test_the_coefficient_is_where_the_cie_iteration_ends(photopic: float, ratio: float) -> None:
    m = 0.5
    for _ in range(500):
        seen = mesopic.mesopic_cd_m2(photopic, ratio * photopic, m)
        m = min(max(0.767 + 0.3334 * math.log10(seen), 0.0), 1.0)
    assert mesopic.adaptation_coefficient(photopic, ratio * photopic) == pytest.approx(m, abs=1e-9)


@pytest.mark.parametrize("ratio", [0.0, 0.1, 20.0, 100.0])
def test_where_the_cie_iteration_fails_the_equations_still_hold(ratio: float) -> None:
    for photopic in np.geomspace(1e-4, 20, 60):
        m = mesopic.adaptation_coefficient(photopic, ratio * photopic)
        seen = mesopic.mesopic_cd_m2(photopic, ratio * photopic, m)
        there = min(max(0.767 + 0.3334 * math.log10(max(seen, 1e-30)), 0.0), 1.0)
        assert there == pytest.approx(m, abs=1e-6)


def test_from_5_cd_m2_cones_alone_see_and_in_starlight_rods_alone() -> None:
    assert mesopic.adaptation_coefficient(5.0, 5.0) == 1.0
    assert mesopic.rod_share(5.0) == 0.0
    assert mesopic.adaptation_coefficient(0.002, 0.0049) == 0.0
    assert mesopic.rod_share(0.002) == 1.0
    assert mesopic.rod_share(0.0) == 1.0


def test_the_rod_share_falls_without_a_step() -> None:
    luminances = np.geomspace(1e-4, 10, 4000)
    shares = np.array([mesopic.rod_share(luminance) for luminance in luminances])
    falls = -np.diff(shares)
    assert (falls >= -1e-12).all()
    # m rises by 0.33 a decade, 0.0004 a step here, and the share not much faster.
    assert falls.max() < 0.001


def test_the_share_blends_as_cie_191_does() -> None:
    for photopic, ratio in ((0.01, 0.3), (0.3, 1.8), (2.0, 5.0)):
        m = mesopic.adaptation_coefficient(photopic, mesopic.WHITE_RATIO * photopic)
        of_white = mesopic.mesopic_cd_m2(photopic, mesopic.WHITE_RATIO * photopic, m)
        share = mesopic.rod_share(photopic)
        expected = mesopic.mesopic_cd_m2(photopic, ratio * photopic, m) / of_white
        assert (1 - share) + share * ratio / mesopic.WHITE_RATIO == pytest.approx(expected, rel=1e-12)


def test_scotopic_weights_are_those_of_the_primaries_spectra() -> None:
    import colour

    shape = colour.SpectralShape(380, 780, 5)
    basis = colour.recovery.MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019.copy().align(shape).values
    light = colour.SDS_ILLUMINANTS["D65"].copy().align(shape).values
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape).values
    rods = colour.SDS_LEFS["CIE 1951 Scotopic Standard Observer"].copy().align(shape).values
    of_white = (light * observer[:, 1]).sum()
    expected = 1699 / 683 * (basis * (light * rods)[:, None]).sum(0) / of_white
    np.testing.assert_allclose(mesopic.SCOTOPIC_WEIGHTS, expected, rtol=1e-6)
    rgb = jnp.asarray([0.2, 0.5, 0.9], jnp.float32)[:, None, None]
    seen = mesopic.scotopic_luminance(rgb)
    assert seen.dtype == jnp.float32
    np.testing.assert_allclose(seen, expected @ [0.2, 0.5, 0.9], rtol=1e-6)
