"""Effects and methods that are off by default, in float32 beside the same equations in float64 (plain_options.py).

The tolerances are stated in docs/hard-cases.md.
"""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import plain_options
import pytest
from hard_frames import every_adapted, every_frame, of_name
from numpy.typing import NDArray

from entoptic.pipeline import Display, View
from entoptic.pipeline.effects import acuity, afterimage, rod_noise, tone
from entoptic.pipeline.effects.acuity import Acuity, AcuityMethod
from entoptic.pipeline.effects.afterimage import Afterimage, Retina
from entoptic.pipeline.effects.night_colour import NightColour, NightMethod, shift
from entoptic.pipeline.effects.night_colour.share import adapted_share
from entoptic.pipeline.effects.night_colour.tints import tint, weights
from entoptic.pipeline.effects.rod_noise import RodNoise
from entoptic.pipeline.effects.tone import Hue, Operator, Tone
from entoptic.pipeline.oracles import adaptation, night_colour, operators
from entoptic.pipeline.oracles import tone as plain_tone

Reals = NDArray[np.float64]

NOISES = [RodNoise(on=True), RodNoise(on=True, seed=2**32 - 1, grain_deg=0.25, below_cd_m2=1.0, own_light=True)]


@every_frame
@pytest.mark.parametrize("settings", NOISES, ids=["default", "own light"])
@pytest.mark.parametrize("elapsed_s", [0.0, 1.2345, 3600.05])
@pytest.mark.parametrize("pupil_diameter_mm", [2.0, 7.0])
def test_rod_noise_is_within_1e_6(name: str, settings: RodNoise, elapsed_s: float, pupil_diameter_mm: float) -> None:
    """Of the pixel, before or after; the light of heat, 1e-4 cd/m², is rounded as well where it is all there is."""
    rgb, exact = of_name(name)
    image = rod_noise.add_noise(jnp.asarray(rgb)[None], elapsed_s, [pupil_diameter_mm], 14.0, settings)
    truth = plain_options.rod_noise(exact, elapsed_s, pupil_diameter_mm, 14.0, settings)
    assert np.abs(truth - exact).max() > 1e-4
    apart = np.abs(np.asarray(image)[0] - truth)
    assert (apart <= 1e-6 * np.maximum(exact, truth) + (3e-10 if settings.own_light else 0)).all()


@every_frame
@pytest.mark.parametrize(
    ("ppd", "display_limit"), [(3.0, False), (6.0, False), (14.0, False), (14.0, True), (20.0, True)]
)
def test_krawczyks_acuity_is_within_2e_4_of_the_pixel_and_2e_7_cd_m2(
    name: str, ppd: float, display_limit: bool
) -> None:
    """Before or after; the display's σ² is taken from the eye's, so where the two are close rounding counts most."""
    rgb, exact = of_name(name)
    settings = Acuity(method=AcuityMethod.KRAWCZYK, display_limit=display_limit)
    image = np.asarray(acuity.reduce_acuity(jnp.asarray(rgb)[None], ppd, settings))[0]
    truth = plain_options.krawczyk(exact, ppd, display_limit)
    assert np.abs(truth - exact).max() > 1e-3
    apart = np.abs(image - truth)
    assert (apart <= 2e-4 * np.maximum(exact, truth).max(axis=0) + 2e-7).all()


def displayed(exact: Reals, adapted: float) -> Reals:
    return plain_tone.aces(exact, adaptation.exposure(adapted), 100.0)


def lui_of_each_pixel(shown: Reals, exact: Reals, _: float) -> Reals:
    share = 0.04 / (0.04 + adaptation.luminance(exact))
    return night_colour.towards(shown, np.array(night_colour.TINT), share)


def lui_mesopic(shown: Reals, _: Reals, adapted: float) -> Reals:
    return night_colour.towards(shown, np.array(night_colour.TINT), plain_options.mesopic_share(adapted))


def rods(shown: Reals, _: Reals, adapted: float) -> Reals:
    method, share = NightMethod.RODS, adaptation.rod_share(adapted)
    return night_colour.towards(shown, tint(method, adapted), share, weights(method))


def rods_mesopic(shown: Reals, _: Reals, adapted: float) -> Reals:
    method, share = NightMethod.RODS, plain_options.mesopic_share(adapted)
    return night_colour.towards(shown, tint(method, adapted), share, weights(method))


NIGHTS = {
    "lui, per pixel": (NightColour(per_pixel=True), lui_of_each_pixel),
    "lui, mesopic": (NightColour(mesopic=True), lui_mesopic),
    "rods": (NightColour(NightMethod.RODS), rods),
    "rods, mesopic": (NightColour(NightMethod.RODS, mesopic=True), rods_mesopic),
}


@every_frame
@every_adapted
@pytest.mark.parametrize("way", NIGHTS)
def test_rods_colour_and_mesopic_shares_are_within_2e_6(name: str, adapted: float, way: str) -> None:
    """Of the largest component."""
    rgb, exact = of_name(name)
    shown = displayed(exact, adapted)
    settings, plainly = NIGHTS[way]
    image = np.asarray(shift(jnp.asarray(shown, jnp.float32)[None], [adapted], settings, jnp.asarray(rgb)[None]))[0]
    truth = plainly(shown, exact, adapted)
    # By day a tint brings no more than a thousandth above the peak, which is left to be clipped.
    if adapted < 1 or settings.per_pixel:
        truth = night_colour.within_peak(truth)
    apart = np.abs(image - truth) / np.maximum(shown.max(axis=0), 1e-30)
    assert apart.max() <= 2e-6


@pytest.mark.parametrize("adapted", [1e-6, 0.003, 0.04, 0.5, 3.0, 4.99, 5.01, 1e4])
def test_the_mesopic_share_is_float64_itself(adapted: float) -> None:
    share = float(adapted_share(np.array([adapted]), NightColour(mesopic=True))[0])
    assert share == pytest.approx(plain_options.mesopic_share(adapted), rel=1e-12, abs=1e-12)


CURVE = ([-3.0, -1.5, 0.0, 1.0, 2.0], [0.01, 0.1, 0.45, 0.85, 1.0])
HUES = {
    Hue.CLIP: operators.clipped,
    Hue.RGB: operators.divided,
    Hue.XYY: operators.same_chromaticity,
}


@every_frame
@every_adapted
@pytest.mark.parametrize("hue", HUES)
def test_a_persons_curve_is_within_2e_5(name: str, adapted: float, hue: Hue, tmp_path: Path) -> None:
    """Half of it is the table, straight lines in place of the cubics."""
    rgb, exact = of_name(name)
    file = tmp_path / "curve.csv"
    rows = "".join(f"{log},{share}\n" for log, share in zip(*CURVE, strict=True))
    file.write_text(f"log10_of_adapted,share\n{rows}", encoding="utf-8")
    shown = tone.show(
        jnp.asarray(rgb)[None], [adapted], [adapted], Tone(Operator.CURVE, hue, curve=str(file)), Display()
    )
    truth = HUES[hue](operators.own_curve(exact, adapted, *CURVE))
    np.testing.assert_allclose(np.asarray(shown)[0], truth, rtol=2e-5, atol=1e-12)


PUPIL_MM = 6.0
WIDE = View(256, 169, 80.0)
"""Two pixels to a node, and of the last row's nodes one."""
GAZES = [((128.0, 84.5), (160.0, 100.0)), ((300.0, -40.0), (20.0, 10.0))]
"""Where the eye has looked, px, and where it looks then; from the second the frame is far aside."""


def wide(name: str) -> NDArray[np.float32]:
    return np.tile(of_name(name)[0], (1, 3, 4))[:, : WIDE.height_px, : WIDE.width_px]


def stared(name: str, gaze_px: tuple[float, float], dt_s: float) -> tuple[Retina, Reals]:
    """The retina after a frame was looked at, and what is bleached in float64."""
    rgb = wide(name)
    rested = afterimage.rested(Afterimage(on=True, cell_deg=1.5))
    retina = afterimage.step(
        rested, jnp.asarray(rgb), WIDE, gaze_px, pupil_diameter_mm=PUPIL_MM, openness=1.0, dt_s=dt_s, exposure=1.0
    )
    cells = rested.bleached.shape[1]
    return retina, plain_options.bleached(rgb.astype(np.float64), WIDE, gaze_px, PUPIL_MM, dt_s, cells)


@every_frame
@pytest.mark.parametrize("gaze_px", [gaze for gaze, _ in GAZES])
@pytest.mark.parametrize("dt_s", [0.05, 10.0, 1e4])
def test_bleaching_is_within_1e_5_of_all_pigment(name: str, gaze_px: tuple[float, float], dt_s: float) -> None:
    """1e-4 beside a sun, whose edge is steep: where a cell looks is float32 too."""
    retina, truth = stared(name, gaze_px, dt_s)
    assert truth.max() > 1e-8
    apart = np.abs(np.asarray(retina.bleached, np.float64) - truth)
    assert apart.max() <= (1e-4 if name == "sun" else min(1e-5, 2e-5 * truth.max() + 1e-8))


WITHIN = {1e-6: 2e-3, 0.01: 5e-4}
"""An eye adapted to the dark sees its own light ten thousand times brighter, and its rounding too. The others: 5e-5."""


@every_frame
@every_adapted
@pytest.mark.parametrize(("gaze_px", "then_px"), GAZES)
def test_afterimages_are_within_5e_5_of_the_displays_peak(
    name: str, adapted: float, gaze_px: tuple[float, float], then_px: tuple[float, float]
) -> None:
    """From the scene's light to what is shown, float32 all the way beside float64 all the way."""
    exposure = adaptation.exposure(adapted)
    shown = displayed(wide(name).astype(np.float64), adapted)
    for dt_s in (0.05, 10.0, 1e4):
        retina, bleached = stared(name, gaze_px, dt_s)
        image = afterimage.show(
            jnp.asarray(shown, jnp.float32)[None], [Retina(retina.bleached, exposure)], WIDE, [then_px]
        )
        truth = plain_options.with_afterimage(shown, bleached, exposure, WIDE, then_px)
        if name != "starlight" and adapted <= 50 and dt_s >= 10:
            assert np.abs(truth - shown).max() > 0.01
        assert np.abs(np.asarray(image)[0] - truth).max() <= WITHIN.get(adapted, 5e-5)
