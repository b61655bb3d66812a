"""A HID eye tracker on the USB: finding it, and talking to it. The one module that calls pyusb.

Requests are those of HID 1.11, 7.1 and 7.2; errors are pyusb's USBError, whose `errno` libusb's codes are mapped to.
"""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import libusb_package
import usb.backend  # type: ignore[import-untyped]  # ships no types
import usb.core  # type: ignore[import-untyped]
import usb.util  # type: ignore[import-untyped]

from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.hid.descriptor import ReportKind, parse_report_descriptor
from entoptic.tracker_bridge.sources.hid.eye_tracker import EyeTrackerReports
from entoptic.tracker_bridge.sources.hid.items import HidDescriptorError
from entoptic.tracker_bridge.sources.hid.usages import EYE_TRACKER
from entoptic.tracker_bridge.sources.usb.remedies import cannot_use, no_backend, no_permission
from entoptic.tracker_bridge.sources.usb.stream import Connection

UsbError = usb.core.USBError
UsbTimeout = usb.core.USBTimeoutError

HID_CLASS = 3
BOOT_SUBCLASS = 1
"""Of keyboards and mice (HID 1.11, 4.2): they are never taken from the system only to look whether they track eyes."""

GET_DESCRIPTOR, GET_REPORT, SET_REPORT = 0x06, 0x01, 0x09
HID_DESCRIPTOR, REPORT_DESCRIPTOR = 0x21, 0x22
TO_INTERFACE_STANDARD_IN, TO_INTERFACE_CLASS_IN, TO_INTERFACE_CLASS_OUT = 0x81, 0xA1, 0x21

UNSAID_DESCRIPTOR_BYTES = 4096
"""Asked for where the HID descriptor does not say how long the report descriptor is; a device sends what it has."""

CONTROL_TIMEOUT_MS = 500
"""Engineering choice: the USB lets a device take 5 s, but a tracker's settings lie ready."""

_LOST = (errno.ENODEV, errno.EACCES, errno.EPERM)
"""Errors after which nothing more can be asked. Any other may be the refusal of one request: a device shows it by a
stall, and systems report it as a pipe error, an input/output error, an overflow or an error without a number."""

_KEPT = " (kept by the system's driver: if this is it, name it with --usb-id)"

KERNEL_DEVICES = Path("/sys/bus/usb/devices")
"""Where Linux shows USB devices, with the report descriptor of each that its own HID driver holds."""


def libusb_backend() -> Any:
    """The libusb that comes with `libusb-package`, or the system's. Raises SourceError where there is neither."""
    backend = libusb_package.get_libusb1_backend()
    if backend is None:
        raise SourceError(no_backend())
    return backend


class NoTrackerError(SourceError):
    """No eye tracker is plugged in."""


class Tracker:
    """An eye tracker that is plugged in, opened."""

    def __init__(self, device: Any, interface: Any, descriptor: bytes) -> None:
        self.usb_id = (int(device.idVendor), int(device.idProduct))
        self._device = device
        self._interface = int(interface.bInterfaceNumber)
        self._endpoint = _interrupt_in(interface)
        self._has_taken = False
        try:
            self._take()
            reports = EyeTrackerReports(descriptor)
            features = self._features(reports)
            self._request_mode(reports)
        except BaseException:
            self.close()
            raise
        self.connection = Connection(name_of(device), descriptor, _packet_bytes(self._endpoint), features)

    def _take(self) -> None:
        """Takes the interface from the system's own driver, which would read the reports away."""
        self._has_taken = _detach(self._device, self._interface)
        try:
            self._device.get_active_configuration()
        except UsbError as error:
            if error.errno in _LOST:
                raise
            self._device.set_configuration()
        usb.util.claim_interface(self._device, self._interface)

    def _features(self, reports: EyeTrackerReports) -> dict[int, bytes]:
        """The feature reports that the tracker gives. One that leaves a request unanswered is asked no more: whoever
        waits for samples waits for this too."""
        features = {}
        for layout in reports.features:
            wanted = ReportKind.FEATURE << 8 | layout.report_id
            try:
                report = self._device.ctrl_transfer(
                    TO_INTERFACE_CLASS_IN, GET_REPORT, wanted, self._interface, layout.length, CONTROL_TIMEOUT_MS
                )
            except UsbTimeout:
                break
            except UsbError as error:
                if error.errno in _LOST:
                    raise
                continue
            if report:
                features[layout.report_id] = bytes(report)
        return features

    def _request_mode(self, reports: EyeTrackerReports) -> None:
        """Asks for gaze and eye positions; a tracker that refuses sends what it sends."""
        request = reports.mode_request()
        if request is None:
            return
        layout, report = request
        wanted = ReportKind.FEATURE << 8 | layout.report_id
        try:
            self._device.ctrl_transfer(
                TO_INTERFACE_CLASS_OUT, SET_REPORT, wanted, self._interface, report, CONTROL_TIMEOUT_MS
            )
        except UsbError as error:
            if error.errno in _LOST:
                raise

    def read(self, timeout_ms: int) -> bytes:
        """The next packet. Raises UsbTimeout where none comes within this time, and UsbError."""
        return bytes(self._endpoint.read(self.connection.packet_bytes, timeout_ms))

    def clear_halt(self) -> None:
        """Lets an endpoint go on that has stalled."""
        self._endpoint.clear_halt()

    def close(self) -> None:
        """Gives the interface back to the system, as far as the tracker is still there."""
        _give_back(self._device, self._interface, self._has_taken)
        with contextlib.suppress(UsbError):
            usb.util.dispose_resources(self._device)


def find_tracker(backend: Any, usb_id: tuple[int, int] | None, kernel_devices: Path = KERNEL_DEVICES) -> Tracker:
    """The first eye tracker that is plugged in, or the one of this vendor and product.

    Raises NoTrackerError where there is none, saying what was seen, and SourceError where it may not be used.
    """
    seen: list[str] = []
    refused: SourceError | None = None
    for device in _devices(backend):
        interfaces = list(_hid_interfaces(device))
        if interfaces:
            # A device must be opened for its name: not what to do to every keyboard while a known tracker is awaited.
            seen.append(name_of(device) if usb_id is None else f"{device.idVendor:04x}:{device.idProduct:04x}")
        if usb_id is not None and (device.idVendor, device.idProduct) != usb_id:
            continue
        for interface in interfaces:
            if interface.bInterfaceSubClass == BOOT_SUBCLASS:
                continue
            try:
                descriptor = _kernel_copy(device, interface, kernel_devices) or _borrowed_descriptor(device, interface)
                if EYE_TRACKER in parse_report_descriptor(descriptor).applications:
                    return Tracker(device, interface, descriptor)
            except UsbError as error:
                refused = refused or SourceError(cannot_use(name_of(device), error, device.idVendor, device.idProduct))
            except NotImplementedError:
                # So says libusb on Windows of what is under Windows' own driver. Unless this is known to be the tracker
                # nobody shall be told to give it another driver: it may be their keyboard.
                if usb_id is not None:
                    refused = refused or SourceError(no_permission(name_of(device), *usb_id))
                seen[-1] = seen[-1].removesuffix(_KEPT) + _KEPT
            except HidDescriptorError as error:
                if usb_id is not None:
                    refused = refused or SourceError(f"{name_of(device)} is no eye tracker that can be read: {error}")
                seen[-1] += f" (not to be read: {error})"
        usb.util.dispose_resources(device)
    raise refused or NoTrackerError(_nothing_found(usb_id, seen))


def _devices(backend: Any) -> list[Any]:
    try:
        devices = list(usb.core.find(find_all=True, backend=backend))
    except UsbError as error:
        raise SourceError(f"the USB cannot be searched ({error.strerror}): try again") from None
    for device in devices:
        # Of the requests that pyusb makes by itself, such as those for a device's name.
        device.default_timeout = CONTROL_TIMEOUT_MS
    return devices


def name_of(device: Any) -> str:
    """A device as a person knows it, as far as it may be asked."""
    number = f"{device.idVendor:04x}:{device.idProduct:04x}"
    try:
        words = " ".join(text for text in (device.manufacturer, device.product) if text)
    except (UsbError, ValueError, NotImplementedError):
        # Not to be opened, or without texts.
        words = ""
    return f"{words} ({number})" if words else f"USB device {number}"


def _nothing_found(usb_id: tuple[int, int] | None, seen: Iterable[str]) -> str:
    wanted = "eye tracker" if usb_id is None else f"eye tracker {usb_id[0]:04x}:{usb_id[1]:04x}"
    devices = ", ".join(seen)
    if not devices:
        return f"no {wanted} is plugged in, and no other HID device was seen: plug it in"
    return f"no {wanted} is plugged in: the HID devices seen are {devices}, none of them one; plug it in"


def _hid_interfaces(device: Any) -> Iterator[Any]:
    with contextlib.suppress(UsbError):
        for configuration in device:
            for interface in configuration:
                # HID has no use for alternate settings, and nobody has selected them: their endpoints are dead.
                is_hid = interface.bInterfaceClass == HID_CLASS and interface.bAlternateSetting == 0
                if is_hid and _interrupt_in(interface) is not None:
                    yield interface


def _interrupt_in(interface: Any) -> Any:
    for endpoint in interface:
        is_in = usb.util.endpoint_direction(endpoint.bEndpointAddress) == usb.util.ENDPOINT_IN
        is_interrupt = usb.util.endpoint_type(endpoint.bmAttributes) == usb.util.ENDPOINT_TYPE_INTR
        if is_in and is_interrupt and _packet_bytes(endpoint) > 0:
            return endpoint
    return None


def _packet_bytes(endpoint: Any) -> int:
    """Of one packet: the bits above count packets per microframe (USB 2.0, 9.6.6)."""
    return int(endpoint.wMaxPacketSize) & 0x7FF


def _kernel_copy(device: Any, interface: Any, kernel_devices: Path) -> bytes | None:
    """The report descriptor as Linux has read it already: nobody's driver is disturbed, and anybody may read it."""
    if not device.port_numbers:
        return None
    port = ".".join(str(number) for number in device.port_numbers)
    configuration = device[interface.configuration].bConfigurationValue
    number = f"{device.bus}-{port}:{configuration}.{interface.bInterfaceNumber}"
    try:
        return next((path.read_bytes() for path in (kernel_devices / number).glob("*/report_descriptor")), None)
    except OSError:
        return None


def _borrowed_descriptor(device: Any, interface: Any) -> bytes:
    """The report descriptor as the device gives it; the system's driver has its interface back afterwards."""
    number = int(interface.bInterfaceNumber)
    has_taken = _detach(device, number)
    try:
        return _asked_descriptor(device, interface)
    finally:
        _give_back(device, number, has_taken)


def _asked_descriptor(device: Any, interface: Any) -> bytes:
    length = _descriptor_bytes(bytes(interface.extra_descriptors))
    return bytes(
        device.ctrl_transfer(
            TO_INTERFACE_STANDARD_IN,
            GET_DESCRIPTOR,
            REPORT_DESCRIPTOR << 8,
            int(interface.bInterfaceNumber),
            length,
            CONTROL_TIMEOUT_MS,
        )
    )


def _descriptor_bytes(extra: bytes) -> int:
    """How long the report descriptor is, by the HID descriptor among those that follow an interface (HID 1.11, 6.2.1):
    its length, 0x21, version (2), country, count, then a type and a length (2) for each."""
    while len(extra) >= 2 and extra[0] >= 2:
        own, extra = extra[: extra[0]], extra[extra[0] :]
        if own[1] == HID_DESCRIPTOR:
            for at in range(6, len(own) - 2, 3):
                if own[at] == REPORT_DESCRIPTOR:
                    return int.from_bytes(own[at + 1 : at + 3], "little")
    return UNSAID_DESCRIPTOR_BYTES


def _detach(device: Any, number: int) -> bool:
    """Whether the system's driver had to let go of this interface; systems other than Linux have no such call."""
    try:
        if not device.is_kernel_driver_active(number):
            return False
        device.detach_kernel_driver(number)
    except NotImplementedError:
        return False
    except UsbError as error:
        if error.errno in (errno.ENOSYS, errno.ENOENT, errno.ENOTSUP):
            return False
        raise
    return True


def _give_back(device: Any, number: int, has_taken: bool) -> None:
    """The interface to whoever comes next, first of all to the system's driver if it had it."""
    with contextlib.suppress(UsbError):
        usb.util.release_interface(device, number)
    if has_taken:
        with contextlib.suppress(UsbError, NotImplementedError):
            device.attach_kernel_driver(number)
