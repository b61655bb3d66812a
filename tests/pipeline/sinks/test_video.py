from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from av.video.reformatter import Colorspace

from entoptic.errors import OutputError
from entoptic.pipeline.frame import FrameError
from entoptic.pipeline.sinks.video import film

COLOURS = ((230, 30, 30), (30, 200, 40), (20, 40, 220), (128, 128, 128), (255, 255, 255), (0, 0, 0))


def written(path: Path, width: int = 64, height: int = 48, count: int = 6) -> Path:
    with film(path, (width, height), 24.0) as video:
        for k in range(count):
            video.write(np.full((height, width, 3), COLOURS[k % len(COLOURS)], np.uint8))
    return path


def frames(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [
            frame.to_ndarray(format="rgb24", src_colorspace=Colorspace.ITU709, dst_colorspace=Colorspace.ITU709)
            for frame in container.decode(video=0)
        ]


def test_film_comes_back_with_its_frames_and_colours(tmp_path: Path) -> None:
    read = frames(written(tmp_path / "a.mp4"))
    assert len(read) == 6
    for image, colour in zip(read, COLOURS, strict=True):
        assert image.shape == (48, 64, 3)
        np.testing.assert_allclose(image.mean(axis=(0, 1)), colour, atol=3)


def test_film_says_its_rate_and_colour_space(tmp_path: Path) -> None:
    with film(tmp_path / "a.mp4", (64, 48), 24000 / 1001) as video:
        for _ in range(10):
            video.write(np.zeros((48, 64, 3), np.uint8))
    with av.open(str(tmp_path / "a.mp4")) as container:
        stream = container.streams.video[0]
        assert stream.frames == 10
        assert stream.average_rate is not None
        assert float(stream.average_rate) == pytest.approx(24000 / 1001, rel=1e-4)
        assert isinstance(stream.average_rate, Fraction)
        context = stream.codec_context
        assert (context.name, context.pix_fmt) == ("h264", "yuv420p")
        assert (context.color_primaries, context.colorspace, context.color_trc, context.color_range) == (1, 1, 13, 1)


def test_the_index_comes_first_so_that_it_plays_while_it_loads(tmp_path: Path) -> None:
    data = written(tmp_path / "a.mp4").read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")


def test_odd_sides_repeat_their_last_row_and_column(tmp_path: Path) -> None:
    image = np.zeros((33, 21, 3), np.uint8)
    image[-1], image[:, -1] = 255, 255
    with film(tmp_path / "a.mp4", (21, 33), 24.0) as video:
        video.write(image)
    read = frames(tmp_path / "a.mp4")[0]
    assert read.shape == (34, 22, 3)
    assert read[-2:].mean() > 245
    assert read[:, -2:].mean() > 245
    assert read[:30, :18].mean() < 10


def test_same_frames_same_bytes(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    images = [random.integers(0, 256, (96, 128, 3), dtype=np.uint8) for _ in range(12)]
    for name in ("a.mp4", "b.mp4"):
        with film(tmp_path / name, (128, 96), 24.0) as video:
            for image in images:
                video.write(image)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_an_error_leaves_nothing_but_the_film_before(tmp_path: Path) -> None:
    old = written(tmp_path / "a.mp4").read_bytes()

    def break_off() -> None:
        with film(tmp_path / "a.mp4", (64, 48), 24.0) as video:
            video.write(np.zeros((48, 64, 3), np.uint8))
            assert (tmp_path / "a.mp4").read_bytes() == old
            raise KeyError

    with pytest.raises(KeyError):
        break_off()
    assert (tmp_path / "a.mp4").read_bytes() == old
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]


def test_what_is_no_film_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    with (
        pytest.raises(FrameError, match=r"a\.mp4: a frame of shape \(48, 60, 3\)"),
        film(tmp_path / "a.mp4", (64, 48), 24.0) as video,
    ):
        video.write(np.zeros((48, 60, 3), np.uint8))
    with pytest.raises(FrameError, match=r"b\.mp4: no frame"), film(tmp_path / "b.mp4", (64, 48), 24.0):
        pass
    with (
        pytest.raises(OutputError, match=r"nowhere/c\.mp4 cannot be written"),
        film(tmp_path / "nowhere" / "c.mp4", (64, 48), 24.0) as video,
    ):
        video.write(np.zeros((48, 64, 3), np.uint8))
    assert list(tmp_path.iterdir()) == []
