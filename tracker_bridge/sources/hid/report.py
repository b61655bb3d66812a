"""HID reports: from the bytes of packets to reports, and from a report to the numbers in it. Pure.

Numbers begin at the lowest bit of the first byte, and a report ID, where there is one, is a byte before them (HID
1.11, 5.6 and 8.1). A report longer than one packet is sent as full packets and a last one that is shorter (USB 2.0,
5.7.3).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import msgspec

from entoptic.tracker_bridge.sources.hid.descriptor import CONSTANT, VARIABLE, MainItem, ReportDescriptor, ReportKind
from entoptic.tracker_bridge.sources.hid.items import HidDescriptorError

CM_TO_MM, INCH_TO_MM = 10.0, 25.4

_LENGTH, _TIME = 0x10, 0x1000
"""Unit items of one dimension, without their system (HID 1.11, 6.2.2.7)."""

_SI_LINEAR, _ENGLISH_LINEAR = 1, 3
"""Systems whose lengths are cm and inches; in all four of them a time is in s."""

MAX_FIELDS = 10_000
"""Numbers in all reports of a device. Engineering choice: real trackers have tens; it bounds memory."""


class HidReportError(ValueError):
    """A packet or report is not what the descriptor promises: the message says how, and it is left out."""


class UnknownReportError(HidReportError):
    """No report has this ID."""


class ShortReportError(HidReportError):
    """A report ends before its last field."""


class LongReportError(HidReportError):
    """A report goes on after its last field."""


class Field(msgspec.Struct, frozen=True):
    """One number of a report."""

    usage: int
    """What it is; page in the high 16 bits."""
    collections: tuple[int, ...]
    """Usages of the collections around it, from the outermost."""
    offset_bits: int
    """From the first bit after the report ID."""
    size_bits: int
    item: MainItem
    """What declared it: its limits and its unit."""

    def raw(self, bits: int) -> int:
        """The number as it stands in a report's bits, with its sign, whether or not it lies within its limits."""
        value = bits >> self.offset_bits & (1 << self.size_bits) - 1
        if self.item.logical_min < 0 and value >> self.size_bits - 1:
            value -= 1 << self.size_bits
        return value

    def value(self, bits: int) -> int | None:
        """The number, or None where it lies outside its limits: then it says nothing (HID 1.11, 5.10)."""
        value = self.raw(bits)
        return value if self.item.logical_min <= value <= self.item.logical_max else None


class ReportLayout(msgspec.Struct, frozen=True):
    """Where the numbers of a report stand."""

    kind: ReportKind
    report_id: int
    """0 where the device numbers no reports, so that no byte says which it is."""
    length: int
    """Bytes in all, the report ID included."""
    fields: tuple[Field, ...]
    """All that have a usage, those too that are flagged constant: a tracker's positions are so in GazeHid."""

    def bits(self, report: bytes) -> int:
        """A report as one number without its ID.

        Raises UnknownReportError, ShortReportError or LongReportError.
        """
        _check_length(len(report), self.length)
        if self.report_id and report[0] != self.report_id:
            raise UnknownReportError(f"report {report[0]:#04x} came where {self.report_id:#04x} was to come")
        return int.from_bytes(report[1:] if self.report_id else report, "little")

    def report(self, values: Mapping[Field, int]) -> bytes:
        """A report of these numbers, all others 0."""
        bits = 0
        for field, value in values.items():
            bits |= (value & (1 << field.size_bits) - 1) << field.offset_bits
        head = bytes([self.report_id]) if self.report_id else b""
        return head + bits.to_bytes(self.length - len(head), "little")


def report_layouts(descriptor: ReportDescriptor) -> dict[tuple[ReportKind, int], ReportLayout]:
    """All reports by kind and ID.

    Arrays, which say which of many buttons are pressed, hold no numbers and make no fields. Raises HidDescriptorError
    where there are more numbers than are believed.
    """
    count = sum(item.count for item in descriptor.items if item.usages)
    if count > MAX_FIELDS:
        raise HidDescriptorError(f"{count:,} numbers in one device's reports: at most {MAX_FIELDS:,} are believed")
    fields: dict[tuple[ReportKind, int], list[Field]] = {}
    bits: dict[tuple[ReportKind, int], int] = {}
    for item in descriptor.items:
        report = (item.kind, item.report_id)
        offset = bits.get(report, 0)
        bits[report] = offset + item.size_bits * item.count
        own = fields.setdefault(report, [])
        if item.usages and (item.flags & VARIABLE or item.flags & CONSTANT):
            for at, usage in enumerate(item.field_usages()):
                if usage is not None:
                    own.append(Field(usage, item.collections, offset + at * item.size_bits, item.size_bits, item))
    return {
        report: ReportLayout(*report, length=-(-size // 8) + bool(report[1]), fields=tuple(fields[report]))
        for report, size in bits.items()
    }


class Scale(msgspec.Struct, frozen=True):
    """What a field's number means: number × factor + offset."""

    factor: float
    offset: float

    def __call__(self, value: int) -> float:
        """The quantity."""
        return value * self.factor + self.offset


def length_mm(field: Field) -> Scale | None:
    """A length in mm; None where the field's unit is none."""
    unit = field.item.unit
    if unit == _LENGTH | _SI_LINEAR:
        return _scale(field, CM_TO_MM)
    return _scale(field, INCH_TO_MM) if unit == _LENGTH | _ENGLISH_LINEAR else None


def count_ns(field: Field) -> int | None:
    """What one count of a time is, in ns, 10 or more; None where the field's unit is no time."""
    unit, power = field.item.unit, 9 + field.item.unit_exponent
    return int(10**power) if unit & ~0xF == _TIME and 1 <= unit & 0xF <= 4 else None


def plain(field: Field) -> Scale:
    """A number without a unit, or in the unit that its usage fixes."""
    return _scale(field, 1.0)


def _scale(field: Field, unit: float) -> Scale:
    """From logical to physical limits, where such are declared, then by the power of ten (HID 1.11, 6.2.2.7)."""
    item = field.item
    power = unit * 10.0**item.unit_exponent
    if item.physical_min == item.physical_max == 0 or item.logical_max == item.logical_min:
        return Scale(power, 0.0)
    slope = (item.physical_max - item.physical_min) / (item.logical_max - item.logical_min)
    return Scale(slope * power, (item.physical_min - item.logical_min * slope) * power)


def joined(fields: Sequence[Field], bits: int) -> int:
    """One unsigned number that stands in several fields, the lowest first: a time as eight bytes."""
    value = shift = 0
    for field in fields:
        value |= (field.raw(bits) & (1 << field.size_bits) - 1) << shift
        shift += field.size_bits
    return value


class Reassembly:
    """Packets in, whole input reports out.

    After an error all is left out up to the next short packet, which is where a report ends, unless there are reports
    that fill their last packet: at most two reports are lost. Latency: none; a report is given with its last packet.
    """

    def __init__(self, layouts: Iterable[ReportLayout], packet_bytes: int) -> None:
        self._layouts = {layout.report_id: layout for layout in layouts if layout.kind is ReportKind.INPUT}
        self._packet_bytes = packet_bytes
        self._all_end_short = all(layout.length % packet_bytes for layout in self._layouts.values())
        self.clear()

    def clear(self) -> None:
        """Forgets a report that was begun: after a stall or an unplugging its rest will not come."""
        self._begun = b""
        self._is_lost = False

    def add(self, packet: bytes) -> tuple[ReportLayout, bytes] | None:
        """The report that this packet completes, with its layout; None where more is to come.

        Raises UnknownReportError, ShortReportError or LongReportError, and is ready for the next packet then.
        """
        is_last = len(packet) < self._packet_bytes
        if self._is_lost:
            self._is_lost = not is_last
            return None
        if not packet and not self._begun:
            return None  # what ends a report that filled its last packet
        self._begun += packet
        report = self._begun
        layout = self._layouts.get(report[0], self._layouts.get(0))
        if layout is not None and (len(report) == layout.length or (len(report) < layout.length and not is_last)):
            if len(report) < layout.length:
                return None
            self._begun = b""
            return layout, report
        self._begun, self._is_lost = b"", self._all_end_short and not is_last
        if layout is None:
            raise UnknownReportError(f"report {report[0]:#04x} came, which the descriptor does not have")
        _check_length(len(report), layout.length)
        return None


def _check_length(found: int, expected: int) -> None:
    if found < expected:
        raise ShortReportError(f"a report of {found} B came where {expected} B were to come")
    if found > expected:
        raise LongReportError(f"a report of {found} B or more came where {expected} B were to come")
