"""HID report descriptors: what a USB device says its reports hold. Pure.

Written after "Device Class Definition for Human Interface Devices" 1.11 (HID 1.11), sections 5 and 6.2.2.

Theory of operation: a descriptor is a row of items. Global items change a state that stays, and that can be pushed and
popped; local items hold for the next main item alone; a main item makes fields of both, or opens or closes a
collection. Fields are kept as the main items that declare them, never one by one: four bytes may claim four billion
fields, and must not cost memory before they are refused.
"""

from __future__ import annotations

import enum
import itertools
from collections.abc import Iterator
from typing import NamedTuple

import msgspec
from msgspec.structs import replace

from entoptic.tracker_bridge.sources.hid.items import HidDescriptorError, Item, ItemKind, items_of, unit_exponent

MAX_DESCRIPTOR_BYTES = 0xFFFF
"""wDescriptorLength has 16 bits (HID 1.11, 6.2.1)."""

MAX_REPORT_BYTES = 4096
"""Longest report that is believed. Engineering choice: real reports have tens of bytes, and what claims to be longer
is broken or hostile; it bounds memory and the time that a report takes to read."""

MAX_DEPTH = 32
"""Deepest nesting of collections, and of pushed states. Engineering choice: real descriptors nest four deep."""

CONSTANT, VARIABLE = 1 << 0, 1 << 1
"""Bits of an Input, Output or Feature item (HID 1.11, 6.2.2.5)."""


class ReportKind(enum.IntEnum):
    """Which way a report goes, numbered as GET_REPORT and SET_REPORT number it (HID 1.11, 7.2.1)."""

    INPUT = 1
    OUTPUT = 2
    FEATURE = 3


class MainItem(msgspec.Struct, frozen=True):
    """Fields of equal size that follow one another in a report."""

    kind: ReportKind
    report_id: int
    """0 where the device numbers no reports."""
    flags: int
    size_bits: int
    count: int
    """1 or more."""
    usages: tuple[tuple[int, int], ...]
    """First and last usage of each range declared, page in the high 16 bits; empty for padding."""
    collections: tuple[int, ...]
    """Usages of the collections around it, from the outermost; 0 for a collection without one."""
    logical_min: int
    logical_max: int
    physical_min: int
    """Both physical limits are 0 where none were declared: then values mean what they are."""
    physical_max: int
    unit: int
    """System in the low four bits, then an exponent for each of length, mass, time and so on; 0 for no unit."""
    unit_exponent: int
    """Power of ten, −8 … 7."""

    def field_usages(self) -> Iterator[int | None]:
        """The usage of each field in order: the last one declared holds for all that are left; None for padding."""
        declared = itertools.chain.from_iterable(range(first, last + 1) for first, last in self.usages)
        usage = None
        for _ in range(self.count):
            usage = next(declared, usage)
            yield usage


class ReportDescriptor(msgspec.Struct, frozen=True):
    """A whole descriptor."""

    items: tuple[MainItem, ...]
    """In the order in which their bits follow one another in each report."""
    applications: tuple[int, ...]
    """Usages of the outermost collections: what the device is."""

    @property
    def has_report_ids(self) -> bool:
        """Whether each report begins with a byte that says which it is."""
        return any(item.report_id for item in self.items)


def parse_report_descriptor(data: bytes) -> ReportDescriptor:
    """What these bytes declare.

    Raises HidDescriptorError where they are cut off, unbalanced, of an undefined kind, or claim a report of more than
    4096 bytes.
    """
    if len(data) > MAX_DESCRIPTOR_BYTES:
        raise HidDescriptorError(f"a report descriptor of {len(data):,} bytes: at most {MAX_DESCRIPTOR_BYTES:,} can be")
    parser = _Parser()
    for item in items_of(data):
        parser.take(item)
    return parser.finish()


class _Limit(NamedTuple):
    """A limit whose sign is not known before the other one is (HID 1.11, 5.8)."""

    signed: int
    unsigned: int


class _Globals(msgspec.Struct, frozen=True):
    page: int | None = None
    logical_min: int = 0
    logical_max: _Limit = _Limit(0, 0)
    physical_min: int = 0
    physical_max: _Limit = _Limit(0, 0)
    unit_exponent: int = 0
    unit: int = 0
    size_bits: int | None = None
    report_id: int = 0
    count: int | None = None


class _Usage(NamedTuple):
    """A usage as declared: its page comes from the state at the main item, unless it brought its own."""

    at: int
    value: int
    is_extended: bool

    def full(self, page: int | None) -> int:
        if self.is_extended:
            return self.value
        if page is None:
            raise HidDescriptorError(f"a usage without a usage page (byte {self.at} of the report descriptor)")
        return page << 16 | self.value


class _Parser:
    def __init__(self) -> None:
        self._state = _Globals()
        self._pushed: list[_Globals] = []
        self._collections: list[int] = []
        self._applications: list[int] = []
        self._items: list[MainItem] = []
        self._bits: dict[tuple[ReportKind, int], int] = {}
        self._forget_locals()

    def _forget_locals(self) -> None:
        self._ranges: list[tuple[_Usage, _Usage]] = []
        self._range_start: _Usage | None = None
        self._is_delimited = False
        self._alternatives = 0

    def take(self, item: Item) -> None:
        if item.kind == ItemKind.MAIN:
            self._main(item)
            self._forget_locals()
        elif item.kind == ItemKind.GLOBAL:
            self._global(item)
        elif item.kind == ItemKind.LOCAL:
            self._local(item)
        else:
            raise item.error("an item of the reserved type 3")

    def finish(self) -> ReportDescriptor:
        if self._collections:
            raise HidDescriptorError(
                f"collections of the report descriptor that are never closed: {len(self._collections)}"
            )
        descriptor = ReportDescriptor(tuple(self._items), tuple(self._applications))
        if descriptor.has_report_ids and not all(item.report_id for item in self._items):
            raise HidDescriptorError("some reports of the descriptor have an ID and some have none")
        return descriptor

    def _main(self, item: Item) -> None:
        if self._is_delimited:
            raise item.error("a set of alternative usages is never closed")
        if self._range_start is not None:
            raise item.error("a range of usages has no end")
        match item.tag:
            case 0x8:
                self._fields(item, ReportKind.INPUT)
            case 0x9:
                self._fields(item, ReportKind.OUTPUT)
            case 0xB:
                self._fields(item, ReportKind.FEATURE)
            case 0xA:
                if len(self._collections) == MAX_DEPTH:
                    raise item.error(f"collections nest deeper than {MAX_DEPTH}")
                usage = self._ranges[0][0].full(self._state.page) if self._ranges else 0
                if not self._collections:
                    self._applications.append(usage)
                self._collections.append(usage)
            case 0xC:
                if not self._collections:
                    raise item.error("the end of a collection that never began")
                self._collections.pop()
            case _:
                raise item.error(f"the undefined main item {item.tag:#x}")

    def _fields(self, item: Item, kind: ReportKind) -> None:
        state = self._state
        if state.size_bits is None or state.count is None:
            raise item.error("fields without a report size and a report count")
        if state.count == 0:
            return
        if state.size_bits == 0:
            raise item.error("fields of no bits")
        report = (kind, state.report_id)
        self._bits[report] = self._bits.get(report, 0) + state.size_bits * state.count
        if self._bits[report] > 8 * MAX_REPORT_BYTES:
            raise item.error(
                f"a report of {self._bits[report] // 8:,} bytes and more: at most {MAX_REPORT_BYTES:,} are believed"
            )
        logical_max = _agreeing(state.logical_min, state.logical_max)
        if self._ranges and state.logical_min > logical_max:
            raise item.error(f"values from {state.logical_min} to {logical_max}")
        self._items.append(
            MainItem(
                kind=kind,
                report_id=state.report_id,
                flags=item.unsigned,
                size_bits=state.size_bits,
                count=state.count,
                usages=tuple((first.full(state.page), last.full(state.page)) for first, last in self._ranges),
                collections=tuple(self._collections),
                logical_min=state.logical_min,
                logical_max=logical_max,
                physical_min=state.physical_min,
                physical_max=_agreeing(state.physical_min, state.physical_max),
                unit=state.unit,
                unit_exponent=state.unit_exponent,
            )
        )

    def _global(self, item: Item) -> None:
        state, value = self._state, item.unsigned
        match item.tag:
            case 0x0:
                if not 1 <= value <= 0xFFFF:
                    raise item.error(f"usage page {value:#x}")
                self._state = replace(state, page=value)
            case 0x1:
                self._state = replace(state, logical_min=item.signed)
            case 0x2:
                self._state = replace(state, logical_max=_Limit(item.signed, value))
            case 0x3:
                self._state = replace(state, physical_min=item.signed)
            case 0x4:
                self._state = replace(state, physical_max=_Limit(item.signed, value))
            case 0x5:
                self._state = replace(state, unit_exponent=unit_exponent(item))
            case 0x6:
                self._state = replace(state, unit=value)
            case 0x7:
                self._state = replace(state, size_bits=value)
            case 0x8:
                if not 1 <= value <= 0xFF:
                    raise item.error(f"report ID {value}: it goes from 1 to 255")
                self._state = replace(state, report_id=value)
            case 0x9:
                self._state = replace(state, count=value)
            case 0xA:
                if len(self._pushed) == MAX_DEPTH:
                    raise item.error(f"more than {MAX_DEPTH} states are pushed")
                self._pushed.append(state)
            case 0xB:
                if not self._pushed:
                    raise item.error("a state is popped that was never pushed")
                self._state = self._pushed.pop()
            case _:
                raise item.error(f"the undefined global item {item.tag:#x}")

    def _local(self, item: Item) -> None:
        usage = _Usage(item.at, item.unsigned, is_extended=len(item.data) == 4)
        match item.tag:
            case 0x0:
                self._declare(usage, usage)
            case 0x1:
                self._range_start = usage
            case 0x2:
                start, self._range_start = self._range_start, None
                if start is None:
                    raise item.error("a range of usages without a beginning")
                if start.is_extended != usage.is_extended or start.value > usage.value:
                    raise item.error(f"usages from {start.value:#x} to {usage.value:#x}")
                self._declare(start, usage)
            case 0x3 | 0x4 | 0x5 | 0x7 | 0x8 | 0x9:
                # Designators and strings describe a field to people; they change nothing about it.
                pass
            case 0xA:
                if item.unsigned != (0 if self._is_delimited else 1):
                    raise item.error("sets of alternative usages are nested or unbalanced")
                self._is_delimited, self._alternatives = not self._is_delimited, 0
            case _:
                raise item.error(f"the undefined local item {item.tag:#x}")

    def _declare(self, first: _Usage, last: _Usage) -> None:
        """Of a set of alternatives the first is the preferred one (HID 1.11, 6.2.2.8)."""
        self._alternatives += self._is_delimited
        if self._alternatives <= 1:
            self._ranges.append((first, last))


def _agreeing(lower: int, upper: _Limit) -> int:
    """An upper limit read with the sign that its lower limit has: 0 … 0xFF in one byte goes to 255, not to −1."""
    return upper.signed if lower < 0 else upper.unsigned
