import math
from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge.capture_twin.faults import FORMS, Fault, FaultError, Faults, PlannedFault, read_fault

INF = math.inf


@pytest.mark.parametrize(
    ("spec", "expected"),
    [
        ("restart@5s", PlannedFault(Fault.RESTART, 0.0, 5.0, 7.0)),
        ("silence@5s", PlannedFault(Fault.SILENCE, 0.0, 5.0, INF)),
        ("silence@5s:2s", PlannedFault(Fault.SILENCE, 0.0, 5.0, 7.0)),
        ("silence@0.5:2.5", PlannedFault(Fault.SILENCE, 0.0, 0.5, 3.0)),
        ("late", PlannedFault(Fault.LATE, 3.0, 0.0, INF)),
        ("late=1.5s@2s", PlannedFault(Fault.LATE, 1.5, 2.0, INF)),
        ("duplicate", PlannedFault(Fault.DUPLICATE, 0.0, 0.0, INF)),
        ("corrupt@1s", PlannedFault(Fault.CORRUPT, 0.0, 1.0, INF)),
        ("backwards", PlannedFault(Fault.BACKWARDS, 0.0, 0.0, INF)),
        ("drift=200ppm", PlannedFault(Fault.DRIFT, 200.0, 0.0, INF)),
        ("drift=-40", PlannedFault(Fault.DRIFT, -40.0, 0.0, INF)),
        ("timebase=+100s@5s", PlannedFault(Fault.TIMEBASE, 100.0, 5.0, INF)),
        (" stuck@5s ", PlannedFault(Fault.STUCK, 0.0, 5.0, 7.0)),
    ],
)
def test_faults_are_read(spec: str, expected: PlannedFault) -> None:
    assert read_fault(spec) == expected


@pytest.mark.parametrize(
    ("spec", "what"),
    [
        ("", "is no fault: choose from restart@5s, silence@5s:2s, "),
        ("explode", "'explode' is no fault: choose from"),
        ("silence@", "is no fault"),
        ("silence@5s:", "is no fault"),
        ("late=x", "is no fault"),
        ("duplicate=3", "duplicate takes no value"),
        ("drift", "drift needs a value: write drift=200ppm"),
        ("drift=3s", "drift is given in ppm, not in s"),
        ("late=-1s", "cannot come before"),
    ],
)
def test_a_bad_fault_is_named_with_those_there_are(spec: str, what: str) -> None:
    with pytest.raises(FaultError, match=what) as caught:
        read_fault(spec)
    assert "\n" not in str(caught.value)


def test_each_example_is_a_fault() -> None:
    assert {read_fault(form.example).fault for form in FORMS.values()} == set(Fault)


@given(st.text(max_size=30) | st.from_regex(r"[a-z]{4,9}(=.{0,6})?(@.{0,6})?", fullmatch=True))
def test_any_text_is_a_fault_or_a_fault_error(spec: str) -> None:
    try:
        plan = read_fault(spec)
    except FaultError:
        return
    assert plan.start_s <= plan.end_s


def message(number: int) -> list[bytes]:
    return [b"pupil.0.2d", msgpack.packb({"timestamp": float(number), "confidence": 1.0})]


def passed(*specs: str, at_s: float = 1.0, count: int = 100) -> list[tuple[float, list[bytes]]]:
    faults = Faults(read_fault(spec) for spec in specs)
    return [each for number in range(count) for each in faults.apply(at_s, message(number))]


def numbers(*specs: str, at_s: float = 1.0) -> list[int]:
    return [int(msgpack.unpackb(frames[1])["timestamp"]) for _, frames in passed(*specs, at_s=at_s)]


def test_without_faults_everything_passes_at_once() -> None:
    assert passed() == [(0.0, message(number)) for number in range(100)]


def test_silence_ends_in_time() -> None:
    assert passed("silence@5s:2s", at_s=4.9) == passed("silence@5s:2s", at_s=7.0) == passed()
    assert passed("silence@5s:2s", at_s=5.0) == passed("silence", at_s=1e9) == []


def test_late_messages_keep_their_times() -> None:
    assert passed("late=2s") == [(2.0, frames) for _, frames in passed()]


def test_duplicates_come_at_once() -> None:
    assert numbers("duplicate") == [number for number in range(100) for _ in range(2)]


def test_every_tenth_time_goes_backwards() -> None:
    order = numbers("backwards")
    # The last one held waits for a successor.
    assert sorted(order) == list(range(99))
    assert order[:13] == [0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 9, 11, 12]


def test_each_damage_is_one_that_a_reader_must_survive() -> None:
    damaged = [frames for _, frames in passed("corrupt")][9::10]
    kinds = [_kind(frames) for frames in damaged]
    assert kinds == ["undecodable", "undecodable", "keys", "nan", "frames"] * 2
    assert [frames for number, (_, frames) in enumerate(passed("corrupt")) if number % 10 != 9] == [
        message(number) for number in range(100) if number % 10 != 9
    ]


def _kind(frames: list[bytes]) -> str:
    if len(frames) < 2:
        return "frames"
    try:
        datum: dict[str, Any] = msgpack.unpackb(frames[1])
    except ValueError:
        return "undecodable"
    if "timestamp" not in datum:
        return "keys"
    return "nan" if math.isnan(datum["timestamp"]) else "none"


def test_a_fault_begins_once() -> None:
    faults = Faults([read_fault("timebase=+100s@5s"), read_fault("drift=1ppm")])
    assert [plan.fault for plan in faults.begun(0.0)] == [Fault.DRIFT]
    assert [plan.fault for plan in faults.begun(6.0)] == [Fault.TIMEBASE]
    assert faults.begun(7.0) == []
