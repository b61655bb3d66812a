import contextlib
import struct
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge.sources.hid.descriptor import ReportKind, parse_report_descriptor
from entoptic.tracker_bridge.sources.hid.report import (
    HidReportError,
    LongReportError,
    Reassembly,
    ReportLayout,
    ShortReportError,
    UnknownReportError,
    count_ns,
    joined,
    length_mm,
    plain,
    report_layouts,
)
from entoptic.tracker_bridge.usb_twin.report import DESCRIPTOR

TWIN = report_layouts(parse_report_descriptor(DESCRIPTOR))
TRACKING, STATUS = TWIN[ReportKind.INPUT, 0x10], TWIN[ReportKind.INPUT, 0x13]


def layout(fields: str) -> ReportLayout:
    data = bytes.fromhex("05 12 09 01 a1 01" + fields + "c0")
    (found,) = report_layouts(parse_report_descriptor(data)).values()
    return found


def packets(report: bytes, size: int = 64) -> list[bytes]:
    """As a controller sends them: an end on a full packet is shown by an empty one."""
    return [report[at : at + size] for at in range(0, len(report) + 1, size)]


def test_fields_need_not_begin_at_bytes() -> None:
    odd = layout("75 03 95 01 25 07 09 20 81 02 75 0b 16 00 fc 26 ff 03 09 21 81 02")
    assert odd.length == 2
    bits = odd.bits(bytes([0b10101_101, 0b00_111111]))
    first, second = odd.fields
    assert (first.value(bits), second.value(bits)) == (0b101, 0b11111110101 - 2048)


def test_a_number_outside_its_limits_says_nothing() -> None:
    (field,) = (one := layout("75 08 95 01 15 f6 25 0a 09 20 81 02")).fields
    assert [field.value(one.bits(struct.pack("b", value))) for value in (-11, -10, 10, 11)] == [None, -10, 10, None]


@pytest.mark.parametrize(
    ("unit", "mm"),
    [("65 11 55 0c", 0.001), ("65 11 55 0f", 1.0), ("65 11 55 00", 10.0), ("65 13 55 00", 25.4), ("65 12", None)],
)
def test_lengths(unit: str, mm: float | None) -> None:
    (field,) = layout(f"{unit} 75 08 95 01 25 7f 09 21 81 02").fields
    scale = length_mm(field)
    assert (scale and scale(1)) == (mm and pytest.approx(mm, rel=1e-12))


@pytest.mark.parametrize(("exponent", "ns"), [("0a", 1000), ("0d", 10**6), ("00", 10**9), ("08", 10)])
def test_times(exponent: str, ns: int) -> None:
    (field,) = layout(f"66 01 10 55 {exponent} 75 08 95 01 25 7f 09 20 81 02").fields
    assert count_ns(field) == ns


def test_physical_limits_stretch_the_logical_ones() -> None:
    (field,) = layout("15 00 25 64 35 ec 45 14 75 08 95 01 09 20 81 02").fields
    assert [plain(field)(value) for value in (0, 50, 100)] == pytest.approx([-20.0, 0.0, 20.0])


def test_eight_bytes_are_one_time() -> None:
    time_us = 0x0123_4567_89AB_CDEF
    own = layout("75 08 95 08 26 ff 00 09 20 81 02")
    assert joined(own.fields, own.bits(struct.pack("<Q", time_us))) == time_us


@pytest.mark.parametrize("size", [0, 1, 63, 64, 65, 110])
def test_a_report_that_is_too_short_is_refused(size: int) -> None:
    with pytest.raises(ShortReportError, match=f"of {size} B came where 111 B"):
        TRACKING.bits(bytes(size))


def test_a_report_that_is_too_long_or_of_another_id_is_refused() -> None:
    with pytest.raises(LongReportError, match="112 B or more came where 111 B"):
        TRACKING.bits(bytes(112))
    with pytest.raises(UnknownReportError, match="0x13 came where 0x10"):
        TRACKING.bits(b"\x13" + bytes(110))


def test_a_report_is_joined_from_packets_and_comes_with_the_last() -> None:
    report, status = b"\x10" + bytes(110), b"\x13\x01\x00\x00"
    reassembly = Reassembly(TWIN.values(), 64)
    assert [reassembly.add(packet) for packet in (*packets(report), status, *packets(report))] == [
        None,
        (TRACKING, report),
        (STATUS, status),
        None,
        (TRACKING, report),
    ]


@pytest.mark.parametrize("size", [1, 2, 64, 111, 128])
def test_packets_of_any_size_are_joined(size: int) -> None:
    report = b"\x10" + bytes(range(110))
    reassembly = Reassembly(TWIN.values(), size)
    whole = [found for packet in packets(report, size) * 3 if (found := reassembly.add(packet)) is not None]
    assert whole == [(TRACKING, report)] * 3


def test_a_report_that_fills_its_packets_is_joined_with_and_without_an_empty_packet_behind_it() -> None:
    full = layout("85 01 75 08 95 7f 26 ff 00 09 20 81 02")
    report = b"\x01" + bytes(range(127))
    reassembly = Reassembly([full], 64)
    sent = [report[:64], report[64:], b"", report[:64], report[64:], report[:64], report[64:]]
    assert [bool(reassembly.add(packet)) for packet in sent] == [False, True, False, False, True, False, True]


def test_reports_without_numbers_are_joined() -> None:
    plain_report = layout("75 08 95 46 26 ff 00 09 20 81 02")
    reassembly = Reassembly([plain_report], 64)
    report = bytes(range(70))
    assert [reassembly.add(packet) for packet in packets(report)] == [None, (plain_report, report)]


@pytest.mark.parametrize(
    ("bad", "error"),
    [
        (packets(b"\x10" + bytes(30)), ShortReportError),
        (packets(b"\x10" + bytes(63)), ShortReportError),
        (packets(b"\x10" + bytes(90)), ShortReportError),
        (packets(b"\x10" + bytes(111)), LongReportError),
        (packets(b"\x10" + bytes(300)), LongReportError),
        (packets(b"\x77" + bytes(10)), UnknownReportError),
        (packets(b"\x77" + bytes(200)), UnknownReportError),
    ],
)
def test_after_a_bad_report_the_next_is_whole(bad: list[bytes], error: type[HidReportError]) -> None:
    good = b"\x10" + bytes(110)
    reassembly = Reassembly(TWIN.values(), 64)
    with pytest.raises(error):
        [reassembly.add(packet) for packet in bad]
    rest = bad[[*_until_error(bad)].index(True) + 1 :]
    assert [reassembly.add(packet) for packet in (*rest, *packets(good))][-1] == (TRACKING, good)


def _until_error(sent: list[bytes]) -> list[bool]:
    """Which packet of a bad report is refused."""
    reassembly = Reassembly(TWIN.values(), 64)
    refused = []
    for packet in sent:
        try:
            reassembly.add(packet)
            refused.append(False)
        except HidReportError:
            refused.append(True)
    return refused


def test_a_lost_packet_costs_two_reports_at_most() -> None:
    report = b"\x10" + bytes(110)
    sent = packets(report) * 10
    for lost in range(len(sent)):
        reassembly, found = Reassembly(TWIN.values(), 64), 0
        for at, packet in enumerate(sent):
            with contextlib.suppress(HidReportError):
                found += at != lost and reassembly.add(packet) is not None
        assert found >= 8


@given(st.lists(st.one_of(st.binary(max_size=64), st.sampled_from(packets(b"\x10" + bytes(110)))), max_size=30))
def test_any_packets_give_whole_reports_or_named_errors(sent: list[bytes]) -> None:
    reassembly = Reassembly(TWIN.values(), 64)
    for packet in sent:
        try:
            found = reassembly.add(packet)
        except HidReportError:
            continue
        if found is not None:
            own, report = found
            assert len(report) == own.length
            assert report[0] == own.report_id
    whole = b"\x10" + bytes(110)
    after = []
    for packet in packets(whole) * 3:
        try:
            after.append(reassembly.add(packet))
        except HidReportError:
            after.append(None)
    assert after[-1] == (TRACKING, whole)


@given(st.binary(min_size=110, max_size=110))
def test_every_field_of_any_report_has_a_value_within_its_limits_or_none(body: bytes) -> None:
    bits = TRACKING.bits(b"\x10" + body)
    for field in TRACKING.fields:
        value = field.value(bits)
        assert value is None or field.item.logical_min <= value <= field.item.logical_max


def test_fields_lie_side_by_side() -> None:
    for own in TWIN.values():
        assert all(a.offset_bits + a.size_bits == b.offset_bits for a, b in pairwise(own.fields))


@given(st.integers(0, 7), st.integers(0, 255))
def test_a_report_is_made_as_it_is_read(mode: int, other: int) -> None:
    own = TWIN[ReportKind.FEATURE, 0x14]
    (field,) = own.fields
    report = own.report({field: mode})
    assert report == bytes([0x14, mode])
    assert field.value(own.bits(report)) == mode
