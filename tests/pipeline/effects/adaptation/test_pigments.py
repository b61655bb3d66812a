"""Bleaching, against its differential equation and against what was measured on eyes."""

import math

import colour
import numpy as np
import pytest
import scipy.integrate

from entoptic.pipeline.effects.adaptation import (
    Bleaching,
    Pigments,
    equivalent_cd_m2,
    sensitivity,
    settled,
    step_pigments,
)
from entoptic.pipeline.effects.adaptation.pigments import (
    DARK_CD_M2,
    SCOTOPIC_PER_PHOTOPIC,
    TAU_S,
    UNBLEACHED,
    threshold_in_the_dark_cd_m2,
)
from entoptic.pipeline.threshold import threshold_cd_m2

KINDS = (Bleaching.PATTANAIK, Bleaching.RUSHTON)


def test_half_is_left_at_the_published_light() -> None:
    assert settled(2e6, Bleaching.PATTANAIK).cones == pytest.approx(0.5)
    assert settled(0.04, Bleaching.PATTANAIK).rods == pytest.approx(0.5)
    # 20,000 td (Rushton & Henry 1968) through a pupil of 2 mm.
    assert settled(10**4.3 / math.pi, Bleaching.RUSHTON, 2.0).cones == pytest.approx(0.5)


def test_scotopic_light_of_daylight_is_larsons() -> None:
    white = colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D65"]
    x, y, z = colour.xy_to_XYZ(white)
    assert pytest.approx(1.33 * (1 + (y + z) / x) - 1.68, abs=5e-3) == SCOTOPIC_PER_PHOTOPIC


@pytest.mark.parametrize("luminance", [0.0, 0.04, 1000.0])
def test_a_step_solves_the_papers_equation(luminance: float) -> None:
    """dB/dt = (1 − B)/τ − G·B/k with k = 2.2e8 and 16 cd/m²·s (Pattanaik 2000, eq. 7)."""
    taus, ks = np.array([110.0, 400.0]), np.array([2.2e8, 16.0])
    before = Pigments(0.3, 0.6)
    solved = scipy.integrate.solve_ivp(
        lambda _, b: (1 - b) / taus - luminance * b / ks, (0, 50), (0.3, 0.6), method="LSODA", rtol=1e-10, atol=1e-12
    )
    after = step_pigments(before, luminance, 50.0, Bleaching.PATTANAIK)
    assert (after.cones, after.rods) == pytest.approx(tuple(solved.y[:, -1]), rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_half_steps_are_a_step_and_ten_thousand_do_not_drift(kind: Bleaching) -> None:
    start, whole = Pigments(0.4, 0.2), step_pigments(Pigments(0.4, 0.2), 20.0, 100.0, kind)
    stepped = start
    for _ in range(10_000):
        stepped = step_pigments(stepped, 20.0, 0.01, kind)
    assert (stepped.cones, stepped.rods) == pytest.approx((whole.cones, whole.rods), rel=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_sunlight_at_24_frames_a_second_neither_oscillates_nor_ends_in_nan(kind: Bleaching) -> None:
    """A known tool's rods alternate in sign from 768 cd/m² on, and its picture stays white from then on."""
    pigments, seen = UNBLEACHED, []
    for _ in range(480):
        pigments = step_pigments(pigments, 1e5, 1 / 24, kind)
        seen.append((pigments.cones, pigments.rods))
    assert (np.diff(seen, axis=0) <= 0).all()
    assert (np.array(seen) > 0).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dt_s", [0.0, -1.0, math.nan, -math.inf])
def test_time_that_does_not_go_on_leaves_pigments_as_they_are(kind: Bleaching, dt_s: float) -> None:
    assert step_pigments(Pigments(0.4, 0.2), 1e9, dt_s, kind) == Pigments(0.4, 0.2)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("luminance", [0.0, 1e-6, 1.0, 1.6e9])
def test_after_ever_pigments_have_settled(kind: Bleaching, luminance: float) -> None:
    for dt_s in (1e9, math.inf):
        after = step_pigments(Pigments(0.4, 0.2), luminance, dt_s, kind)
        expected = settled(luminance, kind)
        assert (after.cones, after.rods) == pytest.approx((expected.cones, expected.rods), rel=1e-12)
    little = step_pigments(Pigments(0.4, 0.2), luminance, 1e-9, kind)
    assert 0 < little.rods <= 0.2 + 1e-9


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("pupil_diameter_mm", [2.0, 4.0, 8.0])
def test_an_eye_that_has_settled_sees_by_the_light_not_by_what_it_bleached(
    kind: Bleaching, pupil_diameter_mm: float
) -> None:
    """The threshold of an adapted eye holds its bleaching already: never is it counted twice."""
    for luminance in 10 ** np.linspace(-6, 9, 61):
        assert equivalent_cd_m2(settled(luminance, kind, pupil_diameter_mm), kind) < luminance


@pytest.mark.parametrize("kind", KINDS)
def test_the_dark_comes_in_twenty_to_forty_minutes(kind: Bleaching) -> None:
    """LUI 2.2.2 v: 20 to 30 minutes; after a full bleach rods take 40 (Rushton 1961)."""
    pigments, seen = settled(1e6, kind), []
    for _ in range(40):
        pigments = step_pigments(pigments, 0.0, 60.0, kind)
        seen.append((threshold_in_the_dark_cd_m2(pigments, kind), equivalent_cd_m2(pigments, kind)))
    assert (np.diff(seen, axis=0) < 0).all()
    assert seen[5][0] > 1.2 * DARK_CD_M2
    assert seen[39][0] < 1.3 * DARK_CD_M2
    assert seen[39][1] < 2e-4


@pytest.mark.parametrize(
    ("trolands", "has_cone_branch"),
    [(263.0, False), (1810.0, False), (3800.0, False), (19500.0, True), (39400.0, True), (400000.0, True)],
)
def test_cones_lead_only_after_strong_light(trolands: float, has_cone_branch: bool) -> None:
    """Two minutes of light, then dark: the six curves of Hecht, Haig & Chase 1937.

    After the three stronger lights cones see first and rods take over within 20 minutes; after the weaker ones rods
    see more all along.
    """
    kind = Bleaching.RUSHTON
    pigments = step_pigments(UNBLEACHED, trolands / math.pi, 120.0, kind, 2.0)
    led_by_cones = []
    for _ in range(20):
        left = sensitivity(pigments, kind)
        led_by_cones.append(left.rods / 10**-2.86 < left.cones / 10**-0.72)
        pigments = step_pigments(pigments, 0.0, 60.0, kind)
    assert led_by_cones[0] == has_cone_branch
    assert not led_by_cones[-1]


@pytest.mark.parametrize("kind", KINDS)
def test_the_equivalent_light_lifts_the_threshold_as_much(kind: Bleaching) -> None:
    for rods in (0.0, 1e-3, 0.02, 0.2, 0.6):
        pigments = Pigments(0.5 + rods / 2, rods)
        threshold = threshold_in_the_dark_cd_m2(pigments, kind)
        light = equivalent_cd_m2(pigments, kind) / (1 - DARK_CD_M2 / threshold)
        # Up to the steps of the fits at their joints.
        assert threshold_cd_m2(light) == pytest.approx(threshold, rel=0.03)


@pytest.mark.parametrize("kind", Bleaching)
def test_without_bleaching_there_is_no_such_light(kind: Bleaching) -> None:
    assert equivalent_cd_m2(UNBLEACHED, kind) == 0
    assert sensitivity(UNBLEACHED, kind) == (1, 1)
    assert settled(1e6, Bleaching.OFF) == UNBLEACHED


@pytest.mark.parametrize("kind", KINDS)
def test_the_last_of_the_pigment_returns_without_a_step(kind: Bleaching) -> None:
    lights = [equivalent_cd_m2(Pigments(1.0, 1 - missing), kind) for missing in np.geomspace(1e-12, 0.05, 300)]
    assert lights[0] < 1e-12
    assert (np.diff(lights) > 0).all()
    # The pigment missing grows by 8.6 % from each to the next.
    assert np.diff(np.log(lights)).max() < 0.3


def test_rods_return_slower_than_cones() -> None:
    assert TAU_S == (110.0, 400.0)
    after = step_pigments(Pigments(0.0, 0.0), 0.0, 110.0, Bleaching.RUSHTON)
    assert (after.cones, after.rods) == pytest.approx((1 - math.exp(-1), 1 - math.exp(-110 / 400)))
