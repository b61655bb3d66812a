"""A USB eye tracker's packets in a file, written while they come.

The file is a row of msgpack arrays, each written whole with one call, so that a program that dies leaves all of them
but perhaps the last:

    ["entoptic usb capture", 1, name, descriptor, packet_bytes, {report ID: feature report}]   when the tracker is found
    [received_ns, packet]                                    each packet as it came, on the machine's monotonic clock

A tracker that was unplugged and came back has a second opening record.
"""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

import msgpack  # type: ignore[import-untyped]  # ships no types

from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.usb_stream import Connection

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
