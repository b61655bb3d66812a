import contextlib
import re
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge.sources.hid.descriptor import (
    CONSTANT,
    MAX_REPORT_BYTES,
    ReportKind,
    parse_report_descriptor,
)
from entoptic.tracker_bridge.sources.hid.items import HidDescriptorError
from entoptic.tracker_bridge.sources.hid.report import report_layouts
from entoptic.tracker_bridge.usb_twin.report import DESCRIPTOR

Shared = Callable[[str], Path]
REAL = ["gazehid_eyetracker", "dmf_virtualeyegaze"]
DECODED = {"gazehid_eyetracker": "gazehid_decoded.txt", "dmf_virtualeyegaze": "dmf_decoded.txt"}


def items(text: str) -> bytes:
    return bytes.fromhex(text)


HEAD = "05 12 09 01 a1 01 "
"""Page 0x12, eye tracker, application collection."""
FIELD = "15 00 25 7f 75 08 95 01 09 20 81 02 "
"""One byte of 0 … 127, usage 0x20, input."""


@pytest.mark.shared_data
@pytest.mark.parametrize("name", REAL)
def test_real_descriptors_are_read_as_hid_tools_reads_them(shared: Shared, name: str) -> None:
    data = shared(f"hid/{name}_report_descriptor.bin").read_bytes()
    lines = shared(f"hid/{DECODED[name]}").read_text(encoding="utf-8").splitlines()
    # hid-tools writes an item a line: "# 0x81, 0x02,   //   Input (Data,Var,Abs)   28".
    named = [match.groups() for line in lines if (match := re.search(r"//\s+([A-Z][A-Za-z ]+?) \(([^)]*)\)", line))]
    expected, state = [], {"Report ID": 0, "Report Size": 0, "Report Count": 0}
    for key, value in named:
        if key in state:
            state[key] = int(value)
        elif key in ("Input", "Feature"):
            expected.append((key.upper(), *state.values(), value.startswith("Cnst")))
    found = [
        (item.kind.name, item.report_id, item.size_bits, item.count, bool(item.flags & CONSTANT))
        for item in parse_report_descriptor(data).items
    ]
    assert found == expected


@pytest.mark.shared_data
@pytest.mark.parametrize("name", REAL)
def test_reports_of_real_descriptors_have_their_documented_lengths(shared: Shared, name: str) -> None:
    layouts = report_layouts(parse_report_descriptor(shared(f"hid/{name}_report_descriptor.bin").read_bytes()))
    assert {(kind.name, number): layout.length for (kind, number), layout in layouts.items()} == {
        ("INPUT", 0x10): 65,
        ("INPUT", 0x13): 4,
        ("FEATURE", 0x11): 22,
        ("FEATURE", 0x12): 19,
        ("FEATURE", 0x13): 4,
        ("FEATURE", 0x14): 2,
    }


@pytest.mark.shared_data
def test_the_simulated_trackers_descriptor_goes_on_where_dmfs_ends(shared: Shared) -> None:
    real = report_layouts(parse_report_descriptor(shared("hid/dmf_virtualeyegaze_report_descriptor.bin").read_bytes()))
    twin = report_layouts(parse_report_descriptor(DESCRIPTOR))
    assert real.keys() == twin.keys()
    for key, layout in real.items():
        own = twin[key].fields[: len(layout.fields)]
        assert [(f.usage, f.offset_bits, f.size_bits) for f in own] == [
            (f.usage, f.offset_bits, f.size_bits) for f in layout.fields
        ]
        assert twin[key].length == (111 if key == (ReportKind.INPUT, 0x10) else layout.length)


def test_constant_fields_with_a_usage_are_kept_and_padding_is_not() -> None:
    descriptor = parse_report_descriptor(
        items(HEAD + "75 08 95 02 25 7f 09 21 09 22 81 03 95 03 81 03 95 01 09 23 81 02 c0")
    )
    (layout,) = report_layouts(descriptor).values()
    assert [(field.usage & 0xFFFF, field.offset_bits) for field in layout.fields] == [(0x21, 0), (0x22, 8), (0x23, 40)]


def test_usages_come_singly_in_ranges_and_with_their_own_page() -> None:
    text = HEAD + "75 08 95 05 25 01 09 20 19 30 29 31 0b 22 00 12 ff 81 02 c0"
    (item,) = parse_report_descriptor(items(text)).items
    assert list(item.field_usages()) == [0x120020, 0x120030, 0x120031, 0xFF120022, 0xFF120022]


def test_the_page_of_a_usage_is_the_one_at_the_main_item() -> None:
    (item,) = parse_report_descriptor(items(HEAD + "75 08 95 01 25 01 09 20 05 01 81 02 c0")).items
    assert list(item.field_usages()) == [0x10020]


def test_of_alternative_usages_the_first_counts() -> None:
    (item,) = parse_report_descriptor(items(HEAD + "75 08 95 01 25 01 a9 01 09 20 09 21 a9 00 81 02 c0")).items
    assert list(item.field_usages()) == [0x120020]


def test_global_state_is_pushed_and_popped() -> None:
    descriptor = parse_report_descriptor(
        items(HEAD + "75 08 95 01 25 7f a4 75 10 65 11 55 0c 09 21 81 02 b4 09 22 81 02 c0")
    )
    assert [(item.size_bits, item.unit, item.unit_exponent) for item in descriptor.items] == [(16, 0x11, -4), (8, 0, 0)]


def test_long_items_are_passed_over() -> None:
    with_long = items(HEAD + "fe 03 f0 a1 a1 a1 " + FIELD + "c0")
    assert parse_report_descriptor(with_long) == parse_report_descriptor(items(HEAD + FIELD + "c0"))


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ("15 00 25 ff", (0, 255)),
        ("15 80 25 7f", (-128, 127)),
        ("15 00 27 ff ff ff ff", (0, 2**32 - 1)),
        ("17 80 7b e1 ff 27 80 84 1e 00", (-2_000_000, 2_000_000)),
    ],
)
def test_limits_have_the_sign_of_the_lower_one(limits: str, expected: tuple[int, int]) -> None:
    (item,) = parse_report_descriptor(items(HEAD + limits + "75 20 95 01 09 20 81 02 c0")).items
    assert (item.logical_min, item.logical_max) == expected


@pytest.mark.parametrize(("code", "power"), [("00", 0), ("07", 7), ("08", -8), ("0a", -6), ("0f", -1), ("fa", -6)])
def test_unit_exponents(code: str, power: int) -> None:
    (item,) = parse_report_descriptor(items(HEAD + f"55 {code}" + FIELD + "c0")).items
    assert item.unit_exponent == power


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD, "never closed"),
        ("c0", "never began"),
        (HEAD + "25", "cut off"),
        (HEAD + "27 00 00", "cut off"),
        (HEAD + "fe", "cut off"),
        (HEAD + "fe 09 00 00", "cut off"),
        (HEAD + "0c", "reserved type 3"),
        (HEAD + "d1 00", "undefined main item"),
        (HEAD + "c5 00", "undefined global item"),
        (HEAD + "b9 00", "undefined local item"),
        (HEAD + "b4", "never pushed"),
        (HEAD + "a4 " * 33, "32 states"),
        ("a1 00 " * 33, "deeper than 32"),
        (HEAD + "85 00", "report ID 0"),
        (HEAD + "86 00 01", "report ID 256"),
        (HEAD + "07 00 00 12 00", "usage page"),
        (HEAD + "55 10", "unit exponent 16"),
        (HEAD + "81 02", "without a report size"),
        (HEAD + "75 00 95 01 81 02", "no bits"),
        (HEAD + "75 08 95 01 15 05 25 04 09 20 81 02", "from 5 to 4"),
        (HEAD + "75 01 97 ff ff ff ff 81 03", "are believed"),
        (HEAD + "77 ff ff ff ff 97 ff ff ff ff 81 03", "are believed"),
        (HEAD + "75 08 96 00 08 81 03 81 03 81 03", "are believed"),
        (HEAD + "19 05 81 02", "no end"),
        (HEAD + "29 05", "without a beginning"),
        (HEAD + "19 06 29 05", "0x6 to 0x5"),
        (HEAD + "1b 01 00 12 00 29 05", "usages from"),
        (HEAD + "a9 00", "unbalanced"),
        (HEAD + "a9 01 a9 01", "unbalanced"),
        (HEAD + "a9 01 81 02", "never closed"),
        (HEAD + FIELD + "85 01 " + FIELD + "c0", "some have none"),
        ("09 01 a1 01", "without a usage page"),
    ],
)
def test_what_breaks_the_rules_is_refused_by_name(text: str, words: str) -> None:
    with pytest.raises(HidDescriptorError, match=re.escape(words)):
        parse_report_descriptor(items(text))


def test_no_descriptor_is_longer_than_its_length_can_say() -> None:
    with pytest.raises(HidDescriptorError, match="65,536 bytes"):
        parse_report_descriptor(bytes(0x10000))


def test_a_descriptor_as_long_as_can_be_is_read_in_bounded_time() -> None:
    # As many fields as a descriptor can hold: each of the 255 reports of each kind has one bit fields up to the limit.
    body = "".join(
        f"85 {number:02x} 96 00 80 09 20 {main} 02 " for number in range(1, 256) for main in ("81", "91", "b1")
    )
    data = items(HEAD + "75 01 25 01 " + body + "c0")
    started = time.process_time()
    descriptor = parse_report_descriptor(data)
    assert time.process_time() - started < 1.0
    assert sum(item.count * item.size_bits for item in descriptor.items) == 255 * 3 * 8 * MAX_REPORT_BYTES
    with pytest.raises(HidDescriptorError, match="25,067,520 numbers"):
        report_layouts(descriptor)


def parses_or_refuses(data: bytes) -> None:
    try:
        descriptor = parse_report_descriptor(data)
    except HidDescriptorError:
        return
    assert all(item.count >= 1 and item.size_bits >= 1 for item in descriptor.items)
    with contextlib.suppress(HidDescriptorError):
        assert all(layout.length <= MAX_REPORT_BYTES + 1 for layout in report_layouts(descriptor).values())


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(data: bytes) -> None:
    parses_or_refuses(data)


mutations = st.lists(
    st.tuples(st.integers(0, len(DESCRIPTOR) - 1), st.integers(0, 255), st.sampled_from(["set", "cut", "insert"])),
    min_size=1,
    max_size=6,
)


def mutated(data: bytes, changes: list[tuple[int, int, str]]) -> bytes:
    changed = bytearray(data)
    for at, value, how in changes:
        at = min(at, len(changed))
        if how == "set" and at < len(changed):
            changed[at] = value
        elif how == "insert":
            changed.insert(at, value)
        elif how == "cut":
            del changed[at : at + value % 8]
    return bytes(changed)


@given(mutations)
def test_a_damaged_descriptor_is_read_or_refused(changes: list[tuple[int, int, str]]) -> None:
    parses_or_refuses(mutated(DESCRIPTOR, changes))


@pytest.mark.shared_data
@pytest.mark.parametrize("name", REAL)
def test_a_damaged_real_descriptor_is_read_or_refused(shared: Shared, name: str) -> None:
    data = shared(f"hid/{name}_report_descriptor.bin").read_bytes()

    @given(mutations)
    def check(changes: list[tuple[int, int, str]]) -> None:
        parses_or_refuses(mutated(data, changes))

    check()
