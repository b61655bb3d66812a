import array
import contextlib
import errno
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import libusb_package
import pytest
from played_tracker import Played, Time, over, samples_in

from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.usb.device import GET_DESCRIPTOR, UsbError, find_tracker
from entoptic.tracker_bridge.sources.usb.remedies import cannot_use, no_backend, no_permission
from entoptic.tracker_bridge.sources.usb.tracker import UsbTracker
from entoptic.tracker_bridge.usb_twin.backend import TwinBackend
from entoptic.tracker_bridge.usb_twin.report import DESCRIPTOR

NO_FILES = Path("/nonexistent")


class Refusing(TwinBackend):
    code = errno.EACCES

    def open_device(self, dev: int) -> Any:
        raise UsbError("Access denied (insufficient permissions)", None, self.code)


@pytest.mark.parametrize("usb_id", [None, "1209:0001"])
def test_without_permission_the_udev_rule_is_told(usb_id: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    with pytest.raises(SourceError) as refused:
        over(Refusing(Played(1.0), timekeeper=Time()), Time(), usb_id)
    text = str(refused.value)
    rule = 'SUBSYSTEM=="usb", ATTRS{idVendor}=="1209", ATTRS{idProduct}=="0001", MODE="0660", TAG+="uaccess"'
    assert rule in text.splitlines()[1]
    assert "/etc/udev/rules.d/70-entoptic-eye-tracker.rules" in text
    assert "udevadm" in text


def test_what_a_refusal_means() -> None:
    assert "Zadig" in no_permission("it", 1, 2, "win32")
    assert "administrator" in no_permission("it", 1, 2, "darwin")
    assert "another program" in cannot_use("it", OSError(errno.EBUSY, "busy"), 1, 2)
    assert "does not answer (gone)" in cannot_use("it", OSError(errno.EIO, "gone"), 1, 2)
    assert "libusb-1.0-0" in no_backend("linux")
    assert "brew" in no_backend("darwin")


def test_a_tracker_in_use_says_so() -> None:
    class Busy(TwinBackend):
        def detach_kernel_driver(self, dev_handle: Any, intf: int) -> None:
            raise UsbError("Resource busy", None, errno.EBUSY)

    with pytest.raises(SourceError, match="in use by another program"):
        over(Busy(Played(1.0), timekeeper=Time()), Time())


def test_without_libusb_the_remedy_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(libusb_package, "get_libusb1_backend", lambda: None)
    with pytest.raises(SourceError, match="no libusb was found"):
        UsbTracker()


class Mouse(TwinBackend):
    """A boot mouse in the tracker's place."""

    detached = 0

    def get_interface_descriptor(self, dev: int, intf: int, alt: int, config: int) -> SimpleNamespace:
        descriptor = super().get_interface_descriptor(dev, intf, alt, config)
        descriptor.bInterfaceSubClass = 1
        return descriptor

    def detach_kernel_driver(self, dev_handle: Any, intf: int) -> None:
        self.detached += 1


def test_nothing_found_says_what_was_seen_and_leaves_mice_alone() -> None:
    mouse = Mouse(Played(1.0), timekeeper=Time())
    with pytest.raises(SourceError, match=r"seen are Entoptic Simulated eye tracker \(1209:0001\), none of them"):
        over(mouse, Time())
    with pytest.raises(
        SourceError, match=r"no eye tracker feed:deed is plugged in: the HID devices seen are 1209:0001"
    ):
        over(mouse, Time(), "feed:deed")
    assert mouse.detached == 0
    assert mouse.handles == []


def test_an_empty_usb_says_so() -> None:
    backend = TwinBackend(Played(1.0), ["unplug@0s:9s"], timekeeper=Time())
    with pytest.raises(SourceError, match="no other HID device was seen: plug it in"):
        over(backend, Time())


def test_another_hid_device_is_asked_and_gets_its_driver_back() -> None:
    class Joystick(TwinBackend):
        def ctrl_transfer(self, dev_handle: Any, *request: Any) -> int:
            if request[1] == GET_DESCRIPTOR and request[2] == 0x2200:
                data: array.array[int] = request[4]
                own = bytes.fromhex("05 01 09 04 a1 01 75 08 95 01 15 80 25 7f 09 30 81 02 c0")
                data[: len(own)] = array.array("B", own)
                return len(own)
            return super().ctrl_transfer(dev_handle, *request)

    backend = Joystick(Played(1.0), timekeeper=Time())
    with pytest.raises(SourceError, match="none of them one"):
        over(backend, Time())
    assert (backend.handles, backend.has_system_driver) == ([], True)


class Kept(TwinBackend):
    """What libusb says on Windows of a device under Windows' own driver."""

    def open_device(self, dev: int) -> Any:
        raise NotImplementedError("Operation not supported or unimplemented on this platform")


def test_a_device_that_windows_keeps_gets_another_driver_only_where_it_is_known_to_be_the_tracker(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sys.platform", "win32")
    with pytest.raises(SourceError, match=r"USB device 1209:0001 \(kept .* name it with --usb-id\)") as unknown:
        over(Kept(Played(1.0), timekeeper=Time()), Time())
    assert "Zadig" not in str(unknown.value)
    with pytest.raises(SourceError, match="Zadig"):
        over(Kept(Played(1.0), timekeeper=Time()), Time(), "1209:0001")


class OfSeveral(TwinBackend):
    """The tracker's interface is the last of four: before it come a keyboard's, one whose endpoint carries nothing, and
    an alternate setting that nobody has selected."""

    def get_configuration_descriptor(self, dev: int, config: int) -> SimpleNamespace:
        descriptor = super().get_configuration_descriptor(dev, config)
        descriptor.bNumInterfaces = 4
        return descriptor

    def get_interface_descriptor(self, dev: int, intf: int, alt: int, config: int) -> SimpleNamespace:
        if intf > 3 or (alt and (intf, alt) != (2, 1)):
            raise IndexError(intf)
        descriptor = super().get_interface_descriptor(dev, 0, 0, config)
        descriptor.bInterfaceNumber, descriptor.bAlternateSetting = intf, alt
        descriptor.bInterfaceSubClass = int(intf == 0)
        descriptor.bNumEndpoints = int((intf, alt) != (2, 0))
        return descriptor

    def get_endpoint_descriptor(self, dev: int, ep: int, intf: int, alt: int, config: int) -> SimpleNamespace:
        descriptor = super().get_endpoint_descriptor(dev, ep, 0, 0, config)
        descriptor.bEndpointAddress = 0x81 + intf
        descriptor.wMaxPacketSize = 0 if intf == 1 else 64
        return descriptor

    def ctrl_transfer(self, dev_handle: Any, *request: Any) -> int:
        to_interface = request[0] & 0x1F == 1
        assert not to_interface or request[3] == 3
        return super().ctrl_transfer(dev_handle, *request)

    def intr_read(self, dev_handle: Any, ep: int, intf: int, buff: Any, timeout: int) -> int:
        assert (ep, intf) == (0x84, 3)
        return super().intr_read(dev_handle, ep, intf, buff, timeout)


@pytest.mark.parametrize("usb_id", [None, "1209:0001"])
def test_of_several_interfaces_the_trackers_alone_is_taken(usb_id: str | None) -> None:
    time = Time()
    backend = OfSeveral(Played(0.5), timekeeper=time)
    assert samples_in(list(over(backend, time, usb_id).samples()))
    assert (backend.handles, backend.has_system_driver) == ([], True)


def test_a_tracker_whose_descriptor_is_broken_says_so() -> None:
    class Broken(TwinBackend):
        def ctrl_transfer(self, dev_handle: Any, *request: Any) -> int:
            sent = super().ctrl_transfer(dev_handle, *request)
            return sent - 1 if request[2] == 0x2200 else sent

    for usb_id, words in (
        (None, r"\(not to be read: collections .* never closed: 1"),
        ("1209:0001", "no eye tracker that can be read"),
    ):
        with pytest.raises(SourceError, match=words):
            over(Broken(Played(1.0), timekeeper=Time()), Time(), usb_id)


def test_where_linux_knows_the_descriptor_the_device_is_not_asked(tmp_path: Path) -> None:
    class Ported(TwinBackend):
        asked = 0

        def get_device_descriptor(self, dev: int) -> SimpleNamespace:
            descriptor = super().get_device_descriptor(dev)
            descriptor.port_numbers = (2, 4)
            return descriptor

        def ctrl_transfer(self, dev_handle: Any, *request: Any) -> int:
            self.asked += request[2] == 0x2200
            return super().ctrl_transfer(dev_handle, *request)

    folder = tmp_path / "1-2.4:1.0" / "0003:1209:0001.0001"
    folder.mkdir(parents=True)
    (folder / "report_descriptor").write_bytes(DESCRIPTOR)
    backend = Ported(Played(1.0), timekeeper=Time())
    with contextlib.closing(find_tracker(backend, None, tmp_path)) as found:
        assert found.connection.descriptor == DESCRIPTOR
    assert backend.asked == 0
    with contextlib.closing(find_tracker(backend, None, NO_FILES)):
        pass
    assert backend.asked == 1


def test_a_system_without_drivers_to_detach_is_no_obstacle() -> None:
    class Plain(TwinBackend):
        def is_kernel_driver_active(self, dev_handle: Any, intf: int) -> bool:
            self.has_system_driver = False
            raise NotImplementedError

    time = Time()
    assert samples_in(list(over(Plain(Played(0.5), timekeeper=time), time).samples()))


@pytest.mark.parametrize("text", ["", "1209", "1209:1", "1209:00zz", "1209-0001", "1209:0001:1"])
def test_what_is_no_usb_id_is_refused(text: str) -> None:
    with pytest.raises(SourceError, match="is no USB ID"):
        UsbTracker(text, backend=TwinBackend(Played(1.0)))
