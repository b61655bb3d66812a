"""Pictures as JPEG: the right size, and the right light whatever they are encoded for."""

import io

import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image

from entoptic.pipeline import Display, Encoding
from entoptic.pipeline.effects.encode import encode
from entoptic.services.console.jpeg import WIDEST_PX, jpeg, srgb
from entoptic.services.ipc.messages import MessageError, Picture


def picture(values: np.ndarray, encoding: str) -> Picture:
    height_px, width_px, _ = values.shape
    return Picture(1, 0, width_px, height_px, encoding, values.dtype.name, values.tobytes())


def light() -> np.ndarray:
    """Linear Rec.709 within its gamut, (y, x, 3)."""
    return np.random.default_rng(1).uniform(0.0, 1.0, (40, 60, 3)).astype(np.float32) ** 2


@pytest.mark.parametrize("encoding", [Encoding.LINEAR, Encoding.DISPLAY_P3, Encoding.HDR10])
def test_other_encodings_show_the_same_colours_as_srgb(encoding: Encoding) -> None:
    planes = jnp.asarray(light().transpose(2, 0, 1)[None])
    expected = np.asarray(encode(planes, Display(peak_cd_m2=300.0)), np.int16)[0]
    values = np.asarray(encode(planes, Display(peak_cd_m2=300.0, encoding=encoding)))[0]
    found = srgb(values, encoding, 300.0).astype(np.int16)
    differences = np.abs(found - expected)
    # 8 or 10 bits of other primaries lose a little, most in the dark.
    assert np.percentile(differences, 95) <= (1 if encoding is Encoding.LINEAR else 3)
    assert differences.mean() < 1


def test_what_is_no_light_shows_black_and_what_is_too_bright_white() -> None:
    values = np.array([[[np.nan, -1.0, 0.0], [2.0, np.inf, 1.0]]], np.float32)
    assert srgb(values, Encoding.LINEAR, 100.0).tolist() == [[[0, 0, 0], [255, 255, 255]]]


def test_wide_pictures_become_smaller_by_a_whole_factor() -> None:
    values = np.full((20, 2 * WIDEST_PX + 2, 3), 90, np.uint8)
    image = Image.open(io.BytesIO(jpeg(picture(values, "srgb"), 100.0)))
    assert image.format == "JPEG"
    assert image.size == (-(-values.shape[1] // 3), 7)
    assert np.abs(np.asarray(image).astype(int) - 90).max() <= 3


@pytest.mark.parametrize(
    ("dtype", "encoding"), [("uint16", "srgb"), ("float32", "srgb"), ("uint8", "hdr10"), ("uint8", "xyz")]
)
def test_a_picture_that_makes_no_sense_is_refused(dtype: str, encoding: str) -> None:
    with pytest.raises(MessageError):
        jpeg(picture(np.zeros((4, 4, 3), dtype), encoding), 100.0)
