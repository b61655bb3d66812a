"""A USB eye tracker's packets in a file, written while they come, and replayed through the decoder of the live ones.

The file is a row of msgpack arrays, each written whole with one call, so that a program that dies leaves all of them
but perhaps the last:

    ["entoptic usb capture", 1, name, descriptor, packet_bytes, {report ID: feature report}]   when the tracker is found
    [received_ns, packet]                                    each packet as it came, on the machine's monotonic clock

A tracker that was unplugged and came back has a second opening record.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Annotated, Literal

import msgpack  # type: ignore[import-untyped]  # ships no types
import msgspec

from entoptic.tracker_bridge.clock import ArrivalClock
from entoptic.tracker_bridge.samples import GazeSample, PupilSample
from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.hid.items import HidDescriptorError
from entoptic.tracker_bridge.sources.loaded import LoadedSource, load
from entoptic.tracker_bridge.sources.usb.stream import Connection, PacketStream

MAGIC = "entoptic usb capture"
VERSION = 1


class UsbCapture:
    """Writes packets to a new file.

    Raises SourceError where the file exists already or cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            # Unbuffered: each record is with the system before the next packet is read.
            self._file = path.open("xb", buffering=0)
        except FileExistsError:
            raise SourceError(f"{path} exists: a capture never writes over another; name a new file") from None
        except OSError as error:
            raise SourceError(f"{path} cannot be written: {error.strerror}; name a file in a folder of yours") from None

    def connected(self, connection: Connection) -> None:
        """The tracker was found, or came back."""
        features = dict(connection.features)
        self._write([MAGIC, VERSION, connection.name, connection.descriptor, connection.packet_bytes, features])

    def packet(self, packet: bytes, received_ns: int) -> None:
        """A packet came."""
        self._write([received_ns, packet])

    def _write(self, record: list[object]) -> None:
        left = memoryview(msgpack.packb(record))
        try:
            while left:
                # An unbuffered file may take a part at a time: a disk that is nearly full does.
                left = left[self._file.write(left) :]
        except OSError as error:
            raise SourceError(f"{self.path} cannot be written any more: {error.strerror}; make room") from None

    def __enter__(self) -> UsbCapture:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


_MAX_RECORD_BYTES = 1 << 21
"""Longest record that is believed: a descriptor of 64 KiB and 255 features of 4 KiB make the longest true one."""


class _Opening(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    magic: Literal["entoptic usb capture"]
    version: int
    name: str
    descriptor: bytes
    packet_bytes: Annotated[int, msgspec.Meta(ge=1, le=1024)]
    features: dict[int, bytes]


class _Packet(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    received_ns: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
    packet: bytes


def open_usb_file(path: Path) -> LoadedSource:
    """The samples of a capture, in the order of their time on the clock of the machine that captured them.

    A file whose end is cut off is read up to its last whole record, and `info.notes` says so. Raises SourceError where
    the file is no capture, is broken in its middle, or holds no samples.
    """
    pupils: list[PupilSample] = []
    gazes: list[GazeSample] = []
    notes: dict[str, None] = {}
    name = ""
    clock = ArrivalClock()
    stream: PacketStream | None = None
    bad_count = connections = 0
    for record in _records(path, notes):
        if isinstance(record, _Opening):
            if record.version != VERSION:
                raise SourceError(f"{path} is a capture of version {record.version}; this program reads {VERSION}")
            connection = Connection(record.name, record.descriptor, record.packet_bytes, record.features)
            bad_count += 0 if stream is None else stream.bad_count
            try:
                stream = PacketStream(connection, clock)
            except HidDescriptorError as error:
                raise SourceError(f"{path}: {error}; capture the tracker again") from None
            connections += 1
            name = f"{record.name}, captured"
            notes.update(dict.fromkeys(stream.notes))
        elif stream is None:
            raise SourceError(f"{path} is no USB capture: its first record does not say {MAGIC!r}")
        else:
            for item in stream.add(record.packet, record.received_ns):
                if isinstance(item, PupilSample):
                    pupils.append(item)
                elif isinstance(item, GazeSample):
                    gazes.append(item)
    if stream is None:
        raise SourceError(f"{path} is no USB capture: it holds no whole record; name a file that --record-raw wrote")
    bad_count += stream.bad_count
    if connections > 1:
        notes[f"The tracker went away and came back in the capture; times: {connections - 1}."] = None
    if bad_count:
        notes[f"Reports that could not be read and were left out: {bad_count:,}."] = None
    return load(name, pupils, gazes, notes)


def _records(path: Path, notes: dict[str, None]) -> Iterator[_Opening | _Packet]:
    """The records up to the last whole one; what is left over is noted."""
    unpacker = msgpack.Unpacker(
        use_list=True, raw=False, strict_map_key=False, max_buffer_size=_MAX_RECORD_BYTES, read_size=1 << 16
    )
    count = whole = 0
    try:
        with path.open("rb") as file:
            while chunk := file.read(1 << 16):
                unpacker.feed(chunk)
                for record in unpacker:
                    opens = _opens(record)
                    yield msgspec.convert(record, _Opening) if opens else msgspec.convert(record, _Packet)
                    # Taken here: half a record moves it too.
                    count, whole = count + 1, unpacker.tell()
            end = file.tell()
    except OSError as error:
        raise SourceError(f"{path} cannot be read: {error.strerror}; name a file that --record-raw wrote") from None
    except (msgspec.ValidationError, ValueError, TypeError, msgpack.exceptions.UnpackException) as error:
        # TypeError: a map whose key is a list.
        raise SourceError(f"{path} is no USB capture, or is broken at record {count + 1}: {error}") from None
    if whole < end:
        notes[f"The capture is cut off in its record {count + 1}; it was read up to there."] = None


def _opens(record: object) -> bool:
    return isinstance(record, list) and len(record) > 0 and record[0] == MAGIC
