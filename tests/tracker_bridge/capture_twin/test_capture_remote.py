from typing import Any

import msgpack
import pytest

from entoptic.tracker_bridge.capture_twin.backbone import notification
from entoptic.tracker_bridge.capture_twin.remote import RemoteKilledError, answer


class FakeCapture:
    ports = (40001, 40002)

    def __init__(self) -> None:
        self.time_s = 1234.5678901234567
        self.told: list[Any] = []

    def pupil_s(self) -> float:
        return self.time_s

    def set_pupil_s(self, pupil_s: float) -> None:
        self.time_s = pupil_s

    def notify(self, subject: str, **fields: Any) -> None:
        self.told.append((subject, fields))

    def forward(self, frames: list[bytes]) -> None:
        self.told.append(frames)


@pytest.mark.parametrize(
    ("request_text", "expected", "told"),
    [
        ("SUB_PORT", "40001", []),
        ("PUB_PORT", "40002", []),
        ("SUB", "Unknown command.", []),
        ("t", "1234.5678901234567", []),
        ("time", "1234.5678901234567", []),
        ("T soon", "'soon' cannot be converted to float.", []),
        ("v", "3.6.14", []),
        ("R", "OK", [("recording.should_start", {"session_name": ""})]),
        ("R my name", "OK", [("recording.should_start", {"session_name": "my name"})]),
        ("R:x", "OK", [("recording.should_start", {"session_name": "x"})]),
        ("r", "OK", [("recording.should_stop", {})]),
        ("C", "OK", [("calibration.should_start", {})]),
        ("c", "OK", [("calibration.should_stop", {})]),
        ("hello", "Unknown command.", []),
        (" ", "Unknown command.", []),
    ],
)
def test_answers(request_text: str, expected: str, told: list[Any]) -> None:
    capture = FakeCapture()
    assert answer([request_text.encode()], capture) == expected
    assert capture.told == told


def test_the_time_is_set_and_read_back() -> None:
    capture = FakeCapture()
    assert answer([b"T 17.25"], capture) == "Timesync successful."
    assert answer([b"t"], capture) == "17.25"


def test_messages_of_several_frames_are_forwarded_whatever_they_are() -> None:
    capture = FakeCapture()
    frames = [b"notify.x", msgpack.packb({"subject": "x"}), b"raw"]
    assert answer(frames, capture) == "Message forwarded."
    assert answer([b"", b""], capture) == "Message forwarded."
    assert capture.told == [frames, [b"", b""]]


@pytest.mark.parametrize("request_bytes", [b"", b"\xff\xfe"])
def test_some_requests_kill_it(request_bytes: bytes) -> None:
    with pytest.raises(RemoteKilledError):
        answer([request_bytes], FakeCapture())


@pytest.mark.parametrize("contents", [b"", b"\xc1", b"\x90", b"\x80", b"\x81\x90\x00", b"\x81\xa7subject\x01"])
def test_what_is_no_notification_is_told_apart(contents: bytes) -> None:
    assert notification([b"notify.x", contents]) is None
    assert notification([b"notify.x"]) is None
    assert notification([b"notify.x", msgpack.packb({"subject": "x"})]) == {"subject": "x"}
