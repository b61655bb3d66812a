"""Stills as each kind of display takes them."""

import zlib
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from entoptic.pipeline.frame import Display, Encoding, FrameError
from entoptic.pipeline.scenes.image_file import cd_m2_per_unit, read
from entoptic.pipeline.sinks.images import still_path, write_png, write_still

RANDOM = np.random.default_rng(0)
EIGHT_BITS = RANDOM.integers(0, 256, (7, 5, 3), dtype=np.uint8)
TEN_BITS = RANDOM.integers(0, 1024, (7, 5, 3)).astype(np.uint16)


def chunks(path: Path) -> dict[bytes, bytes]:
    """A PNG's chunks by type, read by hand; each checksum is held against its data."""
    data, at, found = path.read_bytes(), 8, {}
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    while at < len(data):
        length, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        body = data[at + 8 : at + 8 + length]
        assert int.from_bytes(data[at + 8 + length : at + 12 + length], "big") == zlib.crc32(kind + body)
        found[kind] = body
        at += 12 + length
    return found


def test_an_srgb_still_is_the_png_that_it_was(tmp_path: Path) -> None:
    write_still(tmp_path / "a.png", EIGHT_BITS, Display())
    write_png(tmp_path / "b.png", EIGHT_BITS)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_p3_still_says_that_it_is(tmp_path: Path) -> None:
    write_still(tmp_path / "a.png", EIGHT_BITS, Display(encoding=Encoding.DISPLAY_P3))
    written = chunks(tmp_path / "a.png")
    assert tuple(written[b"cICP"]) == (12, 13, 0, 1)
    assert b"sRGB" not in written
    assert b"gAMA" not in written
    np.testing.assert_array_equal(oiio.ImageBuf(str(tmp_path / "a.png")).get_pixels(oiio.UINT8), EIGHT_BITS)


def test_an_hdr10_still_is_16_bits_of_pq_and_gives_its_10_bits_back(tmp_path: Path) -> None:
    codes = TEN_BITS.copy()
    codes[0, 0], codes[0, 1] = 0, 1023
    write_still(tmp_path / "a.png", codes, Display(encoding=Encoding.HDR10))
    written = chunks(tmp_path / "a.png")
    assert tuple(written[b"cICP"]) == (9, 16, 0, 1)
    assert (written[b"IHDR"][8], written[b"IHDR"][9]) == (16, 2)  # bits, RGB
    pixels = oiio.ImageBuf(str(tmp_path / "a.png")).get_pixels(oiio.UINT16).astype(int)
    assert (pixels[0, 0, 0], pixels[0, 1, 0]) == (0, 65535)
    np.testing.assert_array_equal(np.round(pixels * 1023 / 65535), codes)


def test_every_ten_bit_code_has_sixteen_bits_of_its_own(tmp_path: Path) -> None:
    codes = np.arange(1024).reshape(32, 32, 1).repeat(3, 2).astype(np.uint16)
    write_still(tmp_path / "a.png", codes, Display(encoding=Encoding.HDR10))
    pixels = oiio.ImageBuf(str(tmp_path / "a.png")).get_pixels(oiio.UINT16).astype(int)
    np.testing.assert_array_equal(np.round(pixels * 1023 / 65535), codes)


def test_a_linear_still_comes_back_in_cd_m2(tmp_path: Path) -> None:
    image = RANDOM.random((7, 5, 3)).astype(np.float32)
    write_still(tmp_path / "a.exr", image, Display(peak_cd_m2=600.0, encoding=Encoding.LINEAR))
    file = read(tmp_path / "a.exr")
    scale, _ = cd_m2_per_unit(file, None)
    assert scale == pytest.approx(600.0)
    np.testing.assert_array_equal(file.rgb, image.transpose(2, 0, 1))


@pytest.mark.parametrize("encoding", list(Encoding))
def test_a_still_of_the_wrong_suffix_is_refused_with_the_right_one(tmp_path: Path, encoding: Encoding) -> None:
    display = Display(encoding=encoding)
    right = still_path(tmp_path / "a.b.jpg", display)
    assert right.name == ("a.b.exr" if encoding == Encoding.LINEAR else "a.b.png")
    with pytest.raises(FrameError, match=rf"a\.b\.jpg: a still for {encoding} is written as {right.name}"):
        write_still(tmp_path / "a.b.jpg", EIGHT_BITS, display)
    assert list(tmp_path.iterdir()) == []
