"""Films for wide and bright displays."""

import struct
from pathlib import Path

import av
import colour
import numpy as np
import pytest
from av.sidedata.sidedata import Type

from entoptic.pipeline.frame import Display, Encoding, FrameError
from entoptic.pipeline.sinks.hdr10 import planes
from entoptic.pipeline.sinks.video import film

HDR10 = Display(peak_cd_m2=1000.0, black_cd_m2=0.005, encoding=Encoding.HDR10)
COLOURS = ((0, 0, 0), (1023, 1023, 1023), (769, 769, 769), (600, 300, 200), (200, 600, 300), (100, 200, 700))


def ycbcr(codes: np.ndarray) -> np.ndarray:
    """What colour-science makes of full-range codes: 10 bits, narrow range."""
    return np.asarray(
        colour.RGB_to_YCbCr(
            codes / 1023, K=colour.WEIGHTS_YCBCR["ITU-R BT.2020"], out_bits=10, out_int=True, out_legal=True
        )
    )


def split(samples: np.ndarray, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    width = samples.shape[1]
    blue, red = samples[height:].reshape(2, height // 2, width // 2)
    return samples[:height], blue, red


def written(path: Path, display: Display, colours: tuple[tuple[int, int, int], ...] = COLOURS) -> Path:
    with film(path, (64, 46), 24.0, display) as video:
        for rgb in colours:
            video.write(np.full((46, 64, 3), rgb, np.uint16 if display.encoding == Encoding.HDR10 else np.uint8))
    return path


def test_planes_of_even_fields_are_the_standards() -> None:
    for codes in np.concatenate([COLOURS, np.random.default_rng(0).integers(0, 1024, (40, 3))]):
        parts = split(planes(np.broadcast_to(codes, (6, 8, 3)).astype(np.uint16)), 6)
        for plane, expected in zip(parts, ycbcr(codes), strict=True):
            assert plane.dtype == np.uint16
            assert np.ptp(plane) == 0
            assert abs(int(plane[0, 0]) - expected) <= 1
    white = split(planes(np.full((6, 8, 3), 1023, np.uint16)), 6)
    assert [int(plane[0, 0]) for plane in white] == [940, 512, 512]


def test_chroma_stands_at_the_upper_left_of_its_four_pixels() -> None:
    """A single blue column on an even place gives half its chroma there and a quarter of it nowhere else."""
    image = np.zeros((8, 12, 3), np.uint16)
    image[:, 4, 2] = 1023
    _, blue, _ = split(planes(image), 8)
    full = ycbcr(np.array([0, 0, 1023]))[1] - 512
    np.testing.assert_allclose(blue[2].astype(int) - 512, [0, 0, round(full / 2), 0, 0, 0], atol=1)
    image = np.roll(image, 1, 1)
    _, blue, _ = split(planes(image), 8)
    np.testing.assert_allclose(blue[2].astype(int) - 512, [0, 0, full / 4, full / 4, 0, 0], atol=1)


def test_an_hdr10_film_comes_back_with_its_colours(tmp_path: Path) -> None:
    with av.open(str(written(tmp_path / "a.mp4", HDR10))) as container:
        frames = [frame.to_ndarray() for frame in container.decode(video=0)]
    assert len(frames) == len(COLOURS)
    for samples, codes in zip(frames, COLOURS, strict=True):
        assert samples.dtype == np.uint16
        parts = split(samples, 46)
        for plane, expected in zip(parts, ycbcr(np.array(codes)), strict=True):
            np.testing.assert_allclose(plane, expected, atol=4)


def test_an_hdr10_film_says_what_it_is_and_of_which_display(tmp_path: Path) -> None:
    with av.open(str(written(tmp_path / "a.mp4", HDR10))) as container:
        context = container.streams.video[0].codec_context
        assert (context.name, context.profile, context.pix_fmt) == ("hevc", "Main 10", "yuv420p10le")
        assert (context.color_primaries, context.color_trc, context.colorspace, context.color_range) == (9, 16, 9, 1)
        assert context.codec_tag == "hvc1"
        said = {data.type: bytes(data) for data in next(container.decode(video=0)).side_data}
    # AVMasteringDisplayMetadata: red, green, blue and white as xy, least and largest luminance; each a fraction.
    fractions = np.array(struct.unpack("20i", said[Type.MASTERING_DISPLAY_METADATA][:80])).reshape(10, 2)
    expected = [0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290, 0.005, 1000.0]
    np.testing.assert_allclose(fractions[:, 0] / fractions[:, 1], expected, atol=2e-5)
    assert struct.unpack("2I", said[Type.CONTENT_LIGHT_LEVEL][:8]) == (1000, 0)


def test_a_p3_film_says_so_and_is_otherwise_the_srgb_one(tmp_path: Path) -> None:
    display = Display(encoding=Encoding.DISPLAY_P3)
    with av.open(str(written(tmp_path / "a.mp4", display, ((230, 30, 30), (20, 40, 220))))) as container:
        context = container.streams.video[0].codec_context
        assert (context.name, context.color_primaries, context.color_trc, context.colorspace) == ("h264", 12, 13, 1)


def test_same_frames_same_bytes(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    images = [random.integers(0, 1024, (64, 96, 3)).astype(np.uint16) for _ in range(6)]
    for name in ("a.mp4", "b.mp4"):
        with film(tmp_path / name, (96, 64), 24.0, HDR10) as video:
            for image in images:
                video.write(image)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_shortest_films_are_whole(tmp_path: Path, count: int) -> None:
    for attempt in range(5):
        path = written(tmp_path / f"{attempt}.mp4", HDR10, COLOURS[:count])
        with av.open(str(path)) as container:
            assert len(list(container.decode(video=0))) == count


def test_odd_sides_repeat_their_last_row_and_column(tmp_path: Path) -> None:
    image = np.zeros((33, 21, 3), np.uint16)
    image[-1], image[:, -1] = 1023, 1023
    with film(tmp_path / "a.mp4", (21, 33), 24.0, HDR10) as video:
        video.write(image)
    with av.open(str(tmp_path / "a.mp4")) as container:
        luma = next(container.decode(video=0)).to_ndarray()[:34]
    assert luma.shape == (34, 22)
    assert luma[-2:].mean() > 900
    assert luma[:, -2:].mean() > 900


def test_what_is_no_film_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(FrameError, match="a linear encoding has no film"):
        film(tmp_path / "a.mp4", (64, 48), 24.0, Display(encoding=Encoding.LINEAR)).__enter__()
    with (
        pytest.raises(FrameError, match=r"a frame of uint8 in a film of uint16: encode it"),
        film(tmp_path / "b.mp4", (64, 48), 24.0, HDR10) as video,
    ):
        video.write(np.zeros((48, 64, 3), np.uint8))
    assert list(tmp_path.iterdir()) == []
