"""The items that a HID report descriptor is made of (HID 1.11, 6.2.2). Pure."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from typing import NamedTuple

LONG_ITEM = 0xFE
"""Prefix of a long item (HID 1.11, 6.2.2.3); none has a meaning yet, so they are passed over."""


class HidDescriptorError(ValueError):
    """A report descriptor breaks the rules: the message names the rule and the byte."""


class ItemKind(enum.IntEnum):
    """What an item is for."""

    MAIN = 0
    GLOBAL = 1
    LOCAL = 2


class Item(NamedTuple):
    """A short item (HID 1.11, 6.2.2.2)."""

    at: int
    """Its first byte in the descriptor."""
    kind: int
    tag: int
    data: bytes

    @property
    def unsigned(self) -> int:
        """Its data as a number from 0."""
        return int.from_bytes(self.data, "little")

    @property
    def signed(self) -> int:
        """Its data as a number with a sign."""
        return int.from_bytes(self.data, "little", signed=True)

    def error(self, what: str) -> HidDescriptorError:
        """An error that names this item's place."""
        return HidDescriptorError(f"{what} (byte {self.at} of the report descriptor)")


def items_of(data: bytes) -> Iterator[Item]:
    """The short items in order. Raises HidDescriptorError where one is cut off."""
    at = 0
    while at < len(data):
        prefix = data[at]
        size = (0, 1, 2, 4)[prefix & 3]
        if prefix == LONG_ITEM:
            # One byte of length, one of tag; where the length is missing too, the check below says so.
            size = 2 + (data[at + 1] if at + 1 < len(data) else 0)
        end = at + 1 + size
        if end > len(data):
            raise HidDescriptorError(f"an item is cut off (byte {at} of {len(data)} of the report descriptor)")
        if prefix != LONG_ITEM:
            yield Item(at, prefix >> 2 & 3, prefix >> 4, data[at + 1 : end])
        at = end


def unit_exponent(item: Item) -> int:
    """Four bits of two's complement (HID 1.11, 6.2.2.7); devices that write a whole signed byte are understood too."""
    value = item.unsigned
    if value <= 0xF:
        return value - 16 if value > 7 else value
    if -8 <= item.signed < 0:
        return item.signed
    raise item.error(f"the unit exponent {item.signed}: it goes from −8 to 7")
