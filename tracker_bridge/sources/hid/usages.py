"""The usages of HID eye trackers: page 0x12 and this program's vendor page.

Page 0x12 is "Eye and Head Trackers" of the HID Usage Tables. It has no usage for what the pupil does, so this program
defines a vendor page, 0xFF12; docs/usb-tracker.md says what its usages are.
"""

from __future__ import annotations

PAGE = 0x12 << 16
EYE_TRACKER = PAGE | 0x01
TIMESTAMP, POSITION_X, POSITION_Y, POSITION_Z = (PAGE | usage for usage in (0x20, 0x21, 0x22, 0x23))
GAZE_POINT, LEFT_EYE_POSITION, RIGHT_EYE_POSITION = PAGE | 0x24, PAGE | 0x25, PAGE | 0x26
OPTIMUM_DISTANCE = PAGE | 0x102
SCREEN_WIDTH, SCREEN_HEIGHT = PAGE | 0x204, PAGE | 0x205
SAMPLING_FREQUENCY, CONFIGURATION_STATUS, MODE_REQUEST = PAGE | 0x300, PAGE | 0x301, PAGE | 0x400

VENDOR_PAGE = 0xFF12 << 16
PUPIL_DATA, RIGHT_EYE, LEFT_EYE, BOTH_EYES = (VENDOR_PAGE | usage for usage in (0x01, 0x02, 0x03, 0x04))
DIAMETER, IMAGE_DIAMETER, CONFIDENCE = VENDOR_PAGE | 0x20, VENDOR_PAGE | 0x21, VENDOR_PAGE | 0x22
MODEL_CONFIDENCE, OPENNESS, GAZE_CONFIDENCE = VENDOR_PAGE | 0x23, VENDOR_PAGE | 0x24, VENDOR_PAGE | 0x25

MODE_GAZE, MODE_EYES = 1, 2
"""Bits of a mode request; 4 would be the head, of which nothing is used here. Numbered as in GazeHid."""

READY = 1
STATUS_TEXT = {
    1: "ready",
    2: "configuring itself",
    3: "in need of its screen's size: set it up with the maker's program",
    4: "in need of a calibration: run the maker's program",
}
"""Of the usage Configuration Status, numbered as GazeHid and Windows' `GazeDeviceConfigurationStatePreview` do."""
