"""Pixels that break other programs: negative, black, all alike, of 15 decades, denormal. docs/hard-cases.md."""

import math

import numpy as np
import pytest
from hard_frames import EVERYTHING, UNSPREAD, VIEW, WIDTH, grey, linear, see, textured

from entoptic.pipeline import Glare, GlareModel, Planning, RenderState
from entoptic.pipeline.effects.glare.settings import Edge
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.oracles import sphere
from entoptic.pipeline.oracles.glare import STRAYLIGHT
from entoptic.pipeline.oracles.point_spread import alike, ijspeert

BAD = [-1e-6, -1.0, -1e4, -math.inf, math.nan]
Y, X = 10, 12
"""Where the bad pixel is."""
CALLED_FOR = {"adaptation", "glare", "acuity", "tone", "night_colour"}
"""What is on unless settings say otherwise."""


def changed(image: np.ndarray, clear: np.ndarray) -> list[list[int]]:
    """Rows and columns of the pixels that differ by anything at all."""
    return np.argwhere((image != clear).any(axis=2)).tolist()


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("adapted", [0.12, 1.0, 100.0])
def test_one_negative_pixel_changes_exactly_its_own_pixel(adapted: float, bad: float) -> None:
    """Without glare, to an eye that has adapted before: pfstmo_pattanaik00 makes the whole frame white."""
    # Where an eye loses detail a pixel touches those within 3 of it by right: it is put among brighter ones.
    rgb, state = np.maximum(textured(adapted), np.float32(0.12)), RenderState((adapted,))
    clear = see(rgb, state=state, glare=UNSPREAD, planning=EVERYTHING)
    rgb[Y, X] = bad
    perceived = see(rgb, state=state, glare=UNSPREAD, planning=EVERYTHING)
    assert changed(linear(perceived), linear(clear)) == [[Y, X]]
    assert changed(perceived.image[0], clear.image[0]) == [[Y, X]]
    planned = see(rgb, state=state, glare=UNSPREAD)
    assert np.abs(planned.image.astype(int) - perceived.image.astype(int)).max() <= 1


@pytest.mark.parametrize("bad", BAD)
def test_a_negative_pixel_is_a_black_one_in_every_effect(bad: float) -> None:
    """With all effects and a first frame, whose adaptation it takes part in."""
    rgb = textured(0.05)
    rgb[30, 40] = 10.0
    rgb[Y, X] = 0.0
    black = see(rgb)
    rgb[Y, X] = bad
    perceived = see(rgb)
    assert list(perceived.plan) == list(black.plan)
    assert {step.effect for step in perceived.plan if step.runs} >= CALLED_FOR
    assert perceived.state.adapted_cd_m2 == black.state.adapted_cd_m2
    assert np.array_equal(linear(perceived), linear(black))


def test_one_negative_component_leaves_its_pixels_luminance_and_all_others_as_they_are() -> None:
    rgb, state = textured(100.0), RenderState((1e6,))
    clear = linear(see(rgb, state=state, glare=UNSPREAD, planning=EVERYTHING))
    rgb[Y, X, 2] = -0.5
    image = linear(see(rgb, state=state, glare=UNSPREAD, planning=EVERYTHING))
    assert {tuple(at) for at in np.argwhere(image != clear)[:, :2]} == {(Y, X)}
    # Rods see the others there too, and tint them: 2e-8 of them to an eye adapted to 1e6 cd/m².
    assert image[Y, X, 2] < 1e-9
    lost = 0.0722 * clear[Y, X, 2]
    assert image[Y, X] @ LUMINANCE_WEIGHTS == pytest.approx(clear[Y, X] @ LUMINANCE_WEIGHTS - lost, rel=0.01)


@pytest.mark.parametrize("adapted", [1e-6, 0.01, 1.0, 1e4])
def test_a_black_frame_is_exactly_black(adapted: float) -> None:
    """pfstmo_pattanaik00 makes it white, pfstmo_reinhard02 makes it of NaN."""
    for state in (None, RenderState((adapted,))):
        perceived = see(grey(0.0), state=state, dt_s=1 / 24)
        assert not np.asarray(perceived.linear).any()
        assert not perceived.image.any()
        assert 1e-6 <= perceived.state.adapted_cd_m2[0] <= max(adapted, 1e-6)


def shown_of_grey(luminance: float) -> np.ndarray:
    """What an eye adapted to a grey sees of it, by hand: key, ACES (Narkowicz), LUI's tint; linear RGB, float64."""
    exposed = 1.03 - 2 / (2 + math.log10(luminance + 1))
    aces = min(exposed * (2.51 * exposed + 0.03) / (exposed * (2.43 * exposed + 0.59) + 0.14), 1.0)
    rods = 0.04 / (0.04 + luminance)
    return aces * (1 - rods + np.array([1.05, 0.97, 1.27]) * rods)


BRANCHES = (0.01, 0.03, 3.0, 100 * 27 / 24389)
"""Where a formula changes: BAR's k and colour discrimination, scotopic and photopic vision, CIELAB's linear part."""


@pytest.mark.parametrize(
    "luminance",
    [value for branch in BRANCHES for value in (np.nextafter(branch, 0), branch, np.nextafter(branch, 9))]
    + [1e-6, 1e-3, 0.3, 30.0, 1e3, 1e5, 1e9],
)
def test_a_frame_of_one_value_is_one_value_and_the_right_one(luminance: float) -> None:
    """pfstmo_reinhard02 makes every such frame white: 0.01 cd/m² and 1000 alike."""
    perceived = see(grey(luminance), glare=UNSPREAD)
    image = linear(perceived)
    assert (image == image[0, 0]).all()
    assert perceived.state.adapted_cd_m2[0] == pytest.approx(luminance, rel=1e-6)
    expected = shown_of_grey(luminance)
    if luminance < 2.99:
        np.testing.assert_allclose(image[0, 0], expected, rtol=1e-5)
    encoded = 255 * (1.055 * np.clip(expected, 0, 1) ** (1 / 2.4) - 0.055)
    # Rounding, and half a code value that a skipped effect may change.
    np.testing.assert_allclose(perceived.image[0, 0, 0], encoded, atol=1.0)


@pytest.mark.parametrize("branch", BRANCHES)
def test_nothing_jumps_where_a_formula_changes(branch: float) -> None:
    below, at, above = (
        linear(see(grey(value), glare=UNSPREAD))[0, 0] for value in (branch * (1 - 1e-6), branch, branch * (1 + 1e-6))
    )
    # What a skip from 3 cd/m² on takes away: half a code value.
    atol = 0.5 / 255 if branch == 3 else 0
    np.testing.assert_allclose(below, at, rtol=1e-5, atol=atol)
    np.testing.assert_allclose(above, at, rtol=1e-5, atol=atol)


SUN = (10, 12), (10, 13), (31, 40)


def star_and_sun() -> np.ndarray:
    rgb = grey(1e-6)
    for place in SUN:
        rgb[place] = 1e9
    return rgb


@pytest.mark.parametrize("adapted", [1e6, 1e7, 1e9])
def test_starlight_and_1e9_in_one_frame_are_what_float64_makes_of_them(adapted: float) -> None:
    """15 decades, with glare: what the direct sum makes of them, to more or less dazzled eyes."""
    state = RenderState((adapted,))
    model = Glare(GlareModel.IJSPEERT, edge=Edge.DARK)
    perceived = see(star_and_sun(), state=state, glare=model, planning=EVERYTHING)
    light = star_and_sun().transpose(2, 0, 1).astype(np.float64)
    veiled = sphere.glare(light, VIEW, alike(ijspeert(4.0, Observer().age_years, STRAYLIGHT[Observer().iris])))
    left_out = Planning(everything=True, leave_out=frozenset({"glare"}))
    truth = see(veiled.transpose(1, 2, 0), state=state, planning=left_out)
    assert np.isfinite(linear(perceived)).all()
    assert linear(perceived).min() >= 0
    apart = np.abs(perceived.image.astype(int) - truth.image.astype(int))
    assert np.percentile(apart, 99) <= 1
    assert [perceived.image[0][place].min() for place in SUN] == [perceived.image.max()] * len(SUN)
    assert perceived.image.max() > 200 > perceived.image.min()


def test_beside_the_sun_starlight_is_still_seen_where_no_light_scatters() -> None:
    """Each pixel by itself: an eye adapted to starlight tells 1e-6 from 0 right beside 1e9."""
    rgb = grey(1e-6)
    rgb[:, : WIDTH // 2] = 0.0
    plain = see(rgb, state=RenderState((1e-6,)), glare=UNSPREAD)
    assert plain.image[0, 20, 60].min() > plain.image[0, 20, 5].max() == 0


@pytest.mark.parametrize("luminance", [1e-45, 1e-42, 1e-38])
def test_a_frame_of_denormals_is_black(luminance: float) -> None:
    """Below the smallest normal float32: nothing divides by it, nothing overflows."""
    perceived = see(grey(luminance))
    assert perceived.image.max() == 0
    assert perceived.state.adapted_cd_m2 == (1e-6,)


@pytest.mark.parametrize("adapted", [1e-6, 0.05, 100.0])
def test_denormal_pixels_are_black_ones(adapted: float) -> None:
    rgb, state = textured(adapted), RenderState((adapted,))
    rgb[Y, X] = rgb[20, 20:30] = 0
    black = see(rgb, state=state)
    rgb[Y, X], rgb[20, 20:25], rgb[20, 25:30, 1] = 1e-42, 1e-45, 1e-39
    perceived = see(rgb, state=state)
    np.testing.assert_allclose(linear(perceived), linear(black), rtol=1e-6, atol=1e-12)


def test_a_thousand_suns_are_white() -> None:
    """Squares and sums of it still fit into float32."""
    perceived = see(grey(1.6e12), state=RenderState((1.0,)))
    assert perceived.image.min() >= 250
