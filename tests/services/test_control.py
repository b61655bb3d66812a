"""What a running process, and a bridge's tracker, may be asked."""

import functools
import threading
from collections.abc import Iterator

import msgspec
import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

from entoptic.services.bridge.tracker_tasks import do_task
from entoptic.services.ipc.client import Client, ControlError, Reply, tell
from entoptic.services.ipc.handler import RequestHandler
from entoptic.services.ipc.requests import (
    StartCalibration,
    StartTrackerRecording,
    StopCalibration,
    StopTrackerRecording,
    TrackerRequest,
)
from entoptic.tracker_bridge.access import OpenAddressError
from entoptic.tracker_bridge.publisher import PortInUseError
from entoptic.tracker_bridge.source import SourceError


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


def control_of(source: object, address: str, context: zmq.Context[zmq.Socket[bytes]]) -> RequestHandler[TrackerRequest]:
    return RequestHandler(address, TrackerRequest, functools.partial(do_task, source), None, context)


class Attended:
    """A control whose bridge attends it."""

    def __init__(self, source: object) -> None:
        self.context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self.control = control_of(source, "tcp://127.0.0.1:*", self.context)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._attend)
        self._thread.start()

    def _attend(self) -> None:
        while not self._over.wait(0.005):
            self.control.serve()

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
    for request in (StartTrackerRecording("mine"), StopTrackerRecording(), StartCalibration(), StopCalibration()):
        assert str(request.__struct_config__.tag) in tell(address, request).reply
    assert tracker.orders == ["record mine", "stop recording", "calibrate", "stop calibrating"]


def test_the_form_on_the_wire_is_the_documented_one(tracker: Tracker, address: str) -> None:
    with zmq.Context() as context, context.socket(zmq.REQ) as socket:
        socket.connect(address)
        socket.send(msgspec.msgpack.encode({"do": "start tracker recording", "name": "mine"}))
        reply = msgspec.msgpack.decode(socket.recv())
    assert (reply["done"], tracker.orders) == (True, ["record mine"])


def test_what_the_tracker_refuses_is_said(tracker: Tracker, address: str) -> None:
    with pytest.raises(ControlError, match="no such name"):
        tell(address, StartTrackerRecording("bad/name"))
    assert tracker.orders == []


def test_a_source_that_cannot_is_said() -> None:
    attended = Attended(object())
    with pytest.raises(ControlError, match="run the bridge on `capture`"):
        tell(attended.control.address, StopTrackerRecording())
    attended.close()


def test_nobody_there() -> None:
    with pytest.raises(ControlError, match="nobody answers"):
        tell("tcp://127.0.0.1:9", StopTrackerRecording())


def test_only_this_machine_without_keys() -> None:
    with zmq.Context() as context, pytest.raises(OpenAddressError):
        control_of(object(), "tcp://0.0.0.0:*", context)


def test_an_address_in_use(address: str) -> None:
    with zmq.Context() as context, pytest.raises(PortInUseError, match="choose another port"):
        control_of(object(), address, context)


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
    with zmq.Context() as context:
        control = control_of(Tracker(), "tcp://127.0.0.1:*", context)
        control.close()
        socket = Insistent()
        control._socket = socket  # type: ignore[assignment]
        control.serve()
        assert socket.answered == 1


@pytest.fixture(scope="module")
def unattended() -> Iterator[RequestHandler[TrackerRequest]]:
    with zmq.Context() as context:
        control = control_of(Tracker(), "tcp://127.0.0.1:*", context)
        yield control
        control.close()


@given(
    message=st.binary(max_size=200)
    | st.builds(msgspec.msgpack.encode, st.dictionaries(st.text(), st.integers(-(2**63), 2**63) | st.text()))
)
def test_any_bytes_get_an_answer(unattended: RequestHandler[TrackerRequest], message: bytes) -> None:
    assert isinstance(unattended._answer(message), Reply)


def test_a_client_goes_on_after_a_request_that_nobody_answered() -> None:
    with zmq.Context() as context:
        handler = control_of(Tracker(), "tcp://127.0.0.1:*", context)
        with Client(handler.address) as client:
            with pytest.raises(ControlError, match="nobody answers"):
                client.ask(StopCalibration(), patience_ms=50)
            client.send(StartTrackerRecording("mine"))
            reply = None
            while reply is None:  # the late reply to the first one is dropped
                handler.serve(20)
                reply = client.poll(20)
            assert "start tracker recording" in reply.reply
            assert client.request is None
            assert client.poll() is None
        handler.close()


def test_an_address_that_is_none() -> None:
    with pytest.raises(ControlError, match="cannot connect to nowhere"):
        Client("nowhere")
