"""Code values: against the standards' closed forms, colour-science, published signals, sRGB's formula in float32."""

import colour
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from entoptic.pipeline.effects import encode as module
from entoptic.pipeline.effects.encode import (
    P3,
    REC709,
    REC2020,
    encode,
    matrix,
    pq_cd_m2,
    pq_signal,
    srgb_codes,
    srgb_signal,
    staircase,
)
from entoptic.pipeline.frame import Display, Encoding

SRGB, LINEAR = Display(encoding=Encoding.SRGB), Display(encoding=Encoding.LINEAR)


def greys(values: np.ndarray) -> jax.Array:
    return jnp.asarray(np.broadcast_to(np.asarray(values, np.float32)[None, None, None], (1, 3, 1, len(values))))


def colours(count: int = 20000) -> np.ndarray:
    """Random colours of all brightnesses, dark ones too."""
    random = np.random.default_rng(0)
    return (random.random((1, 3, 1, count)) * 10 ** random.uniform(-4, 0, (1, 1, 1, count))).astype(np.float32)


def hdr10(peak_cd_m2: float) -> Display:
    return Display(peak_cd_m2=peak_cd_m2, encoding=Encoding.HDR10)


def test_every_srgb_code_comes_back_from_its_own_light() -> None:
    codes = np.arange(256)
    linear = colour.models.eotf_sRGB(codes / 255)
    np.testing.assert_array_equal(encode(greys(linear), SRGB)[0, 0], np.repeat(codes[:, None], 3, 1))


@pytest.mark.parametrize("black_share", [0.0, 0.003, 0.1])
def test_srgb_codes_are_those_of_the_formula_bit_by_bit(black_share: float) -> None:
    @jax.jit
    def formula(linear: jax.Array, black_share: float) -> jax.Array:
        shown = jnp.clip((linear - jnp.float32(black_share)) / (1 - jnp.float32(black_share)), 0, 1)
        root = jnp.exp(jnp.log(jnp.maximum(shown, np.float32(1e-8))) * np.float32(1 / 2.4))
        power = np.float32(1.055) * root - np.float32(0.055)
        encoded = jnp.where(shown <= np.float32(0.0031308), np.float32(12.92) * shown, power)
        return jnp.round(encoded * 255).astype(jnp.uint8).transpose(0, 2, 3, 1)

    steps = np.asarray(colour.models.eotf_sRGB((np.arange(1, 256) - 0.5) / 255), np.float32)
    near = (steps.view(np.int32)[:, None] + np.arange(-100, 100, dtype=np.int32)).view(np.float32).ravel()
    far = np.array([-1e9, -1e-3, -0.0, 0.0, 1e-45, 1e-30, 1 - 2**-24, 1.0, 1.5, 1e30, np.inf], np.float32)
    linear = greys(np.concatenate([near * (1 - black_share) + black_share, far, colours().ravel()]))
    np.testing.assert_array_equal(srgb_codes(linear, black_share), formula(linear, black_share))


def test_srgb_codes_are_the_standards_but_for_rounding() -> None:
    linear = colours(300_000)
    exact = np.round(255 * colour.models.eotf_inverse_sRGB(linear.astype(np.float64))).transpose(0, 2, 3, 1)
    off = np.abs(encode(jnp.asarray(linear), SRGB).astype(int) - exact)
    assert off.max() <= 1
    assert (off > 0).mean() < 5e-5


def test_signals_in_float64_are_the_standards() -> None:
    light = np.concatenate([[0.0, 0.0031308, 1.0], np.geomspace(1e-9, 1, 500)])
    np.testing.assert_allclose(srgb_signal(light), colour.models.eotf_inverse_sRGB(light), rtol=1e-12)
    np.testing.assert_allclose(pq_signal(light), colour.models.eotf_inverse_ST2084(light * 10000), rtol=1e-9)
    np.testing.assert_allclose(pq_cd_m2(pq_signal(light)), light * 10000, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("cd_m2", "signal"), [(100, 0.5081), (203, 0.5807), (1000, 0.7518), (4000, 0.9026)])
def test_pq_codes_of_published_signals(cd_m2: float, signal: float) -> None:
    """Report ITU-R BT.2408, tables 1 and 2: 100 cd/m² at 51 %, its reference white of 203 at 58 %, 1000 at 75 %."""
    code = encode(greys(np.array([cd_m2 / 10000])), hdr10(10000.0))
    assert code.dtype == np.uint16
    np.testing.assert_array_equal(code, round(signal * 1023))


def test_pq_runs_from_0_to_1023_and_never_back() -> None:
    values = np.concatenate([[0.0], np.geomspace(1e-12, 1, 50_000)])
    codes = encode(greys(values), hdr10(10000.0))[0, 0, :, 0].astype(int)
    assert (codes[0], codes[-1]) == (0, 1023)
    assert set(np.diff(codes)) == {0, 1}
    np.testing.assert_allclose(pq_cd_m2(np.array([0.0, 1.0])), [0, 10000])


def test_every_pq_code_comes_back_from_its_own_light() -> None:
    codes = np.arange(1024)
    linear = colour.models.eotf_ST2084(codes / 1023) / 10000
    np.testing.assert_array_equal(encode(greys(linear), hdr10(10000.0))[0, 0, :, 0], codes)


def test_hdr10_is_absolute_and_in_rec_2020() -> None:
    linear, peak = colours(), 600.0
    wide = colour.RGB_to_RGB(linear[0, :, 0].T.astype(np.float64), "ITU-R BT.709", "ITU-R BT.2020")
    exact = np.round(1023 * colour.models.eotf_inverse_ST2084(peak * wide))
    off = np.abs(encode(jnp.asarray(linear), hdr10(peak))[0, 0].astype(int) - exact)
    assert off.max() <= 1
    assert (off > 0).mean() < 2e-3  # colour-science's matrix is the standard's, of four decimals


def test_display_p3_shows_the_same_colours_less_saturated_in_codes() -> None:
    linear = colours()
    wide = colour.RGB_to_RGB(linear[0, :, 0].T.astype(np.float64), "sRGB", "Display P3")
    exact = np.round(255 * colour.models.eotf_inverse_sRGB(np.clip(wide, 0, 1)))
    codes = encode(jnp.asarray(linear), Display(encoding=Encoding.DISPLAY_P3))
    assert codes.dtype == np.uint8
    off = np.abs(codes[0, 0].astype(int) - exact)
    assert off.max() <= 1
    assert (off > 0).mean() < 2e-3
    red = encode(jnp.asarray(np.float32([1, 0, 0]).reshape(1, 3, 1, 1)), Display(encoding=Encoding.DISPLAY_P3))
    np.testing.assert_array_equal(red[0, 0, 0], [234, 51, 35])  # as CSS Color 4 converts sRGB's red


def test_a_colour_beyond_rec_709_is_kept_where_the_display_has_it() -> None:
    """P3's red in Rec.709 has a negative green and blue."""
    red = (matrix(P3, REC709) @ [1, 0, 0]).astype(np.float32).reshape(1, 3, 1, 1)
    assert red.min() < 0 < 1 < red.max()
    codes = encode(jnp.asarray(red), Display(encoding=Encoding.DISPLAY_P3))[0, 0, 0]
    np.testing.assert_array_equal(codes, [255, 0, 0])


@pytest.mark.parametrize(("primaries", "name"), [(P3, "Display P3"), (REC2020, "ITU-R BT.2020")])
def test_matrices_are_those_of_colour_science(primaries: module.Primaries, name: str) -> None:
    expected = colour.matrix_RGB_to_RGB("ITU-R BT.709", name, None)
    np.testing.assert_allclose(matrix(REC709, primaries), expected, atol=2e-4)
    np.testing.assert_allclose(matrix(REC709, primaries).sum(1), 1, atol=1e-12)  # white stays white


def test_linear_is_the_light_itself_within_the_display() -> None:
    linear = np.float32([-0.5, 0.0, 1e-6, 0.25, 1.0, 3.0])
    out = encode(greys(linear), LINEAR)
    assert out.dtype == np.float32
    np.testing.assert_array_equal(out[0, 0, :, 1], np.clip(linear, 0, 1))


def test_the_displays_black_is_code_0_and_its_peak_the_last() -> None:
    shares = greys(np.array([0.0, 0.02, 0.0201, 1.0]))
    for encoding in (Encoding.SRGB, Encoding.DISPLAY_P3):
        codes = encode(shares, Display(peak_cd_m2=100, black_cd_m2=2, encoding=encoding))[0, 0, :, 0]
        np.testing.assert_array_equal(codes, [0, 0, 0, 255])
    absolute = [encode(shares, Display(100, black_cd_m2=black, encoding=Encoding.HDR10)) for black in (0.0, 2.0)]
    np.testing.assert_array_equal(*absolute)


def test_what_the_display_reflects_is_not_sent_to_it() -> None:
    """In a surround of 1000 cd/m² a screen returns 10: on 100 cd/m² of its own, 1 is 110, and 55 of them need 45."""
    display = Display(peak_cd_m2=100, surround_cd_m2=1000, encoding=Encoding.HDR10)
    code = encode(greys(np.array([10 / 110, 0.5, 1.0])), display)[0, 0, :, 0]
    np.testing.assert_array_equal(code, np.round(1023 * colour.models.eotf_inverse_ST2084(np.array([0, 45, 100]))))
    eight_bits = encode(greys(np.array([10 / 110, 1.0])), Display(peak_cd_m2=100, surround_cd_m2=1000))
    np.testing.assert_array_equal(eight_bits[0, 0, :, 0], [0, 255])


@pytest.mark.parametrize("encoding", list(Encoding))
def test_a_bad_pixel_is_black_and_alone(encoding: Encoding) -> None:
    linear = np.full((2, 3, 4, 5), 0.5, np.float32)
    linear[0, :, 1, 2], linear[1, :, 3, 4], linear[1, :, 0, 0] = np.nan, -1e30, 1e30
    codes = np.array(encode(jnp.asarray(linear), Display(encoding=encoding)))
    assert codes.shape == (2, 4, 5, 3)
    assert not codes[0, 1, 2].any()
    assert not codes[1, 3, 4].any()
    grey = codes[0, 0, 0].copy()
    assert (codes[1, 0, 0] > grey).all()
    codes[0, 1, 2] = codes[1, 3, 4] = codes[1, 0, 0] = grey
    assert (codes == grey).all()


def test_a_staircase_too_steep_for_its_cells_is_refused() -> None:
    with pytest.raises(ValueError, match="too wide"):
        staircase(np.float32([0.501, 0.502, 0.9]))
    steps = np.float32([0.25, 0.5])
    assert len(staircase(steps).entries) == 2 * 128 + 1
