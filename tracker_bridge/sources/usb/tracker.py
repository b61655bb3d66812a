"""A USB eye tracker, live: HID usage page 0x12 through pyusb.

Times are the device's own, carried over to this machine's monotonic clock by `ArrivalClock`. Latency added: none, a
report's samples come with its last packet; the tracker's own delay is not known here.
"""

from __future__ import annotations

import contextlib
import errno
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol

from entoptic.tracker_bridge.clock import ArrivalClock
from entoptic.tracker_bridge.events import SourceBack, SourceSilent, TrackerStatus
from entoptic.tracker_bridge.samples import GazeSample, PupilSample
from entoptic.tracker_bridge.source import Item, SourceError, SourceInfo, Tick
from entoptic.tracker_bridge.sources.usb.capture import UsbCapture
from entoptic.tracker_bridge.sources.usb.device import (
    NoTrackerError,
    Tracker,
    UsbError,
    UsbTimeout,
    find_tracker,
    libusb_backend,
)
from entoptic.tracker_bridge.sources.usb.remedies import usb_id_of
from entoptic.tracker_bridge.sources.usb.stream import PacketStream

READ_TIMEOUT_MS = 40
"""A reader is kept waiting for a tick for twice as long at most: less than the 100 ms that it may be."""

SILENT_AFTER_NS = 1_000_000_000
"""Without a packet for so long, a tracker that is still plugged in counts as silent. Engineering choice: the slowest
send 30 reports a second."""

LOOK_EVERY_NS = 200_000_000
"""How often an unplugged tracker is looked for. Engineering choice: looking costs a few milliseconds."""

MAX_ERRORS = 3
"""After so many errors in a row the tracker is let go and looked for again."""

UNPLUGGED = "was unplugged: plug it in again"


class Timekeeper(Protocol):
    """Whose time it is: the machine's, or that of a test, which need not wait."""

    def now_ns(self) -> int:
        """On a clock that never goes backwards."""
        ...

    def wait_ns(self, duration_ns: int) -> None:
        """Returns when so much time has passed."""
        ...


class MachineTime:
    """The machine's monotonic clock."""

    def now_ns(self) -> int:
        """Now."""
        return time.monotonic_ns()

    def wait_ns(self, duration_ns: int) -> None:
        """Sleeps."""
        time.sleep(duration_ns / 1e9)


class UsbTracker:
    """A live source: the first HID eye tracker that is plugged in, or the one of `usb_id`, "VID:PID".

    The tracker is held only while its samples are read. Every packet goes to a new file at `capture` too, if one is
    named. `backend` is a pyusb backend, libusb by default; `is_over` ends the samples between two packets;
    `notes` go before those that the tracker makes itself.

    Raises SourceError where no tracker is found, or where it may not be used: the message names what was seen, or the
    line that lets it be used.
    """

    def __init__(
        self,
        usb_id: str | None = None,
        *,
        capture: Path | None = None,
        backend: Any = None,
        timekeeper: Timekeeper | None = None,
        is_over: Callable[[], bool] = lambda: False,
        notes: tuple[str, ...] = (),
    ) -> None:
        wanted = None if usb_id is None else usb_id_of(usb_id)
        self._backend = libusb_backend() if backend is None else backend
        self._time = timekeeper or MachineTime()
        self._capture = capture
        self._is_over = is_over
        if capture is not None and capture.exists():
            raise SourceError(f"{capture} exists: a capture never writes over another; name a new file")
        with contextlib.closing(find_tracker(self._backend, wanted)) as tracker:
            # From now on it is this one that is looked for, not whichever is plugged in next.
            self._usb_id = tracker.usb_id
            stream = PacketStream(tracker.connection, ArrivalClock())
            self._info = SourceInfo(
                name=tracker.connection.name,
                t_start_ns=self._time.now_ns(),
                t_end_ns=None,
                notes=(*notes, *stream.notes),
                live=True,
            )

    @property
    def info(self) -> SourceInfo:
        """What this source is."""
        return self._info

    def samples(self) -> Iterator[Item]:
        """Samples as they come, events, and a tick after each report and at least every 100 ms, but for the moment in
        which a tracker is taken: up to 2 s where it leaves every request unanswered.

        A tracker that is unplugged is looked for until it is back. Raises SourceError where the capture's file cannot
        be written.
        """
        with contextlib.ExitStack() as stack:
            capture = None if self._capture is None else stack.enter_context(UsbCapture(self._capture))
            yield from _Session(self._backend, self._usb_id, self._time, capture, self._is_over).run()


class _Session:
    """One reading of a tracker, through all its comings and goings."""

    def __init__(
        self,
        backend: Any,
        usb_id: tuple[int, int],
        timekeeper: Timekeeper,
        capture: UsbCapture | None,
        is_over: Callable[[], bool],
    ) -> None:
        self._backend = backend
        self._usb_id = usb_id
        self._time = timekeeper
        self._capture = capture
        self._is_over = is_over
        # One clock through all connections: it finds out by itself whether the device's went on or began again.
        self._clock = ArrivalClock()
        self._is_flowing = False
        self._reported: str | None = None
        """Why nothing comes, as last told; None while all is well."""

    def run(self) -> Iterator[Item]:
        while not self._is_over():
            try:
                tracker = find_tracker(self._backend, self._usb_id)
            except NoTrackerError as error:
                if self._reported is None:
                    yield from self._tell(str(error))
            except SourceError as error:
                yield from self._tell(str(error))
            else:
                with contextlib.closing(tracker):
                    yield from self._read(tracker)
            yield from self._wait()

    def _tell(self, reason: str) -> Iterator[Item]:
        """Why nothing comes: that it does not at first, then each new reason."""
        if reason != self._reported:
            now_ns = self._time.now_ns()
            is_first, self._reported, self._is_flowing = self._reported is None, reason, False
            yield SourceSilent(now_ns, reason) if is_first else TrackerStatus(now_ns, ready=False, detail=reason)

    def _wait(self) -> Iterator[Item]:
        until_ns = self._time.now_ns() + LOOK_EVERY_NS
        while (now_ns := self._time.now_ns()) < until_ns and not self._is_over():
            yield Tick(now_ns)
            self._time.wait_ns(min(READ_TIMEOUT_MS * 1_000_000, until_ns - now_ns))

    def _read(self, tracker: Tracker) -> Iterator[Item]:
        """One connection, until it breaks."""
        stream = PacketStream(tracker.connection, self._clock)
        if self._capture is not None:
            self._capture.connected(tracker.connection)
        if stream.status is not None:
            yield TrackerStatus(self._time.now_ns(), stream.status.is_ready, str(stream.status))
        errors = 0
        received_ns = item_ns = self._time.now_ns()
        while not self._is_over():
            try:
                packet = tracker.read(READ_TIMEOUT_MS)
            except UsbTimeout:
                now_ns = self._time.now_ns()
                if now_ns - received_ns >= SILENT_AFTER_NS:
                    yield from self._tell(f"{tracker.connection.name} is plugged in but sends nothing")
                yield Tick(now_ns)
                continue
            except UsbError as error:
                errors += 1
                reason = self._mend(tracker, error, errors)
                stream.lose()
                now_ns = self._time.now_ns()
                if reason is not None:
                    yield from self._tell(f"{tracker.connection.name} {reason}")
                    yield Tick(now_ns)
                    return
                yield from stream.complain(f"a report broke off ({error.strerror})", now_ns)
                yield Tick(now_ns)
                continue
            errors = 0
            received_ns = self._time.now_ns()
            if self._capture is not None:
                self._capture.packet(packet, received_ns)
            items = stream.add(packet, received_ns)
            if items:
                item_ns = received_ns
            elif received_ns - item_ns >= READ_TIMEOUT_MS * 1_000_000:
                # Packets come, but nothing of use.
                item_ns = received_ns
                items = [Tick(received_ns)]
            for item in items:
                if not self._is_flowing and isinstance(item, PupilSample | GazeSample):
                    self._is_flowing, self._reported = True, None
                    yield SourceBack(received_ns)
                yield item

    def _mend(self, tracker: Tracker, error: Any, errors: int) -> str | None:
        """Makes the tracker go on after an error, or says why it cannot."""
        if error.errno == errno.ENODEV:
            return UNPLUGGED
        if errors >= MAX_ERRORS:
            return f"fails again and again ({error.strerror}): plug it in again, without a hub between"
        # libusb reports a stall as a pipe error; some systems as an input/output error.
        if error.errno in (errno.EPIPE, errno.EIO):
            try:
                tracker.clear_halt()
            except UsbError as halt_error:
                if halt_error.errno == errno.ENODEV:
                    return UNPLUGGED
                return f"stalled and cannot be cleared ({halt_error.strerror}): plug it in again"
        return None
