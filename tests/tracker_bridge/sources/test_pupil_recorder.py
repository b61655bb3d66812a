import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import msgpack
import numpy as np
import pytest

from entoptic.tracker_bridge.samples import NS_PER_S, Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.sources.loaded import Sample, sort_key
from entoptic.tracker_bridge.sources.pupil_core import recorder as pupil_recorder
from entoptic.tracker_bridge.sources.pupil_core.recorder import PupilRecorder, RecordingError
from entoptic.tracker_bridge.sources.pupil_core.recording import open_recording
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings

PERIOD_NS = NS_PER_S // 200


def pupil(at: int, eye: Eye = Eye.RIGHT) -> PupilSample:
    return PupilSample(at * PERIOD_NS, eye, 4.0, 1.0, 1.0, 20.0)


def of_a_time(at: int) -> list[Sample]:
    gazes = [GazeSample(at * PERIOD_NS, eye, 1.0, 2.0, 1.0) for eye in (*Eye, None)]
    return [*(pupil(at, eye) for eye in Eye), *gazes]


def record(recorder: PupilRecorder, count: int, wait_s: float = 0.0) -> None:
    for at in range(count):
        recorder.add(pupil(at))
        time.sleep(wait_s)


def test_a_recording_holds_what_pupil_player_wants(tmp_path: Path) -> None:
    with PupilRecorder(tmp_path / "new" / "000", start_synced_s=10.0, start_system_s=1.7e9) as recorder:
        for sample in of_a_time(2200):
            recorder.add(sample)
    assert sorted(file.name for file in (tmp_path / "new" / "000").iterdir()) == [
        "gaze.pldata",
        "gaze_timestamps.npy",
        "info.player.json",
        "pupil.pldata",
        "pupil_timestamps.npy",
    ]
    info = json.loads((tmp_path / "new" / "000" / "info.player.json").read_text())
    assert info["duration_s"] == pytest.approx(1.0)
    assert (info["start_time_synced_s"], info["start_time_system_s"]) == (10.0, 1.7e9)
    assert np.load(tmp_path / "new" / "000" / "pupil_timestamps.npy").tolist() == [11.0, 11.0]


def test_live_samples_in_any_order_read_back_the_same(tmp_path: Path) -> None:
    samples: list[Sample] = list(SimulatedEyes(SimulatedSettings(seconds=0.5)).samples())
    shuffled = [samples[at] for at in np.random.default_rng(1).permutation(len(samples))]
    with PupilRecorder(tmp_path / "a") as recorder:
        for sample in [*shuffled, shuffled[0], shuffled[0]]:
            recorder.add(sample)
    read = open_recording(tmp_path / "a")
    assert [sort_key(sample) for sample in read.samples()] == [sort_key(sample) for sample in samples]
    assert [s for s in read.samples() if isinstance(s, PupilSample)] == [
        s for s in samples if isinstance(s, PupilSample)
    ]


def test_a_direction_that_no_scene_camera_sees_is_left_out_and_counted(tmp_path: Path) -> None:
    with PupilRecorder(tmp_path / "a") as recorder:
        recorder.add(pupil(0))
        recorder.add(GazeSample(0, None, -120.0, 0.0, 1.0))
        assert recorder.unwritable == 1
    assert list(open_recording(tmp_path / "a").samples()) == [pupil(0)]


def test_an_existing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="exists already: choose another name"):
        PupilRecorder(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match=r"file/a cannot be written: .*Choose another place"):
        PupilRecorder(tmp_path / "file" / "a")


def test_a_full_disk_keeps_what_was_written_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The disk takes half of a message, then no more; the timestamps and the info still fit."""
    write, left = os.write, 3000

    def write_until_full(file: int, data: memoryview) -> int:
        nonlocal left
        if left == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        done = write(file, data[: min(len(data), left)])
        left -= done
        return done

    monkeypatch.setattr(pupil_recorder.os, "write", write_until_full)
    recorder = PupilRecorder(tmp_path / "a")
    with pytest.raises(RecordingError, match=r"pupil\.pldata .*No space left on device.*make room"):
        record(recorder, 1000)
    recorder.add(pupil(2000))
    recorder.close()
    source = open_recording(tmp_path / "a")
    assert source.info.notes == ()
    read = [sample for sample in source.samples() if isinstance(sample, PupilSample)]
    assert len(read) > 5
    assert read == [pupil(at) for at in range(len(read))]
    assert len(np.load(tmp_path / "a" / "pupil_timestamps.npy")) == len(read)


def test_a_disk_that_refuses_to_keep_it_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(file: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    recorder = PupilRecorder(tmp_path / "a")
    recorder.add(pupil(0))
    monkeypatch.setattr(pupil_recorder.os, "fsync", fail)
    with pytest.raises(RecordingError, match="Input/output error"):
        record(recorder, 10_000, wait_s=0.01)
    assert len(list(open_recording(tmp_path / "a").samples())) > 1


def test_a_disk_without_room_for_the_timestamps_leaves_no_file_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(file: Path, stamps: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    recorder = PupilRecorder(tmp_path / "a")
    for sample in of_a_time(0):
        recorder.add(sample)
    recorder.add(pupil(1))
    files = [stream._file for stream in recorder._streams.values()]
    assert len(files) == 2
    monkeypatch.setattr(pupil_recorder.np, "save", fail)
    with pytest.raises(RecordingError, match="cannot be finished: No space left on device"):
        recorder.close()
    for file in files:
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(file)


CHILD = """
import sys
from pathlib import Path
from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.sources.pupil_core.recorder import PupilRecorder

recorder = PupilRecorder(Path(sys.argv[1]))
for at in range(10**9):
    for eye in Eye:
        recorder.add(PupilSample(at * 5_000_000, eye, 4.0, 1.0, 1.0, 20.0))
    for of in (*Eye, None):
        recorder.add(GazeSample(at * 5_000_000, of, 1.0, 2.0, 1.0))
    print(at, flush=True)
"""


def test_a_killed_program_loses_only_the_newest_time(tmp_path: Path) -> None:
    """The child says which times it has handed over; whenever the kill strikes, all of them but the last are there."""
    child = subprocess.Popen([sys.executable, "-c", CHILD, str(tmp_path / "a")], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    for line in child.stdout:
        if int(line) == 600:
            break
    child.send_signal(signal.SIGKILL)
    handed_over = max([600, *(int(line) for line in child.stdout.read().split("\n")[:-1])])
    assert child.wait() == -signal.SIGKILL
    source = open_recording(tmp_path / "a")
    times = {sample.t_ns // PERIOD_NS for sample in source.samples()}
    assert times == set(range(max(times) + 1))
    assert max(times) >= handed_over - 1
    assert handed_over * PERIOD_NS - source.info.t_end_ns < NS_PER_S
    per_time = [sort_key(sample)[1:] for sample in source.samples() if sample.t_ns == 500 * PERIOD_NS]
    assert len(per_time) == 5
    assert json.loads((tmp_path / "a" / "info.player.json").read_text())["duration_s"] == 0.0


def test_half_a_message_behind_a_power_failure_is_left_out(tmp_path: Path) -> None:
    with PupilRecorder(tmp_path / "a") as recorder:
        for at in range(10):
            recorder.add(pupil(at))
    file = tmp_path / "a" / "pupil.pldata"
    file.write_bytes(file.read_bytes()[:-7])
    assert len(list(open_recording(tmp_path / "a").samples())) == 9


def test_any_datum_can_be_recorded_as_it_is(tmp_path: Path) -> None:
    datum = {"topic": "blinks", "timestamp": 3.0, "type": "onset", "base_data": []}
    with PupilRecorder(tmp_path / "a", start_synced_s=1.0) as recorder:
        recorder.write("blinks", datum)
    assert msgpack.unpackb((tmp_path / "a" / "blinks.pldata").read_bytes()) == ["blinks", msgpack.packb(datum)]
    assert np.load(tmp_path / "a" / "blinks_timestamps.npy").tolist() == [3.0]
