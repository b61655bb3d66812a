"""A simulated USB eye tracker: a recording played as a device, on a USB that exists in memory alone.

It stands where libusb stands, below pyusb, so that all of the live tracker's own code runs: enumeration, descriptors,
the system's driver, control requests, packets of 64 bytes. It comes with the faults that real devices have.
"""

from __future__ import annotations

import array
import collections
import errno
import itertools
import random
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace

import usb.backend  # type: ignore[import-untyped]  # ships no types

from entoptic.tracker_bridge.samples import GazeSample, PupilSample
from entoptic.tracker_bridge.source import Source, SourceError
from entoptic.tracker_bridge.sources.hid.descriptor import ReportKind
from entoptic.tracker_bridge.sources.usb.device import (
    GET_DESCRIPTOR,
    GET_REPORT,
    REPORT_DESCRIPTOR,
    SET_REPORT,
    TO_INTERFACE_CLASS_IN,
    TO_INTERFACE_CLASS_OUT,
    TO_INTERFACE_STANDARD_IN,
    UsbError,
    UsbTimeout,
)
from entoptic.tracker_bridge.sources.usb.tracker import MachineTime, Timekeeper, UsbTracker
from entoptic.tracker_bridge.usb_twin.descriptors import (
    CONFIGURATION,
    DEVICE,
    INTERFACE,
    INTERRUPT_IN,
    PACKET_BYTES,
    STRING_DESCRIPTOR,
    TO_DEVICE_STANDARD_IN,
    string_descriptor,
)
from entoptic.tracker_bridge.usb_twin.faults import Fault, parse_faults
from entoptic.tracker_bridge.usb_twin.report import (
    DESCRIPTOR,
    MODE_ID,
    feature_report,
    status_report,
    tracking_report,
)

POWERED_NS = 5_000_000_000
"""How long the device has been powered when it is first read: its clock is not the machine's."""

Moment = tuple[int, tuple[PupilSample | GazeSample, ...]]


def open_usb_simulated(
    recording: Source,
    faults: Sequence[str] = (),
    *,
    seed: int = 1,
    capture: Path | None = None,
    timekeeper: Timekeeper | None = None,
    begun_ns: int | None = None,
) -> UsbTracker:
    """A live tracker that plays this recording at its own pace, and ends with it.

    `begun_ns`: when it began on the timekeeper's clock, if it did before; it goes on where it is by now. Raises
    SourceError where the recording is a live source, or a fault cannot be read.
    """
    own_time = timekeeper or MachineTime()
    backend = TwinBackend(recording, faults, seed=seed, timekeeper=own_time, begun_ns=begun_ns)
    notes = (f"There is no device: {recording.info.name} is played as one.", *recording.info.notes)
    return UsbTracker(backend=backend, capture=capture, timekeeper=own_time, is_over=backend.is_over, notes=notes)


class _Handle:
    """An opened device; dead once the device was unplugged."""

    def __init__(self, plugging: int) -> None:
        self.plugging = plugging
        self.claimed: set[int] = set()


class TwinBackend(usb.backend.IBackend):  # type: ignore[misc]  # pyusb has no types
    """A USB with one device on it. Time begins with the first packet that is asked for.

    The same recording, faults and seed give the same packets, at times that depend on the reader alone.
    """

    def __init__(
        self,
        recording: Source,
        faults: Sequence[str] = (),
        *,
        seed: int = 1,
        timekeeper: Timekeeper | None = None,
        begun_ns: int | None = None,
    ) -> None:
        if recording.info.live:
            raise SourceError(f"{recording.info.name} is live: a simulated tracker plays recordings, name one")
        self._time = timekeeper or MachineTime()
        self._faults = parse_faults(faults)
        self._pending = [fault for fault in self._faults if fault.duration_ns == 0]
        self._unplugs = sorted((fault for fault in self._faults if fault.kind == "unplug"), key=lambda f: f.start_ns)
        self._rng = random.Random(seed)
        self._moments = _moments(recording)
        self._next = next(self._moments, None)
        self._started_ns = begun_ns
        self._plugging = 0
        self.handles: list[_Handle] = []
        """Those that are open."""
        self._power_on()
        if begun_ns is not None:
            self._pass_over(self._time.now_ns() - begun_ns)

    def _pass_over(self, elapsed_ns: int) -> None:
        """What is past was for whoever read it before."""
        while self._next is not None and self._next[0] < elapsed_ns:
            self._next = next(self._moments, None)
        self._pending = [fault for fault in self._pending if fault.start_ns >= elapsed_ns]

    def _power_on(self) -> None:
        self._packets: collections.deque[bytes] = collections.deque(_packets(status_report()))
        self._mode = 0
        self._is_halted = False
        self.has_system_driver = True
        """Whether the system's own driver holds the interface."""

    def is_over(self) -> bool:
        """Whether all was sent."""
        return self._next is None and not self._packets

    def _elapsed_ns(self) -> int:
        elapsed_ns = 0 if self._started_ns is None else self._time.now_ns() - self._started_ns
        pluggings = sum(fault.start_ns <= elapsed_ns for fault in self._unplugs)
        if pluggings != self._plugging:
            self._plugging = pluggings
            self._power_on()
        return elapsed_ns

    def _is_unplugged(self, elapsed_ns: int) -> bool:
        return any(fault.covers(elapsed_ns) for fault in self._unplugs)

    def _check(self, handle: _Handle) -> int:
        elapsed_ns = self._elapsed_ns()
        if self._is_unplugged(elapsed_ns) or handle.plugging != self._plugging:
            raise UsbError("No such device (it may have been disconnected)", None, errno.ENODEV)
        return elapsed_ns

    # What follows is usb.backend.IBackend.

    def enumerate_devices(self) -> Iterator[int]:
        """The device, while it is plugged in."""
        if not self._is_unplugged(self._elapsed_ns()):
            yield self._plugging

    def get_device_descriptor(self, dev: int) -> SimpleNamespace:
        """The device's, at a new address each time it is plugged in."""
        return SimpleNamespace(**DEVICE, address=1 + dev)

    def get_configuration_descriptor(self, dev: int, config: int) -> SimpleNamespace:
        """There is but one."""
        return _only(CONFIGURATION, config)

    def get_interface_descriptor(self, dev: int, intf: int, alt: int, config: int) -> SimpleNamespace:
        """There is but one."""
        return _only(INTERFACE, intf, alt, config)

    def get_endpoint_descriptor(self, dev: int, ep: int, intf: int, alt: int, config: int) -> SimpleNamespace:
        """There is but one."""
        return _only(INTERRUPT_IN, ep, intf, alt, config)

    def open_device(self, dev: int) -> _Handle:
        """A new handle."""
        handle = _Handle(dev)
        self._check(handle)
        self.handles.append(handle)
        return handle

    def close_device(self, dev_handle: _Handle) -> None:
        """Closes it."""
        self.handles.remove(dev_handle)

    def set_configuration(self, dev_handle: _Handle, config_value: int) -> None:
        """There is but one."""
        self._check(dev_handle)

    def get_configuration(self, dev_handle: _Handle) -> int:
        """The one that the system chose."""
        self._check(dev_handle)
        return 1

    def claim_interface(self, dev_handle: _Handle, intf: int) -> None:
        """Refused while the system's driver holds the interface, as Linux does."""
        self._check(dev_handle)
        if self.has_system_driver:
            raise UsbError("Resource busy", None, errno.EBUSY)
        dev_handle.claimed.add(intf)

    def release_interface(self, dev_handle: _Handle, intf: int) -> None:
        """Gives it back."""
        self._check(dev_handle)
        dev_handle.claimed.discard(intf)

    def is_kernel_driver_active(self, dev_handle: _Handle, intf: int) -> bool:
        """Whether the system's driver holds the interface."""
        self._check(dev_handle)
        return self.has_system_driver

    def detach_kernel_driver(self, dev_handle: _Handle, intf: int) -> None:
        """Takes it from the system's driver."""
        self._check(dev_handle)
        self.has_system_driver = False

    def attach_kernel_driver(self, dev_handle: _Handle, intf: int) -> None:
        """Gives it back to the system's driver."""
        self._check(dev_handle)
        self.has_system_driver = True

    def clear_halt(self, dev_handle: _Handle, ep: int) -> None:
        """Ends a stall."""
        self._check(dev_handle)
        self._is_halted = False

    def ctrl_transfer(
        self,
        dev_handle: _Handle,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: array.array[int],
        timeout: int,
    ) -> int:
        """Standard and HID requests; any other is answered by a stall."""
        self._check(dev_handle)
        request, index = (bmRequestType, bRequest, wValue >> 8), wValue & 0xFF
        answer: bytes | None = None
        if request == (TO_INTERFACE_CLASS_OUT, SET_REPORT, ReportKind.FEATURE) and index == MODE_ID and len(data) == 2:
            if self._started_ns is not None:
                # What was seen up to now was seen in the old mode.
                self._send_until(self._elapsed_ns())
            self._mode = data[1]
            return len(data)
        if request == (TO_INTERFACE_CLASS_IN, GET_REPORT, ReportKind.FEATURE):
            answer = feature_report(index, self._mode)
        elif request == (TO_INTERFACE_STANDARD_IN, GET_DESCRIPTOR, REPORT_DESCRIPTOR):
            answer = DESCRIPTOR
        elif request == (TO_DEVICE_STANDARD_IN, GET_DESCRIPTOR, STRING_DESCRIPTOR):
            answer = string_descriptor(index)
        if answer is None:
            raise UsbError("Pipe error", None, errno.EPIPE)
        sent = answer[: len(data)]
        data[: len(sent)] = array.array("B", sent)
        return len(sent)

    def intr_read(self, dev_handle: _Handle, ep: int, intf: int, buff: array.array[int], timeout: int) -> int:
        """The next packet, when its time has come."""
        if self._started_ns is None:
            self._started_ns = self._time.now_ns()
        deadline_ns = self._elapsed_ns() + timeout * 1_000_000
        while True:
            elapsed_ns = self._check(dev_handle)
            self._send_until(elapsed_ns)
            if self._is_halted:
                raise UsbError("Pipe error", None, errno.EPIPE)
            if self._packets:
                packet = self._packets.popleft()
                buff[: len(packet)] = array.array("B", packet)
                return len(packet)
            if elapsed_ns >= deadline_ns or self.is_over():
                raise UsbTimeout("Operation timed out", None, errno.ETIMEDOUT)
            self._time.wait_ns(self._change_ns(elapsed_ns, deadline_ns) - elapsed_ns)

    def _change_ns(self, elapsed_ns: int, deadline_ns: int) -> int:
        """When something happens next."""
        times = [deadline_ns, *(fault.start_ns for fault in self._faults if fault.start_ns > elapsed_ns)]
        return min(times if self._next is None else [*times, self._next[0]])

    def _send_until(self, elapsed_ns: int) -> None:
        """Makes packets of all moments that are past."""
        while self._next is not None and self._next[0] <= elapsed_ns:
            at_ns, samples = self._next
            self._next = next(self._moments, None)
            self._stall(at_ns)
            silent = any(fault.covers(at_ns) for fault in self._faults if fault.kind in ("unplug", "timeout"))
            if not (silent or self._is_halted or self._mode == 0):
                report = tracking_report(samples, (at_ns - self._power_ns(at_ns)) // 1000, self._mode)
                self._packets.extend(self._spoilt(report, at_ns))
        self._stall(elapsed_ns)

    def _stall(self, elapsed_ns: int) -> None:
        for fault in [fault for fault in self._pending if fault.kind == "stall" and fault.start_ns <= elapsed_ns]:
            self._pending.remove(fault)
            self._packets.clear()
            self._is_halted = True

    def _power_ns(self, at_ns: int) -> int:
        """When the device was last powered: its clock's zero."""
        return max((fault.end_ns for fault in self._unplugs if fault.end_ns <= at_ns), default=-POWERED_NS)

    def _spoilt(self, report: bytes, at_ns: int) -> list[bytes]:
        """The report's packets, after the faults of its time."""
        for fault in self._faults_at(at_ns):
            match fault.kind:
                case "short":
                    return _packets(report[: self._rng.randrange(1, len(report))])
                case "long":
                    return _packets(report + self._rng.randbytes(self._rng.randrange(1, len(report))))
                case "garbage":
                    return _packets(self._rng.randbytes(self._rng.randrange(1, 2 * len(report))))
        return _packets(report)

    def _faults_at(self, at_ns: int) -> list[Fault]:
        due = [fault for fault in self._pending if fault.start_ns <= at_ns]
        for fault in due:
            self._pending.remove(fault)
        return due + [fault for fault in self._faults if fault.covers(at_ns)]


def _moments(recording: Source) -> Iterator[Moment]:
    """All samples of each time of the recording, by the time since its first."""
    samples = (sample for sample in recording.samples() if isinstance(sample, PupilSample | GazeSample))
    for t_ns, group in itertools.groupby(samples, key=lambda sample: sample.t_ns):
        yield t_ns - recording.info.t_start_ns, tuple(group)


def _packets(report: bytes) -> list[bytes]:
    """As a USB controller sends them: full ones, and a last one that is shorter, be it empty."""
    return [report[at : at + PACKET_BYTES] for at in range(0, len(report) + 1, PACKET_BYTES)]


def _only(descriptor: Mapping[str, object], *indices: int) -> SimpleNamespace:
    if any(indices):
        raise IndexError(indices)
    return SimpleNamespace(**descriptor)
