"""The simulated USB tracker's descriptors other than that of its reports, with pyusb's names for their fields.

USB 2.0, 9.6: device, configuration, interface with its HID descriptor (HID 1.11, 6.2.1), endpoint, strings.
"""

from __future__ import annotations

from entoptic.tracker_bridge.sources.usb.device import HID_CLASS, HID_DESCRIPTOR, REPORT_DESCRIPTOR
from entoptic.tracker_bridge.usb_twin.report import DESCRIPTOR

VENDOR, PRODUCT = 0x1209, 0x0001
"""The pair that pid.codes keeps free for tests."""

STRINGS = ("Entoptic", "Simulated eye tracker")
"""Maker and product."""

PACKET_BYTES = 64
"""Of a full-speed interrupt endpoint (USB 2.0, 5.7.3)."""

TO_DEVICE_STANDARD_IN, STRING_DESCRIPTOR = 0x80, 0x03

_ENGLISH = 0x0409
_FULL_SPEED = 2
_INTERRUPT, _FIRST_IN = 3, 0x81

DEVICE = {
    "bLength": 18,
    "bDescriptorType": 1,
    "bcdUSB": 0x0200,
    "bDeviceClass": 0,
    "bDeviceSubClass": 0,
    "bDeviceProtocol": 0,
    "bMaxPacketSize0": 64,
    "idVendor": VENDOR,
    "idProduct": PRODUCT,
    "bcdDevice": 0x0100,
    "iManufacturer": 1,
    "iProduct": 2,
    "iSerialNumber": 0,
    "bNumConfigurations": 1,
    "bus": 1,
    "port_number": None,
    "port_numbers": None,
    "speed": _FULL_SPEED,
}
"""But for its address, which is new each time it is plugged in. No ports: it hangs on no real bus."""

CONFIGURATION = {
    "bLength": 9,
    "bDescriptorType": 2,
    "wTotalLength": 9 + 9 + 9 + 7,
    "bNumInterfaces": 1,
    "bConfigurationValue": 1,
    "iConfiguration": 0,
    "bmAttributes": 0x80,
    "bMaxPower": 50,
    "extra_descriptors": b"",
}

INTERFACE = {
    "bLength": 9,
    "bDescriptorType": 4,
    "bInterfaceNumber": 0,
    "bAlternateSetting": 0,
    "bNumEndpoints": 1,
    "bInterfaceClass": HID_CLASS,
    "bInterfaceSubClass": 0,
    "bInterfaceProtocol": 0,
    "iInterface": 0,
    "extra_descriptors": bytes([9, HID_DESCRIPTOR, 0x11, 0x01, 0, 1, REPORT_DESCRIPTOR])
    + len(DESCRIPTOR).to_bytes(2, "little"),
}

INTERRUPT_IN = {
    "bLength": 7,
    "bDescriptorType": 5,
    "bEndpointAddress": _FIRST_IN,
    "bmAttributes": _INTERRUPT,
    "wMaxPacketSize": PACKET_BYTES,
    "bInterval": 1,
    "bRefresh": 0,
    "bSynchAddress": 0,
    "extra_descriptors": b"",
}


def string_descriptor(index: int) -> bytes | None:
    """A text, or at 0 the language that texts are in; None for a text that there is not."""
    if index > len(STRINGS):
        return None
    text = STRINGS[index - 1].encode("utf-16-le") if index else _ENGLISH.to_bytes(2, "little")
    return bytes([2 + len(text), STRING_DESCRIPTOR]) + text
