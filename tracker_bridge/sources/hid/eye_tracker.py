"""A HID eye tracker: its reports, its state and its settings. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import msgspec

from entoptic.tracker_bridge.sources.hid.descriptor import ReportKind, parse_report_descriptor
from entoptic.tracker_bridge.sources.hid.items import HidDescriptorError
from entoptic.tracker_bridge.sources.hid.report import (
    HidReportError,
    ReportLayout,
    length_mm,
    plain,
    report_layouts,
)
from entoptic.tracker_bridge.sources.hid.tracking import MICROMETRE, Point, Tracking, TrackingReader, read_one
from entoptic.tracker_bridge.sources.hid.usages import (
    CONFIGURATION_STATUS,
    EYE_TRACKER,
    MODE_EYES,
    MODE_GAZE,
    MODE_REQUEST,
    OPTIMUM_DISTANCE,
    READY,
    SAMPLING_FREQUENCY,
    SCREEN_HEIGHT,
    SCREEN_WIDTH,
    STATUS_TEXT,
)

_ASKED = {OPTIMUM_DISTANCE, SCREEN_WIDTH, SCREEN_HEIGHT, CONFIGURATION_STATUS}


class Status(msgspec.Struct, frozen=True):
    """How the tracker says it is."""

    code: int | None
    rate_hz: float | None

    @property
    def is_ready(self) -> bool:
        """Whether it tracks."""
        return self.code == READY

    def __str__(self) -> str:
        text = STATUS_TEXT.get(self.code or 0, f"in a state without a name ({self.code})")
        rate = f", {self.rate_hz:g} samples per second" if self.rate_hz else ""
        return f"the tracker is {text}{rate}"


class Configuration(msgspec.Struct, frozen=True):
    """What the tracker's features say; None for what they do not."""

    screen_mm: Point | None = None
    """Width and height of the display that it was set up for."""
    optimum_distance_mm: float | None = None
    status: Status | None = None


class EyeTrackerReports:
    """The reports of one tracker.

    Raises HidDescriptorError where the descriptor is broken, or is no eye tracker's.
    """

    def __init__(self, descriptor: bytes) -> None:
        parsed = parse_report_descriptor(descriptor)
        if EYE_TRACKER not in parsed.applications:
            raise HidDescriptorError("the device is no eye tracker: it has no collection of usage 0x12:0x01")
        self.notes: list[str] = []
        """What of the descriptor had to be left out or assumed, a sentence each."""
        layouts = report_layouts(parsed)
        self.inputs = tuple(layout for (kind, _), layout in layouts.items() if kind is ReportKind.INPUT)
        """All reports that the tracker may send by itself."""
        features = [layout for (kind, _), layout in layouts.items() if kind is ReportKind.FEATURE]
        self.features = tuple(layout for layout in features if _usages(layout) & _ASKED)
        """The feature reports worth asking for."""
        self._mode = next((layout for layout in features if MODE_REQUEST in _usages(layout)), None)
        self._tracking = {layout.report_id: TrackingReader(layout, self._note) for layout in self.inputs}
        self._statuses = {layout.report_id for layout in self.inputs if CONFIGURATION_STATUS in _usages(layout)}
        if not any(reader.has_time for reader in self._tracking.values()):
            self._note("The tracker tells no time; samples are dated by their arrival.")
        if not any(reader.has_pupils for reader in self._tracking.values()):
            self._note("The tracker reports no pupil: page 0x12 has none, and it lacks the vendor page 0xFF12.")

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)

    def read(self, layout: ReportLayout, report: bytes) -> tuple[Status | None, Tracking | None]:
        """What an input report says of the tracker and of the eyes; None where it says nothing that is known here.

        Raises HidReportError for a report of another length or ID, or of an impossible time.
        """
        bits = layout.bits(report)
        status = _read_status([(layout, bits)]) if layout.report_id in self._statuses else None
        return status, self._tracking[layout.report_id].read(bits)

    def configuration(self, reports: Mapping[int, bytes]) -> Configuration:
        """What these feature reports say, by their ID; those of a wrong length are left out with a note."""
        features = []
        for layout in self.features:
            try:
                if layout.report_id in reports:
                    features.append((layout, layout.bits(reports[layout.report_id])))
            except HidReportError as error:
                self._note(f"A feature was left out: {error}.")
        width, height, distance = (
            _positive(_feature(features, usage)) for usage in (SCREEN_WIDTH, SCREEN_HEIGHT, OPTIMUM_DISTANCE)
        )
        screen = (width, height) if width is not None and height is not None else None
        return Configuration(screen, distance, _read_status(features))

    def mode_request(self) -> tuple[ReportLayout, bytes] | None:
        """The feature report that asks for gaze and eye positions; None where the tracker takes no such request."""
        if self._mode is None:
            return None
        field = next(field for field in self._mode.fields if field.usage == MODE_REQUEST)
        return self._mode, self._mode.report({field: MODE_GAZE | MODE_EYES})


def _usages(layout: ReportLayout) -> set[int]:
    return {field.usage for field in layout.fields}


def _feature(reports: Iterable[tuple[ReportLayout, int]], usage: int) -> float | None:
    for layout, bits in reports:
        for field in layout.fields:
            if field.usage == usage:
                scale = MICROMETRE if field.item.unit == 0 else length_mm(field)
                return None if scale is None else read_one((field, scale), bits)
    return None


def _read_status(reports: Iterable[tuple[ReportLayout, int]]) -> Status | None:
    for layout, bits in reports:
        found = {field.usage: field for field in layout.fields}
        if (code := found.get(CONFIGURATION_STATUS)) is not None:
            rate = found.get(SAMPLING_FREQUENCY)
            return Status(code.value(bits), None if rate is None else read_one((rate, plain(rate)), bits))
    return None


def _positive(value: float | None) -> float | None:
    """Zero is what a feature holds that nobody has set."""
    return value if value is not None and value > 0.0 else None
