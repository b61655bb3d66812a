"""What a running bridge may be asked."""

import threading
from collections.abc import Iterator

import msgspec
import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

from services.control import Control, ControlError, Request, Task, tell
from tracker_bridge.access import OpenAddressError
from tracker_bridge.publisher import PortInUseError
from tracker_bridge.source import SourceError


class Tracker:
    """Takes orders down; refuses one name."""

    def __init__(self) -> None:
        self.orders: list[str] = []

    def start_recording(self, name: str = "") -> None:
        if name == "bad/name":
            raise SourceError("no such name")
        self.orders.append(f"record {name}")

    def stop_recording(self) -> None:
        self.orders.append("stop recording")

    def start_calibration(self) -> None:
        self.orders.append("calibrate")

    def stop_calibration(self) -> None:
        self.orders.append("stop calibrating")


class Attended:
    """A control whose bridge attends it."""

    def __init__(self, source: object) -> None:
        self.context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self.control = Control("tcp://127.0.0.1:*", source, None, self.context)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._attend)
        self._thread.start()

    def _attend(self) -> None:
        while not self._over.wait(0.005):
            self.control.attend()

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        self.control.close()
        self.context.term()


@pytest.fixture
def tracker() -> Tracker:
    return Tracker()


@pytest.fixture
def address(tracker: Tracker) -> Iterator[str]:
    attended = Attended(tracker)
    yield attended.control.address
    attended.close()


def test_each_task_reaches_the_tracker(tracker: Tracker, address: str) -> None:
    for task in Task:
        assert task in tell(address, Request(task, "mine"))
    assert tracker.orders == ["record mine", "stop recording", "calibrate", "stop calibrating"]


def test_what_the_tracker_refuses_is_said(tracker: Tracker, address: str) -> None:
    with pytest.raises(ControlError, match="no such name"):
        tell(address, Request(Task.START_RECORDING, "bad/name"))
    assert tracker.orders == []


def test_a_source_that_cannot_is_said() -> None:
    attended = Attended(object())
    with pytest.raises(ControlError, match="run the bridge on `capture`"):
        tell(attended.control.address, Request(Task.STOP_RECORDING))
    attended.close()


def test_nobody_there() -> None:
    with pytest.raises(ControlError, match="nobody answers"):
        tell("tcp://127.0.0.1:9", Request(Task.STOP_RECORDING))


def test_only_this_machine_without_keys() -> None:
    with zmq.Context() as context, pytest.raises(OpenAddressError):
        Control("tcp://0.0.0.0:*", object(), None, context)


def test_an_address_in_use(address: str) -> None:
    with zmq.Context() as context, pytest.raises(PortInUseError, match="choose another port"):
        Control(address, object(), None, context)


class Insistent:
    """A socket where the next request has always come already."""

    def __init__(self) -> None:
        self.answered = 0

    def poll(self, _: int) -> int:
        return 1

    def recv_multipart(self) -> list[bytes]:
        return [b""]

    def send(self, _: bytes) -> None:
        self.answered += 1
        assert self.answered < 10


def test_whoever_asks_without_end_does_not_hold_the_bridge_up() -> None:
    control = Control.__new__(Control)
    socket = Insistent()
    control._socket = socket  # type: ignore[assignment]
    control.attend()
    assert socket.answered == 1


@given(
    st.binary(max_size=200)
    | st.builds(msgspec.msgpack.encode, st.dictionaries(st.text(), st.integers(-(2**63), 2**63) | st.text()))
)
def test_any_bytes_get_an_answer(message: bytes) -> None:
    control = Control.__new__(Control)
    control._source = Tracker()
    assert isinstance(control._answer(message).reply, str)
