"""Spoilt input raises named errors alone."""

import contextlib

import pytest
from decoders import Decoder, decoders
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

ALL = decoders()

edits = st.lists(st.tuples(st.sampled_from("xid"), st.integers(0, 1 << 16), st.binary(max_size=8)), max_size=6)


def spoilt(good: bytes, changes: list[tuple[str, int, bytes]]) -> bytes:
    """Overwrites, inserts or deletes."""
    data = bytearray(good)
    for how, place, new in changes:
        at = place % (len(data) + 1)
        end = {"x": at + len(new), "i": at, "d": at + 1 + place % 7}[how]
        data[at:end] = b"" if how == "d" else new
    return bytes(data)


@pytest.mark.parametrize("decoder", ALL.values(), ids=ALL.keys())
@settings(suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_only_named_errors(decoder: Decoder, data: st.DataObject) -> None:
    good = data.draw(st.sampled_from(decoder.good) | st.binary(max_size=300))
    with contextlib.suppress(*decoder.may_raise):
        decoder.read(spoilt(good, data.draw(edits)))


@pytest.mark.parametrize(
    "decoder",
    [
        ALL[name]
        for name in ("pupil datum", "gaze datum", "state", "event", "recording", "report descriptor", "USB packets")
    ],
)
def test_good_input_is_read(decoder: Decoder) -> None:
    for good in decoder.good:
        decoder.read(good)
