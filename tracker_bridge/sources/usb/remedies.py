"""What to do where a USB tracker cannot be had: texts for people, by operating system."""

from __future__ import annotations

import errno
import re
import sys

from entoptic.tracker_bridge.source import SourceError

UDEV_FILE = "/etc/udev/rules.d/70-entoptic-eye-tracker.rules"
"""Below 73, where systemd's rules give what is tagged `uaccess` to whoever sits at the machine."""

NO_BACKEND = {
    "linux": "install the package `libusb-package` into this Python, or libusb 1.0 (Debian: `libusb-1.0-0`)",
    "darwin": "install the package `libusb-package` into this Python, or `brew install libusb`",
    "win32": "install the package `libusb-package` into this Python",
}


def usb_id_of(text: str) -> tuple[int, int]:
    """Vendor's and product's number from "VID:PID", four hexadecimal digits each.

    Raises SourceError for anything else.
    """
    if not re.fullmatch(r"[0-9a-fA-F]{4}:[0-9a-fA-F]{4}", text):
        raise SourceError(f"{text!r} is no USB ID: give vendor and product as `lsusb` shows them, such as 1209:0001")
    vendor, product = text.split(":")
    return int(vendor, 16), int(product, 16)


def udev_rule(vendor: int, product: int) -> str:
    """The line that lets whoever sits at a Linux machine use this device."""
    match = f'ATTRS{{idVendor}}=="{vendor:04x}", ATTRS{{idProduct}}=="{product:04x}"'
    return f'SUBSYSTEM=="usb", {match}, MODE="0660", TAG+="uaccess"'


def no_permission(name: str, vendor: int, product: int, platform: str | None = None) -> str:
    """What stands between this program and a device that the system (this one unless named) does not give it."""
    platform = platform or sys.platform
    if platform.startswith("linux"):
        return (
            f"no permission to use {name}: put this line into {UDEV_FILE}\n"
            f"    {udev_rule(vendor, product)}\n"
            "then run `sudo udevadm control --reload-rules && sudo udevadm trigger`, and plug the tracker in again"
        )
    if platform == "win32":
        return f"no permission to use {name}: give it the WinUSB driver (with Zadig), Windows keeps HID to itself"
    return f"no permission to use {name}: run this program as an administrator, macOS keeps HID devices to itself"


def no_backend(platform: str | None = None) -> str:
    """There is no libusb."""
    platform = platform or sys.platform
    remedy = NO_BACKEND.get("linux" if platform.startswith("linux") else platform, NO_BACKEND["linux"])
    return f"no libusb was found, through which USB devices are reached: {remedy}"


def cannot_use(name: str, error: OSError, vendor: int, product: int) -> str:
    """What an error on opening a device means."""
    if error.errno in (errno.EACCES, errno.EPERM):
        return no_permission(name, vendor, product)
    if error.errno == errno.EBUSY:
        return f"{name} is in use by another program: end it (the maker's own software, another bridge)"
    return f"{name} does not answer ({error.strerror or error}): plug it in again, without a hub between"
