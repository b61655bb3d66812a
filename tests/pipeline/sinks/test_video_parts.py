import shutil
import signal
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from entoptic.errors import OutputError
from entoptic.pipeline.frame import Display, Encoding, FrameError
from entoptic.pipeline.sinks.video_parts import Part, begins_s, join

HDR10 = Display(peak_cd_m2=1000.0, encoding=Encoding.HDR10)


def picture(frame: int, display: Display) -> np.ndarray:
    """Says its number by its grey."""
    grey = 40 + 3 * (frame % 50)
    ten_bits = display.encoding is Encoding.HDR10
    return np.full((34, 50, 3), 4 * grey if ten_bits else grey, np.uint16 if ten_bits else np.uint8)


def write_part(path: Path, frames: list[int], fps: float = 24.0, display: Display = Display()) -> None:
    part = Part(path, 50, 34, fps, display, frames[0])
    for frame in frames:
        part.write(picture(frame, display), frame)
    part.close()


def shown(path: Path, fps: float = 24.0) -> list[int]:
    """When each frame of a film begins, in frames."""
    with av.open(str(path)) as film:
        found = [frame.pts * frame.time_base for frame in film.decode(video=0)]
    return [round(t_s * Fraction(fps).limit_denominator(1000)) for t_s in found]


@pytest.mark.parametrize(
    ("fps", "display"), [(24.0, Display()), (24000 / 1001, Display()), (7.5, Display()), (24.0, HDR10)]
)
def test_parts_become_one_film_with_their_gaps(tmp_path: Path, fps: float, display: Display) -> None:
    first, second = [100, 101, 102, 105, 106, 120], [200, 201, 203]
    write_part(tmp_path / "1.mp4", first, fps, display)
    write_part(tmp_path / "2.mp4", second, fps, display)
    assert join([tmp_path / "1.mp4", tmp_path / "2.mp4"], tmp_path / "film.mp4") == ()
    assert shown(tmp_path / "film.mp4", fps) == [frame - 100 for frame in first + second]
    part_begins_s = begins_s(tmp_path / "2.mp4")
    assert part_begins_s == pytest.approx(200 / fps)
    assert begins_s(tmp_path / "film.mp4") == pytest.approx(100 / fps)
    data = (tmp_path / "film.mp4").read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")
    assert b"moof" not in data


def test_joining_encodes_nothing_anew(tmp_path: Path) -> None:
    def packets(path: Path) -> list[bytes]:
        with av.open(str(path)) as film:
            return [bytes(packet) for packet in film.demux(video=0) if packet.size]

    write_part(tmp_path / "1.mp4", list(range(30)))
    join([tmp_path / "1.mp4"], tmp_path / "film.mp4")
    assert packets(tmp_path / "1.mp4") == packets(tmp_path / "film.mp4")


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from test_video_parts import Display, Part, picture
part = Part(Path(sys.argv[2]), 50, 34, 24.0, Display(), 10)
for frame in range(10, 70):
    part.write(picture(frame, Display()), frame)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_writer_loses_half_a_second_at_most(tmp_path: Path) -> None:
    path = tmp_path / "1.mp4"
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(Path(__file__).parent), str(path)], check=False, timeout=60
    )
    assert done.returncode == -signal.SIGKILL
    write_part(tmp_path / "2.mp4", [80, 81])
    assert join([path, tmp_path / "2.mp4"], tmp_path / "film.mp4") == ()
    frames = shown(tmp_path / "film.mp4")
    kept = frames[:-2]
    assert kept == list(range(len(kept)))
    assert 60 - 12 <= len(kept) <= 60
    assert frames[-2:] == [70, 71]


def test_a_torn_part_counts_up_to_its_last_whole_frame(tmp_path: Path) -> None:
    write_part(tmp_path / "whole.mp4", list(range(48)))
    data = (tmp_path / "whole.mp4").read_bytes()
    before = 49
    for share in (0.95, 0.8, 0.7):
        (tmp_path / "torn.mp4").write_bytes(data[: int(len(data) * share)])
        assert join([tmp_path / "torn.mp4"], tmp_path / "film.mp4") == ()
        frames = shown(tmp_path / "film.mp4")
        assert frames == list(range(len(frames)))
        assert len(frames) <= before
        before = len(frames)


def test_what_holds_no_frame_is_left_out_and_named(tmp_path: Path) -> None:
    write_part(tmp_path / "1.mp4", [0, 1])
    (tmp_path / "2.mp4").write_bytes(b"")
    (tmp_path / "3.mp4").write_bytes((tmp_path / "1.mp4").read_bytes()[:100])
    write_part(tmp_path / "4.mp4", [5, 6], display=HDR10)
    parts = [tmp_path / f"{k}.mp4" for k in (1, 2, 3, 4)]
    left_over = join(parts, tmp_path / "film.mp4")
    assert [path.name for path, _ in left_over] == ["2.mp4", "3.mp4", "4.mp4"]
    assert "another form" in left_over[2][1]
    assert [begins_s(part) for part in parts] == [0.0, None, None, 5 / 24]
    assert shown(tmp_path / "film.mp4") == [0, 1]
    with pytest.raises(FrameError, match=r"no\.mp4: no part holds a frame"):
        join(parts[1:3], tmp_path / "no.mp4")
    assert not list(tmp_path.glob("no*"))


def test_a_part_without_a_frame_vanishes_and_others_say_what_is_wrong(tmp_path: Path) -> None:
    Part(tmp_path / "1.mp4", 50, 34, 24.0, Display(), 0).close()
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OutputError, match="cannot be written"):
        Part(tmp_path / "nowhere" / "1.mp4", 50, 34, 24.0, Display(), 0)
    part = Part(tmp_path / "1.mp4", 50, 34, 24.0, Display(), 5)
    part.write(picture(0, Display()), 5)
    with pytest.raises(FrameError, match="comes too late"):
        part.write(picture(0, Display()), 5)
    part.close()
    shutil.rmtree(tmp_path)
