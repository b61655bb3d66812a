"""What is said of a tile before tone mapping holds after it, and in code values."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.display_light import black_share
from entoptic.pipeline.effects import tone
from entoptic.pipeline.effects.tone import Hue, Operator, Tone
from entoptic.pipeline.frame import Display, Encoding
from entoptic.pipeline.measure import luminance
from entoptic.pipeline.ranges import Change, Range

TILE_PX, SIDE_PX = 4, 12
OPERATORS = [(operator, hue) for operator in Operator for hue in Hue]
DISPLAYS = st.builds(
    Display,
    peak_cd_m2=st.sampled_from([40.0, 100.0, 1000.0]),
    black_cd_m2=st.sampled_from([0.0, 0.5]),
    surround_cd_m2=st.sampled_from([0.0, 300.0]),
    encoding=st.sampled_from(Encoding),
)


def tiles(values: np.ndarray) -> np.ndarray:
    """The pixels of each tile, (channel, row, column, pixel)."""
    count = SIDE_PX // TILE_PX
    cut = values.reshape(-1, count, TILE_PX, count, TILE_PX)
    return cut.transpose(0, 1, 3, 2, 4).reshape(-1, count, count, TILE_PX**2)


def with_luminance(rgb: np.ndarray) -> np.ndarray:
    return np.concatenate([rgb, luminance(np.asarray(rgb, np.float64))[None]])


def range_of(rgb: np.ndarray) -> Range:
    pixels = np.maximum(tiles(with_luminance(rgb)), 0)
    return Range(pixels.min(-1), pixels.max(-1), TILE_PX)


def change_of(before: np.ndarray, after: np.ndarray) -> Change:
    difference = with_luminance(np.asarray(after, np.float64)) - with_luminance(np.asarray(before, np.float64))
    return tiles(np.abs(difference)).max(-1)


@dataclasses.dataclass(frozen=True, eq=False)
class Pair:
    """A frame and the same frame changed."""

    before: np.ndarray
    after: np.ndarray


@st.composite
def pairs(draw: st.DrawFn) -> Pair:
    """Frames of any brightness and contrast, tiles of one colour among them, changed by little or much."""
    random = np.random.default_rng(draw(st.integers(0, 10**6)))
    decades, level, step = draw(st.sampled_from([0.0, 0.3, 3.0])), draw(st.floats(-5, 5)), draw(st.floats(-6, 3))
    saturated = draw(st.booleans())
    rgb = 10 ** (level + decades * random.standard_normal((3, SIDE_PX, SIDE_PX)))
    if saturated:
        rgb[random.integers(3)] *= -0.05
    rgb[:, :TILE_PX, :TILE_PX] = rgb[:, :1, :1]
    change = random.uniform(-1, 1, rgb.shape) * 10 ** (level + step)
    if draw(st.booleans()):
        change[:] = np.abs(change[:1])  # grey, upwards
    return Pair(rgb.astype(np.float32), (rgb + change).astype(np.float32))


def shown_frame(rgb: np.ndarray, adapted: float, target: float, settings_: Tone, display: Display) -> np.ndarray:
    return np.asarray(tone.show(rgb[None], [adapted], [target], settings_, display))[0].astype(np.float64)


@pytest.fixture(scope="module")
def curve_file(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("curve") / "own.csv"
    path.write_text("log10_of_adapted,share\n-2,0.01\n-1,0.05\n0,0.2\n0.5,0.2\n1,0.6\n2,1\n")
    return str(path)


def tone_of(operator: Operator, hue: Hue, curve_file: str, white: float = 2.0) -> Tone:
    return Tone(operator, hue, white, curve_file if operator is Operator.CURVE else "")


@pytest.mark.parametrize(("operator", "hue"), OPERATORS)
@given(pairs(), st.floats(-5, 5), st.floats(-5, 5), st.sampled_from([0.7, 2.0, 30.0]), DISPLAYS)
def test_nothing_is_shown_or_changed_beyond_the_bounds(
    operator: Operator,
    hue: Hue,
    curve_file: str,
    pair: Pair,
    log_adapted: float,
    log_target: float,
    white: float,
    display: Display,
) -> None:
    state = (10**log_adapted, 10**log_target, tone_of(operator, hue, curve_file, white), display)
    before, after = (shown_frame(rgb, *state) for rgb in (pair.before, pair.after))
    range_, change = range_of(pair.before), change_of(pair.before, pair.after)

    said = tone.shown(range_, *state)
    pixels = tiles(with_luminance(before))
    assert np.all(pixels >= (said.low * (1 - 1e-5) - 2e-6)[..., None])
    assert np.all(pixels <= (said.high * (1 + 1e-5) + 2e-6)[..., None])
    assert said.low.min() >= 0
    assert said.high.max() <= 1 + 1e-12

    # Where a hue lies on the display's edge, float32 says to 1e-5.
    rounding = 2e-5 if hue is Hue.OKLAB else 2e-6
    passed = tone.propagate(change, range_, *state)
    assert np.all(change_of(before, after) <= passed * (1 + 1e-5) + rounding)

    codes = tone.code_values(passed + rounding, said, display)
    difference = np.abs(encoded(after, display) - encoded(before, display))
    assert np.all(tiles(difference).max((0, -1)) <= codes * (1 + 1e-5))


def encoded(linear: np.ndarray, display: Display) -> np.ndarray:
    """Code values before rounding, by colour-science."""
    import colour

    black = black_share(display)
    share = np.clip((linear - black) / (1 - black), 0, 1)
    if display.encoding in (Encoding.SRGB, Encoding.LINEAR):
        return 255 * np.asarray(colour.models.eotf_inverse_sRGB(share))
    hdr = display.encoding is Encoding.HDR10
    wide = "ITU-R BT.2020" if hdr else "Display P3"
    matrix = colour.matrix_RGB_to_RGB(colour.RGB_COLOURSPACES["ITU-R BT.709"], colour.RGB_COLOURSPACES[wide])
    if hdr:
        light = np.einsum("oi,iyx->oyx", matrix, share) * display.peak_cd_m2
        return 1023 * np.asarray(colour.models.eotf_inverse_ST2084(light))
    return 255 * np.asarray(colour.models.eotf_inverse_sRGB(np.einsum("oi,iyx->oyx", matrix, share)))


@pytest.mark.parametrize(("operator", "hue"), OPERATORS)
def test_a_small_change_of_an_even_tile_is_bounded_within_a_few_times_what_it_does(
    operator: Operator, hue: Hue, curve_file: str
) -> None:
    """Not only safe: a bound of everything would be of no use. Of a component for itself it is sharp."""
    rgb = np.full((3, SIDE_PX, SIDE_PX), 3.0, np.float32)
    after = rgb * np.float32(1.01)
    state = (0.7, 0.7, tone_of(operator, hue, curve_file), Display())
    actual = change_of(shown_frame(rgb, *state), shown_frame(after, *state))
    said = tone.propagate(change_of(rgb, after), range_of(rgb), *state)
    sharp = operator is Operator.WARD or (operator, hue) == (Operator.ACES, Hue.CLIP)
    assert np.all(said <= actual * (1.03 if sharp else 4))


def test_no_change_stays_none() -> None:
    rgb = np.random.default_rng(1).random((3, SIDE_PX, SIDE_PX)).astype(np.float32)
    said = tone.propagate(np.zeros((4, 3, 3)), range_of(rgb), 1.0, 1.0, Tone(), Display())
    assert said.max() == 0
    assert tone.code_values(said, range_of(rgb), Display()).max() == 0
