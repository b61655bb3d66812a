import itertools
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Source, SourceError
from entoptic.tracker_bridge.sources.pupil_core.recording import open_recording

Shared = Callable[[str], Path]
Map = dict[str, Any]


def pupil(t_s: float, eye: int = 0, *, three_d: bool = True, **fields: object) -> tuple[str, Map]:
    datum: Map = {"id": eye, "timestamp": t_s, "confidence": 1.0, "diameter": 20.0}
    if three_d:
        datum |= {"diameter_3d": 4.0, "circle_3d": {"normal": [0.0, 0.5, -1.0]}}
    return f"pupil.{eye}.{'3d' if three_d else '2d'}", datum | fields


def gaze(t_s: float, **fields: object) -> tuple[str, Map]:
    return "gaze.3d.01.", {"timestamp": t_s, "confidence": 1.0, "gaze_point_3d": [0.0, 0.0, 9.0], **fields}


def packed(messages: Iterable[tuple[str, Map]]) -> bytes:
    return b"".join(msgpack.packb([topic, msgpack.packb(datum)]) for topic, datum in messages)


def write(path: Path, *messages: tuple[str, Map]) -> Path:
    path.write_bytes(packed(messages))
    return path


def kinds(source: Source) -> Counter[tuple[str, Eye | None]]:
    return Counter((type(sample).__name__, sample.eye) for sample in source.samples())


def assert_in_order(source: Source) -> None:
    samples = list(source.samples())
    keys = [(s.t_ns, isinstance(s, GazeSample), 2 if s.eye is None else s.eye) for s in samples]
    assert all(before < after for before, after in itertools.pairwise(keys))
    assert (source.info.t_start_ns, source.info.t_end_ns) == (samples[0].t_ns, samples[-1].t_ns)
    assert list(source.samples()) == samples


def test_2d_and_3d_of_one_image_are_one_sample(tmp_path: Path) -> None:
    file = write(tmp_path / "a.pldata", pupil(1.0, three_d=False), pupil(1.0), pupil(2.0), pupil(2.0, three_d=False))
    source = open_recording(file)
    assert [(s.t_ns, s.pupil_diameter_mm) for s in source.samples() if isinstance(s, PupilSample)] == [
        (1_000_000_000, 4.0),
        (2_000_000_000, 4.0),
    ]
    assert source.info.notes[0] == "Two-dimensional measurements that repeat an image were left out: 2."


def test_a_2d_detector_alone_gives_pixels(tmp_path: Path) -> None:
    source = open_recording(write(tmp_path / "a.pldata", pupil(1.0, three_d=False), pupil(2.0, 1, three_d=False)))
    assert [(s.pupil_diameter_mm, s.diameter_px) for s in source.samples() if isinstance(s, PupilSample)] == [
        (None, 20.0)
    ] * 2


def test_disorder_and_repetition_are_repaired_and_told(tmp_path: Path) -> None:
    write(tmp_path / "pupil.pldata", pupil(3.0), pupil(1.0, 1), pupil(2.0), pupil(2.0, diameter_3d=9.0))
    write(tmp_path / "gaze.pldata", gaze(2.0), gaze(1.0), gaze(1.0))
    source = open_recording(tmp_path)
    assert_in_order(source)
    assert [s.pupil_diameter_mm for s in source.samples() if isinstance(s, PupilSample)] == [4.0, 4.0, 4.0]
    assert source.info.notes == (
        "Among 4 pupil samples time went backwards; they were sorted; steps back: 1.",
        "Of 4 pupil samples those that repeat a time and eye were dropped: 1.",
        "Among 3 gaze directions time went backwards; they were sorted; steps back: 1.",
        "Of 3 gaze directions those that repeat a time and eye were dropped: 1.",
    )


def test_pupils_are_taken_from_the_gaze_where_they_are_missing(tmp_path: Path) -> None:
    bases = [pupil(t_s, eye)[1] for t_s, eye in ((0.9, 0), (1.1, 1), (1.2, 0))]
    write(tmp_path / "gaze.pldata", gaze(1.0, base_data=bases[:2]), gaze(1.15, base_data=bases[1:]))
    source = open_recording(tmp_path)
    assert kinds(source) == {("PupilSample", Eye.RIGHT): 2, ("PupilSample", Eye.LEFT): 1, ("GazeSample", None): 2}
    assert source.info.notes == ("No pupil data of its own; pupils that were taken from the gaze data: 3.",)


def test_gaze_without_any_pupil_is_told(tmp_path: Path) -> None:
    source = open_recording(write(tmp_path / "gaze.pldata", gaze(1.0)))
    assert source.info.notes == ("No pupil data: diameters and blinks are not known.",)


def test_directions_from_the_eye_cameras_are_centred_and_told(tmp_path: Path) -> None:
    """The right eye's camera is upside down: the same x and y mean the opposite in the two cameras."""
    normals = ([0.0, 0.5, -1.0], [0.0, 0.5, -1.0], [0.1, 0.5, -1.0], [0.0, 0.4, -1.0], [-0.1, 0.5, -1.0])
    lost = pupil(9.0, confidence=0.0, circle_3d={"normal": [0.0, 0.0, 0.0]})
    messages = [pupil(float(at), eye, circle_3d={"normal": normal}) for eye in Eye for at, normal in enumerate(normals)]
    source = open_recording(write(tmp_path / "a.pldata", *messages, lost))
    assert any("centred" in note for note in source.info.notes)
    for eye, sign in ((Eye.RIGHT, 1.0), (Eye.LEFT, -1.0)):
        gazes = [s for s in source.samples() if isinstance(s, GazeSample) and s.eye is eye]
        assert len(gazes) == len(normals)
        assert gazes[0].azimuth_deg == pytest.approx(0.0, abs=0.2)
        assert gazes[0].elevation_deg == pytest.approx(0.0, abs=0.2)
        assert 4.0 < gazes[2].azimuth_deg * sign < 6.0
        assert gazes[3].elevation_deg * sign == pytest.approx(-4.8, abs=0.3)


def test_scene_positions_without_3d_are_told(tmp_path: Path) -> None:
    flat = ("gaze.2d.01.", {"timestamp": 1.0, "confidence": 1.0, "norm_pos": [0.5, 0.5]})
    empty = ("gaze", {"timestamp": 1.0, "confidence": 1.0})
    source = open_recording(write(tmp_path / "a.pldata", pupil(1.0), flat, empty))
    assert any("90° by 52°" in note for note in source.info.notes)
    assert any(note == "Of 2 gaze data those without a direction were left out: 1." for note in source.info.notes)


def test_a_file_cut_anywhere_keeps_what_is_whole(tmp_path: Path) -> None:
    messages = [packed([pupil(float(at))]) for at in range(3)]
    whole = b"".join(messages)
    ends = list(itertools.accumulate(len(message) for message in messages))
    file = tmp_path / "pupil.pldata"
    for length in range(len(whole) + 1):
        file.write_bytes(whole[:length])
        count = sum(end <= length for end in ends)
        if count == 0:
            with pytest.raises(SourceError, match=r"empty|within its first message"):
                open_recording(tmp_path)
            continue
        source = open_recording(tmp_path)
        assert kinds(source)["PupilSample", Eye.RIGHT] == count
        assert any("ends within a message" in note for note in source.info.notes) == (length not in ends)


@pytest.mark.parametrize(
    ("contents", "what"),
    [
        (b"", "is empty"),
        (b"\x89PNG\r\n\x1a\n", "no pldata file"),
        (b"time,pupil\n1,2\n", "no pldata file"),
        (b"\x91" * 5000, "no pldata file"),
        (b"\xc1", "no pldata file"),
        (msgpack.packb(["pupil.0.3d", {"id": 0}]), "no pldata file"),
        (msgpack.packb(["pupil.0.3d", "text"]), "no pair of a topic"),
        (msgpack.packb(["pupil.0.3d", b"\x01"]), "message 1: not a pupil datum"),
        (packed([pupil(1.0), pupil(2.0, 7)]), "message 2: .*id"),
        (packed([gaze(1.0, base_data=[{"id": 0}])]), "message 1: .*base_data"),
        (packed([("blinks", {}), ("fixations", {})]), "no pupil or gaze data but blinks, fixations"),
        (packed([("gaze", {"timestamp": 1.0, "confidence": 1.0})]), "holds no samples"),
        (packed([pupil(1.0)]) + b"garbage" + packed([pupil(2.0)]), r"damaged, behind byte \d+"),
    ],
)
def test_a_bad_file_is_named_with_what_is_wrong(tmp_path: Path, contents: bytes, what: str) -> None:
    file = tmp_path / "pupil.pldata"
    file.write_bytes(contents)
    with pytest.raises(SourceError, match=what) as caught:
        open_recording(file)
    assert "pupil.pldata" in str(caught.value)


def test_missing_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r"pupil\.pldata or gaze\.pldata"):
        open_recording(tmp_path)
    with pytest.raises(SourceError, match="does not exist"):
        open_recording(tmp_path / "nothing.pldata")


GOOD = packed([pupil(0.5), pupil(0.5, 1, three_d=False), gaze(0.5, base_data=[pupil(0.5)[1]]), pupil(1.0)])


def open_bytes(contents: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "pupil.pldata"
        file.write_bytes(contents)
        try:
            source = open_recording(file)
        except SourceError:
            return
        assert_in_order(source)


@given(st.binary(max_size=100))
def test_any_file_gives_samples_or_a_source_error(contents: bytes) -> None:
    open_bytes(contents)


@given(st.lists(st.tuples(st.integers(0, len(GOOD) - 1), st.integers(0, 255)), min_size=1, max_size=4))
def test_a_file_with_flipped_bytes_gives_samples_or_a_source_error(flips: list[tuple[int, int]]) -> None:
    contents = bytearray(GOOD)
    for at, byte in flips:
        contents[at] = byte
    open_bytes(bytes(contents))


@pytest.mark.shared_data
def test_a_real_recording_of_two_eyes_without_gaze(shared: Shared) -> None:
    source = open_recording(shared("eye/pupil_core/recording_000"))
    assert_in_order(source)
    pupils = [s for s in source.samples() if isinstance(s, PupilSample)]
    assert Counter(s.eye for s in pupils) == {Eye.RIGHT: 1703, Eye.LEFT: 1702}
    assert np.mean([s.confidence == 0.0 for s in pupils]) == pytest.approx(0.12, abs=0.005)
    assert (pupils[-1].t_ns - pupils[0].t_ns) / 1e9 == pytest.approx(13.74, abs=0.01)
    for eye in Eye:
        periods = np.diff([s.t_ns for s in pupils if s.eye is eye])
        assert 1e9 / np.median(periods) == pytest.approx(124.0, abs=0.5)
    assert all(s.model_confidence is not None and s.pupil_diameter_mm is not None for s in pupils)
    assert any("were sorted" in note for note in source.info.notes)
    assert any("centred" in note for note in source.info.notes)
    for eye in Eye:
        gazes = [s for s in source.samples() if isinstance(s, GazeSample) and s.eye is eye and s.confidence >= 0.6]
        assert np.median([s.azimuth_deg for s in gazes]) == pytest.approx(0.0, abs=1.5)
        assert np.median([s.elevation_deg for s in gazes]) == pytest.approx(0.0, abs=1.5)


@pytest.mark.shared_data
def test_both_eyes_of_a_real_recording_look_the_same_way(shared: Shared) -> None:
    """Two eye cameras that know nothing of each other, one of them upside down, see the same movements."""
    source = open_recording(shared("eye/pupil_core/recording_000"))
    gazes = [s for s in source.samples() if isinstance(s, GazeSample) and s.confidence >= 0.9]
    right, left = (np.array([(s.t_ns, s.azimuth_deg, s.elevation_deg) for s in gazes if s.eye is eye]) for eye in Eye)
    for axis in (1, 2):
        assert np.corrcoef(right[:, axis], np.interp(right[:, 0], left[:, 0], left[:, axis]))[0, 1] > 0.8


@pytest.mark.shared_data
def test_a_real_recording_of_capture_3_6(shared: Shared) -> None:
    source = open_recording(shared("eye/pupil_core/capture_3_6"))
    assert_in_order(source)
    counts = kinds(source)
    assert counts["PupilSample", Eye.RIGHT] == 2520
    assert counts["PupilSample", Eye.LEFT] == 2504
    assert counts["GazeSample", None] == 2838
    assert all(s.pupil_diameter_mm is not None for s in source.samples() if isinstance(s, PupilSample))
    assert source.info.name == "Pupil recording capture_3_6"
    assert source.info.notes == (
        "Two-dimensional measurements that repeat an image were left out: 5,024.",
        "Among 5,024 pupil samples time went backwards; they were sorted; steps back: 76.",
        "Among 2,990 gaze directions time went backwards; they were sorted; steps back: 8.",
    )


@pytest.mark.shared_data
def test_real_gaze_data_that_carry_their_pupils(shared: Shared) -> None:
    source = open_recording(shared("eye/pupil_core/binocular_only_gaze.pldata"))
    assert_in_order(source)
    assert set(kinds(source).values()) == {333, 665}
    diameters = [
        s.pupil_diameter_mm for s in source.samples() if isinstance(s, PupilSample) and s.pupil_diameter_mm is not None
    ]
    assert len(diameters) == 666
    assert min(diameters) == pytest.approx(5.417, abs=0.001)
    assert max(diameters) == pytest.approx(6.624, abs=0.001)
