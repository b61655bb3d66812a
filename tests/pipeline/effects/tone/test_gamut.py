"""Colours beyond the display's go to white: against an oracle, and as the glow of lamps shows it."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.effects import tone
from entoptic.pipeline.effects.encode import encode
from entoptic.pipeline.effects.night_colour import NightColour, NightMethod, shift
from entoptic.pipeline.effects.tone import Hue, Operator, Tone
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, Display
from entoptic.pipeline.oracles import gamut, operators

WEIGHTS = np.array(LUMINANCE_WEIGHTS)
WITHOUT_FILE = [operator for operator in Operator if operator is not Operator.CURVE]
LAMPS = {
    "white": (1.0, 1.0, 1.0),
    "red": (4.7021, 0.0, 0.0),
    "green": (0.0160, 1.3701, 0.2326),
    "blue": (0.0, 0.0, 13.8552),
    "yellow": (2.67, 0.6045, 0.0),
    "sodium": (2.9, 0.54, -0.05),
    "LED blue": (0.2, 0.45, 8.8),
}
"""Linear Rec.709 at luminance 1; the first four colours are navigation lights' (KRI), sodium's lies outside Rec.709."""


def colours(seed: int, count: int = 2400) -> np.ndarray:
    """(3, y, x): most of them saturated, some with a component below 0 as spectral colours have it."""
    random = np.random.default_rng(seed)
    rgb = random.dirichlet((0.3, 0.3, 0.3), count).T * 10 ** random.uniform(-3, 1.5, count)
    which = np.flatnonzero(random.random(count) < 0.3)
    rgb[random.integers(0, 3, len(which)), which] -= random.uniform(0, 0.3, len(which)) * (WEIGHTS @ rgb[:, which])
    return rgb.reshape(3, 40, -1).astype(np.float32)


def shown(rgb: np.ndarray, adapted: float, settings: Tone) -> np.ndarray:
    """(3, y, x) in float64."""
    return np.asarray(tone.show(jnp.asarray(rgb)[None], [adapted], [adapted], settings, Display()), np.float64)[0]


def code_values(linear: np.ndarray) -> np.ndarray:
    return 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def turned_deg(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Between Oklab's hues of colours (3, …)."""
    return np.abs(np.degrees((gamut.hue(one) - gamut.hue(other) + np.pi) % (2 * np.pi) - np.pi))


@pytest.mark.parametrize("operator", WITHOUT_FILE)
@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_oracle(operator: Operator, seed: int) -> None:
    """A table beside halved angles: worst for blues on a corner of the display's edge, where hue says little."""
    rgb = colours(seed)
    truth = operators.shown(rgb.astype(np.float64), 1.0, Tone(operator), Display())
    image = shown(rgb, 1.0, Tone(operator))
    off = np.abs(code_values(image) - code_values(truth)).max(0)
    assert np.quantile(off, 0.99) < 0.2
    assert (off > 6).sum() <= 3
    coloured = (truth.max(0) - truth.min(0) > 0.03) & (truth.max(0) > 0.1)
    assert turned_deg(image, truth)[coloured].max() < 0.8


@pytest.mark.parametrize("operator", WITHOUT_FILE)
def test_luminance_and_hue_stay(operator: Operator) -> None:
    rgb = colours(7)
    image, within = shown(rgb, 1.0, Tone(operator)), shown(rgb, 1.0, Tone(operator, Hue.RGB))
    y = np.tensordot(WEIGHTS, image, 1)
    whole = (rgb.min(0) >= 0) & (y < 0.999)
    kept = whole & (within.max(0) == 1)
    assert kept.sum() > 50
    # KRI's division keeps the components' ratio, so it says what the hue was and not how bright.
    coloured = kept & (image.max(0) - image.min(0) > 0.03)
    assert turned_deg(image, within)[coloured].max() < 1.2
    assert image.min() >= 0
    assert image.max() <= 1


@pytest.mark.parametrize("side", [(1, 1), (1, 70), (31, 33), (64, 65), (200, 3)])
def test_every_pixel_is_mapped_wherever_it_lies(side: tuple[int, int]) -> None:
    """Blocks at the frame's edges, and of two eyes with an adaptation each."""
    height, width = side
    random = np.random.default_rng(height)
    rgb = (random.random((2, 3, height, width)) ** 4 * 30).astype(np.float32)
    adapted = [0.5, 8.0]
    both = np.asarray(tone.show(jnp.asarray(rgb), adapted, adapted, Tone(), Display()), np.float64)
    for eye in range(2):
        truth = operators.shown(rgb[eye].astype(np.float64), adapted[eye], Tone(), Display())
        assert np.abs(code_values(both[eye]) - code_values(truth)).max() < 12


def test_what_the_display_has_is_untouched() -> None:
    rgb = (np.random.default_rng(0).random((3, 40, 50)) * 0.1).astype(np.float32)
    one, other = (shown(rgb, 1.0, Tone(hue=hue)) for hue in (Hue.OKLAB, Hue.RGB))
    assert one.max() < 1
    np.testing.assert_allclose(one, other, rtol=1e-6)


@given(st.integers(0, 10**6), st.floats(-3, 0), st.sampled_from(WITHOUT_FILE))
def test_a_little_more_light_changes_a_little(seed: int, log_step: float, operator: Operator) -> None:
    """No step where the display's colours end: along lines through all of them, by the bound that plans rest on."""
    random = np.random.default_rng(seed)
    at, towards = random.uniform(0, 3, (3, 1, 1)), random.uniform(0, 3, (3, 1, 1))
    rgb = (at + (towards - at) * np.linspace(0, 1, 3000)).astype(np.float32)
    image = shown(rgb, 1.0, Tone(operator))
    assert np.abs(np.diff(image)).max() < 0.02


# Lamps


def glow(lamp: tuple[float, float, float], background: float, decades: float) -> np.ndarray:
    """(3, 1, r) in cd/m²: a lamp's light falling with distance as glare's does, over a dim surround. Middle first."""
    r = np.linspace(0, 1, 1500)
    light = 10 ** (2.5 - decades * r)
    return (np.array(lamp)[:, None] * light + background)[:, None].astype(np.float32)


def perceived(rgb: np.ndarray, adapted: float, settings: Tone, night: NightColour) -> np.ndarray:
    """(3, r): through tone mapping and night colour, linear."""
    image = tone.show(jnp.asarray(rgb)[None], [adapted], [adapted], settings, Display())
    return np.asarray(shift(image, [adapted], night, jnp.asarray(rgb)[None]), np.float64)[0, :, 0]


@pytest.fixture(scope="module")
def curve_file(tmp_path_factory: pytest.TempPathFactory) -> str:
    path: Path = tmp_path_factory.mktemp("curve") / "own.csv"
    path.write_text("log10_of_adapted,share\n-2,0.01\n-1,0.05\n0,0.2\n0.5,0.3\n1,0.6\n2,1\n")
    return str(path)


NIGHTS = [NightMethod.LUI, NightMethod.KRI_RGB, NightMethod.BAR, NightMethod.RODS]


@pytest.mark.parametrize("operator", Operator)
@pytest.mark.parametrize("lamp", LAMPS)
@pytest.mark.parametrize("adapted", [0.05, 1.0])
def test_a_lamps_glow_has_no_ring(operator: Operator, lamp: str, adapted: float, curve_file: str) -> None:
    """Away from the lamp luminance never rises, and no component by more than one code value from pixel to pixel.

    All along the glow they may rise by some: what the background has of a component is compressed with the glow, most
    where a curve is flat or, with `durand`, where a lamp's red leaves rods in the dark.
    """
    some = 25 if operator in (Operator.DURAND, Operator.CURVE) else 10
    settings = Tone(operator, curve=curve_file if operator is Operator.CURVE else "")
    for method in NIGHTS:
        image = perceived(glow(LAMPS[lamp], 0.003, 6.0), adapted, settings, NightColour(method))
        y = WEIGHTS @ image
        assert np.diff(y).max() < 1e-4, method
        assert y[0] == pytest.approx(1, abs=0.03)
        rises = np.maximum(np.diff(code_values(image), axis=1), 0).sum(1)
        assert rises.max() < some, (method, rises)
        codes = encode(jnp.asarray(image, jnp.float32)[None, :, None], Display())[0, 0].astype(int)
        assert np.diff(codes, axis=0).max() <= 1


@pytest.mark.parametrize("operator", WITHOUT_FILE)
@pytest.mark.parametrize("lamp", [lamp for lamp in LAMPS if lamp != "white"])
def test_a_lamps_glow_has_one_hue(operator: Operator, lamp: str) -> None:
    """Until it is nearly white, by eyes whose cones see it: what tone mapping makes is the scene's hue everywhere."""
    rgb = glow(LAMPS[lamp], 1e-5, 5.0)
    image = shown(rgb, 1.0, Tone(operator))
    coloured = (image.max(0) - image.min(0) > 0.04) & (np.tensordot(WEIGHTS, image, 1) > 0.01)
    assert coloured.sum() > 200
    assert turned_deg(image, rgb.astype(np.float64))[coloured].max() < 1.5


def test_a_glow_clipped_by_components_has_rings_of_other_hues() -> None:
    """What the tests above would find."""
    rgb = glow(LAMPS["LED blue"], 1e-5, 5.0)
    image = shown(rgb, 1.0, Tone(hue=Hue.CLIP))
    coloured = image.max(0) - image.min(0) > 0.04
    assert turned_deg(image, rgb.astype(np.float64))[coloured].max() > 30
