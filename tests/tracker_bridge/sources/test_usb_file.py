from pathlib import Path

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st
from played_tracker import Played, Time, samples_in

from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.usb.capture import UsbCapture, open_usb_file
from entoptic.tracker_bridge.sources.usb.stream import Connection
from entoptic.tracker_bridge.usb_twin.backend import open_usb_simulated
from entoptic.tracker_bridge.usb_twin.report import DESCRIPTOR, tracking_report


def captured(path: Path, *faults: str) -> list[PupilSample | GazeSample]:
    source = open_usb_simulated(Played(3.0), faults, capture=path, timekeeper=Time())
    return samples_in(list(source.samples()))


@pytest.mark.parametrize(
    "faults", [(), ("unplug@1s:0.5s",), ("stall@1s", "short@1.5s", "long@2s", "garbage@2.5s:0.1s"), ("timeout@1s:1s",)]
)
def test_a_capture_gives_the_samples_that_were_seen(tmp_path: Path, faults: tuple[str, ...]) -> None:
    path = tmp_path / "a.usbcapture"
    live = captured(path, *faults)
    replayed = open_usb_file(path)
    again = list(replayed.samples())
    # A recording is in order of time: at one moment pupils before gaze, as reports have them.
    assert again == live
    assert not replayed.info.live
    assert replayed.info.name == "Entoptic Simulated eye tracker (1209:0001), captured"
    assert any("came back in the capture; times: 1." in note for note in replayed.info.notes) == (
        "unplug@1s:0.5s" in faults
    )
    assert any("could not be read" in note for note in replayed.info.notes) == ("stall@1s" in faults)


def test_a_capture_never_writes_over_a_file(tmp_path: Path) -> None:
    path = tmp_path / "a.usbcapture"
    path.write_bytes(b"precious")
    with pytest.raises(SourceError, match="never writes over"):
        open_usb_simulated(Played(3.0), capture=path, timekeeper=Time())
    with pytest.raises(SourceError, match="never writes over"):
        UsbCapture(path)
    assert path.read_bytes() == b"precious"
    with pytest.raises(SourceError, match="cannot be written"):
        UsbCapture(tmp_path / "nowhere" / "a")


def test_each_packet_is_in_the_file_before_the_next_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.usbcapture"
    with UsbCapture(path) as capture:
        capture.connected(Connection("it", DESCRIPTOR, 64, {}))
        before = path.stat().st_size
        capture.packet(b"\x13\x01\x00\x00", 5)
        assert msgpack.unpackb(path.read_bytes()[before:]) == [5, b"\x13\x01\x00\x00"]


def test_a_packet_that_the_disk_takes_in_parts_is_whole_in_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.usbcapture"
    with UsbCapture(path) as capture:
        whole = capture._file

        class Sparing:
            def write(self, data: memoryview) -> int:
                return whole.write(data[:3])

        monkeypatch.setattr(capture, "_file", Sparing())
        capture.packet(b"\x13\x01\x00\x00", 5)
        monkeypatch.undo()
    assert msgpack.unpackb(path.read_bytes()) == [5, b"\x13\x01\x00\x00"]


@given(st.integers(0, 100_000))
def test_a_file_cut_anywhere_is_read_up_to_its_last_whole_record(
    tmp_path_factory: pytest.TempPathFactory, cut: int
) -> None:
    path = tmp_path_factory.mktemp("cut") / "a.usbcapture"
    ends = []
    with UsbCapture(path) as capture:
        capture.connected(Connection("it", DESCRIPTOR, 64, {}))
        ends.append(path.stat().st_size)
        for at in range(20):
            report = tracking_report([PupilSample(0, Eye.LEFT, 4.0, 0.9)], 10_000 * at, mode=3)
            for start in (0, 64):
                capture.packet(report[start : start + 64], 10_000_000 * at)
                ends.append(path.stat().st_size)
    whole = path.read_bytes()
    cut %= len(whole)
    path.write_bytes(whole[:cut])
    records = sum(end <= cut for end in ends)
    if records < 3:
        # No report of two packets is whole.
        with pytest.raises(SourceError, match=r"no whole record|holds no samples"):
            open_usb_file(path)
        return
    source = open_usb_file(path)
    assert len(list(source.samples())) == (records - 1) // 2
    notes = [note for note in source.info.notes if "cut off" in note]
    assert bool(notes) == (cut not in ends)
    assert all(f"in its record {records + 1}" in note for note in notes)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no whole record"),
        (b"time,diameter\n1,2\n", "no USB capture"),
        (msgpack.packb([1, b"\x10"]), "first record"),
        (msgpack.packb(["entoptic usb capture", 2, "it", b"", 64, {}]), "version 2"),
        (msgpack.packb(["entoptic usb capture", 1, "it", b"\xff", 64, {}]), "cut off"),
        (msgpack.packb(["entoptic usb capture", 1, "it", DESCRIPTOR, 0, {}]), "broken at record 1"),
        (msgpack.packb(["entoptic usb capture", 1, "it", DESCRIPTOR, 64, {}]), "holds no samples"),
        (msgpack.packb(["entoptic usb capture", 1, "it", DESCRIPTOR, 64, {}]) + b"\xc1", "broken at record 2"),
        (msgpack.packb(["entoptic usb capture", 1, "it", DESCRIPTOR, 64, {}]) + b"\x81\x90\x00", "broken"),
        (
            msgpack.packb(["entoptic usb capture", 1, "it", DESCRIPTOR, 64, {}]) + b"\x93\x01\x02\x03",
            "broken at record",
        ),
    ],
)
def test_what_is_no_capture_is_refused(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "a.usbcapture"
    path.write_bytes(content)
    with pytest.raises(SourceError, match=words):
        open_usb_file(path)


def test_a_missing_capture_is_named(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="cannot be read"):
        open_usb_file(tmp_path / "none")


@given(st.binary(max_size=300))
def test_any_bytes_after_the_opening_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, noise: bytes
) -> None:
    path = tmp_path_factory.mktemp("noise") / "a.usbcapture"
    path.write_bytes(msgpack.packb(["entoptic usb capture", 1, "it", DESCRIPTOR, 64, {}]) + noise)
    with pytest.raises(SourceError):
        open_usb_file(path)
