import itertools
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Source, SourceError, SourceInfo
from entoptic.tracker_bridge.sources.loaded import LoadedSource, Sample, sort_key
from entoptic.tracker_bridge.sources.pupil_core.recorder import write_recording
from entoptic.tracker_bridge.sources.pupil_core.recording import open_recording
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings

ELEVEN_DAYS_NS = 11 * 24 * 3600 * 10**9
HUNDRED_YEARS_NS = 100 * 366 * 24 * 3600 * 10**9

unit = st.floats(0.0, 1.0)
side = st.floats(-89.9, 89.9)
times = st.integers(0, ELEVEN_DAYS_NS)
pupils = st.builds(
    PupilSample,
    times,
    st.sampled_from(Eye),
    st.none() | st.floats(-8000.0, 14000.0),
    unit,
    st.none() | unit,
    st.floats(0.0, 400.0),
    st.none() | unit,
)
gazes = st.builds(GazeSample, times, st.none() | st.sampled_from(Eye), side, side, unit)


def of(*samples: Sample) -> Source:
    return LoadedSource(SourceInfo("made up", 0, None), samples)


def assert_same(written: list[Sample], read: list[Sample], *, within_ns: int = 0) -> None:
    assert len(read) == len(written)
    for before, after in zip(written, read, strict=True):
        assert abs(before.t_ns - after.t_ns) <= within_ns
        if isinstance(before, GazeSample):
            assert isinstance(after, GazeSample)
            assert (after.eye, after.confidence) == (before.eye, before.confidence)
            assert after.azimuth_deg == pytest.approx(before.azimuth_deg, abs=1e-9)
            assert after.elevation_deg == pytest.approx(before.elevation_deg, abs=1e-9)
        elif within_ns == 0:
            assert after == before


def there_and_back(samples: list[Sample]) -> list[Sample]:
    with tempfile.TemporaryDirectory() as folder:
        write_recording(of(*samples), Path(folder) / "recording")
        return list(open_recording(Path(folder) / "recording").samples())


def test_a_simulated_recording_reads_back_the_same(tmp_path: Path) -> None:
    samples = list(SimulatedEyes(SimulatedSettings(seconds=10.0)).samples())
    write_recording(of(*samples), tmp_path / "new" / "one")
    source = open_recording(tmp_path / "new" / "one")
    assert_same(samples, list(source.samples()))
    assert source.info.notes == ()
    assert source.info.name == "Pupil recording one"


@given(st.lists(pupils | gazes, min_size=1, max_size=12, unique_by=sort_key))
def test_any_samples_read_back_the_same(samples: list[Sample]) -> None:
    assert_same(sorted(samples, key=sort_key), there_and_back(samples))


@given(st.sets(st.sampled_from([None, *Eye]), min_size=1), st.lists(unit, min_size=3, max_size=3), side, side, times)
def test_any_directions_of_one_time_read_back_the_same(
    eyes: set[Eye | None], confidences: list[float], azimuth: float, elevation: float, t_ns: int
) -> None:
    directions = [GazeSample(t_ns, eye, azimuth, elevation, c) for eye, c in zip(eyes, confidences, strict=False)]
    samples: list[Sample] = [PupilSample(t_ns, eye, 4.0, 0.5, 0.9, 20.0) for eye in Eye]
    samples += directions
    assert_same(sorted(samples, key=sort_key), there_and_back(samples))


@given(st.integers(ELEVEN_DAYS_NS, HUNDRED_YEARS_NS))
def test_times_of_a_clock_since_1970_come_back_within_a_microsecond(t_ns: int) -> None:
    samples: list[Sample] = [PupilSample(t_ns, Eye.LEFT, 4.0, 1.0, 1.0, 20.0)]
    assert_same(samples, there_and_back(samples), within_ns=1000)


def test_a_sample_without_pixels_gets_those_of_its_millimetres() -> None:
    (back,) = there_and_back([PupilSample(0, Eye.LEFT, 4.0, 1.0)])
    assert back == PupilSample(0, Eye.LEFT, 4.0, 1.0, None, 4.0 * 4.93)


def test_pupils_without_gaze_get_none(tmp_path: Path) -> None:
    write_recording(of(PupilSample(0, Eye.LEFT, 4.0, 1.0)), tmp_path / "a")
    assert not (tmp_path / "a" / "gaze.pldata").exists()
    assert len(list(open_recording(tmp_path / "a").samples())) == 1


def test_without_the_gaze_file_the_eye_cameras_show_the_same_movements(tmp_path: Path) -> None:
    eyes = SimulatedEyes(SimulatedSettings(seconds=30.0, rate_hz=60.0, blinks_per_minute=0.0))
    write_recording(eyes, tmp_path / "a")
    (tmp_path / "a" / "gaze.pldata").unlink()
    source = open_recording(tmp_path / "a")
    assert any("centred" in note for note in source.info.notes)
    for eye in Eye:
        told, read = directions(eyes, eye), directions(source, eye)
        offset = read - told
        # The turn to the middle is one about the eye's centre; over ± 12° it bends the angles by half a degree.
        assert np.abs(offset - np.median(offset, axis=0)).max() < 0.5


def directions(source: Source, eye: Eye) -> NDArray[np.float64]:
    gazes = [s for s in source.samples() if isinstance(s, GazeSample) and s.eye is eye]
    return np.array([(s.azimuth_deg, s.elevation_deg) for s in gazes])


def test_nothing_half_written_and_nothing_overwritten(tmp_path: Path) -> None:
    pupil = PupilSample(0, Eye.LEFT, 4.0, 1.0)
    with pytest.raises(SourceError, match="less than 90°"):
        write_recording(of(pupil, GazeSample(0, None, 90.0, 0.0, 1.0)), tmp_path / "a")
    with pytest.raises(SourceError, match="no samples"):
        write_recording(of(), tmp_path / "a")
    assert list(tmp_path.iterdir()) == []
    write_recording(of(pupil), tmp_path / "a")
    with pytest.raises(SourceError, match="exists already"):
        write_recording(of(pupil), tmp_path / "a")
    (tmp_path / "file").write_text("")
    with pytest.raises(SourceError, match="cannot be written"):
        write_recording(of(pupil), tmp_path / "file" / "a")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "file"]


def test_a_failure_on_the_way_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "save", full)
    with pytest.raises(SourceError, match="No space left on device"):
        write_recording(of(PupilSample(0, Eye.LEFT, 4.0, 1.0)), tmp_path / "a")
    assert list(tmp_path.iterdir()) == []


def load(folder: Path, name: str) -> list[tuple[str, dict[str, Any]]]:
    with (folder / f"{name}.pldata").open("rb") as stream:
        messages = list(msgpack.Unpacker(stream))
    return [(topic, msgpack.unpackb(payload)) for topic, payload in messages]


@pytest.mark.shared_data
def test_the_files_are_shaped_as_those_of_capture(tmp_path: Path, shared: Callable[[str], Path]) -> None:
    real = shared("eye/pupil_core/capture_3_6")
    write_recording(SimulatedEyes(SimulatedSettings(seconds=2.0)), tmp_path / "a")
    for name, topic in (("pupil", "pupil.0.3d"), ("gaze", "gaze.3d.01.")):
        theirs = next(datum for its, datum in load(real, name) if its == topic)
        ours = next(datum for its, datum in load(tmp_path / "a", name) if its == topic)
        assert set(theirs) <= set(ours)
        for key, value in theirs.items():
            assert type(ours[key]) is type(value), key
            if isinstance(value, dict):
                assert set(ours[key]) == set(value)
        stamps = np.load(tmp_path / "a" / f"{name}_timestamps.npy")
        assert stamps.dtype == np.load(real / f"{name}_timestamps.npy").dtype
        assert stamps.tolist() == [datum["timestamp"] for _, datum in load(tmp_path / "a", name)]
        assert all(before <= after for before, after in itertools.pairwise(stamps))
    theirs_info, our_info = (json.loads((f / "info.player.json").read_text()) for f in (real, tmp_path / "a"))
    assert set(theirs_info) == set(our_info)
    assert our_info["meta_version"] == theirs_info["meta_version"] == "2.3"
