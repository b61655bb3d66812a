from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.pupil_core import remote as pupil_remote
from entoptic.tracker_bridge.sources.pupil_core.remote import (
    ForbiddenRequestError,
    Remote,
    RemoteAddress,
    RemoteReplyError,
    RemoteSilentError,
    Request,
    start_recording,
)


@pytest.mark.parametrize("text", ["", "T 1.0", "T", "PUB_PORT", "notify.x", "tt", "R\x00", "R a\nb", "t\n", " ", "rr"])
def test_a_harmful_request_cannot_be_made(text: str) -> None:
    with pytest.raises(ForbiddenRequestError, match="must not be sent"):
        Request(text)


@given(st.text(max_size=10))
def test_every_request_that_can_be_made_is_one_of_a_few(text: str) -> None:
    try:
        payload = Request(text).payload
    except (ForbiddenRequestError, UnicodeEncodeError):
        return
    assert payload in (b"SUB_PORT", b"v", b"t", b"R", b"r", b"C", b"c") or payload.startswith(b"R ")


@given(st.text(max_size=220))
def test_a_recordings_name_is_refused_or_sent_as_it_is(name: str) -> None:
    try:
        request = start_recording(name)
    except SourceError:
        return
    assert request.payload == (f"R {name}" if name else "R").encode()


@pytest.mark.parametrize("name", ["/etc", "a/../b", "..", " a", "a ", "a\nb", "~root/x", "a//b", "a\\b", "x" * 201])
def test_a_recording_stays_in_its_folder(name: str) -> None:
    with pytest.raises(SourceError, match="cannot name a recording"):
        start_recording(name)


def test_a_recording_may_lie_in_a_folder_of_its_own() -> None:
    assert start_recording("study/person_07").payload == b"R study/person_07"


@pytest.mark.parametrize(
    "text",
    ["", "127.0.0.1:50020", "tcp://127.0.0.1", "tcp://:50020", "tcp://a:0", "tcp://a:70000", "ipc:///a", "tcp://a b:1"],
)
def test_a_wrong_address_is_named(text: str) -> None:
    with pytest.raises(SourceError, match="Network API menu"):
        RemoteAddress.parse(text)


def test_an_address() -> None:
    address = RemoteAddress.parse("tcp://lab-pc:50020")
    assert (str(address), address.data(1234)) == ("tcp://lab-pc:50020", "tcp://lab-pc:1234")


@pytest.mark.parametrize("answer", ["Unknown command.", "", "0", "65536", "-1", "1e3", "٣٣"])
def test_a_port_that_is_none(answer: str) -> None:
    with pytest.raises(RemoteReplyError, match="not Pupil Remote"):
        pupil_remote.port_of(answer)


@pytest.mark.parametrize("answer", ["", "now", "nan", "inf", "-1e10", "Unknown command."])
def test_a_time_that_is_none(answer: str) -> None:
    with pytest.raises(RemoteReplyError, match="no time"):
        pupil_remote.pupil_ns_of(answer)


def test_answers() -> None:
    assert pupil_remote.port_of("54321") == 54321
    assert pupil_remote.pupil_ns_of("1536.488052581") == 1536488052581
    assert pupil_remote.pupil_ns_of("-2.5") == -2500000000
    assert pupil_remote.version_of("3.6.14") == "3.6.14"
    assert pupil_remote.version_of("v1.23-4-g12ab") == "v1.23-4-g12ab"
    assert pupil_remote.version_of("Unknown command.") == "of unknown version"
    pupil_remote.check_accepted("OK")
    with pytest.raises(RemoteReplyError, match="mal-formatted"):
        pupil_remote.check_accepted("Recording command mal-formatted.")


@contextmanager
def remote_at(port: int, timeout_s: float = 5.0) -> Iterator[Remote]:
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    remote = Remote(context, RemoteAddress("127.0.0.1", port), stopped=lambda: False, timeout_s=timeout_s)
    try:
        yield remote
    finally:
        remote.close()
        context.destroy(linger=0)


@contextmanager
def answering(socket_type: int = zmq.REP) -> Iterator[tuple[zmq.Socket[bytes], int]]:
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    socket = context.socket(socket_type)
    try:
        yield socket, socket.bind_to_random_port("tcp://127.0.0.1")
    finally:
        context.destroy(linger=0)


def test_question_and_answer() -> None:
    with answering() as (socket, port), remote_at(port) as remote:
        seen: list[bytes] = []

        def answer() -> None:
            seen.append(socket.recv())
            socket.send(b"12.5")

        thread = threading.Thread(target=answer)
        thread.start()
        before_ns = time.monotonic_ns()
        got = remote.ask(pupil_remote.TIME)
        thread.join()
        assert (seen, got.text) == ([b"t"], "12.5")
        assert before_ns <= got.sent_ns <= got.received_ns <= time.monotonic_ns()


def test_a_question_without_an_answer_does_not_stop_the_next() -> None:
    # A REQ socket that waits for an answer refuses to send: only a new one gets the second question out.
    with answering(zmq.ROUTER) as (socket, port), remote_at(port, timeout_s=0.2) as remote:
        for _ in range(3):
            with pytest.raises(RemoteSilentError, match="nobody answers"):
                remote.ask(pupil_remote.TIME)
        questions = [socket.recv_multipart() for _ in range(3)]
        assert len({sender for sender, *_ in questions}) == 3
        assert all(frames[1:] == [b"", b"t"] for frames in questions)


def test_nobody_there() -> None:
    with answering() as (socket, port):
        socket.close()
        with remote_at(port, timeout_s=0.1) as remote, pytest.raises(RemoteSilentError, match="start Pupil Capture"):
            remote.ask(pupil_remote.SUB_PORT)


def test_an_unsent_question_is_never_sent_late() -> None:
    with answering() as (socket, port):
        address = socket.getsockopt_string(zmq.LAST_ENDPOINT)
        socket.unbind(address)
        with remote_at(port, timeout_s=0.1) as remote:
            with pytest.raises(RemoteSilentError):
                remote.ask(pupil_remote.STOP_RECORDING)
            socket.bind(address)
            assert not socket.poll(300)


def test_an_answer_that_is_no_text() -> None:
    with answering() as (socket, port), remote_at(port) as remote:
        thread = threading.Thread(target=lambda: (socket.recv(), socket.send(b"\xff\xfe")))
        thread.start()
        with pytest.raises(RemoteReplyError, match="not Pupil Remote"):
            remote.ask(pupil_remote.VERSION)
        thread.join()
