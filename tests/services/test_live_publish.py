"""What a live worker publishes, on real sockets."""

import dataclasses
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
import zmq

from entoptic.pipeline import EyePose, Frame, Glare, GlareLevel, GlareModel, Planning, as_displayed, perceive
from entoptic.services import keys
from entoptic.services.ipc import messages
from entoptic.services.ipc.messages import EngineFrame, EngineKernel, LatencyMs, MessageError, Picture, Shown, decode
from entoptic.services.rendering import Rendered
from entoptic.services.settings import Settings
from entoptic.services.worker import publish
from entoptic.services.worker.publish import QUEUE, LivePublisher
from entoptic.tracker_bridge.access import ClientKeys, OpenAddressError
from entoptic.tracker_bridge.publisher import PortInUseError
from entoptic.tracker_bridge.wire import Eye, EyeState, OneEyeState, Phase

ANY = "tcp://127.0.0.1:*"
PATIENCE_MS = 60_000
KINDS = dict(zip(messages.TOPICS, (Picture, Picture, Shown, EngineFrame, EngineKernel), strict=True))
SETTINGS = Settings(glare=Glare(GlareModel.CIE, GlareLevel.QUARTER), plan=Planning(everything=True))
ONE = OneEyeState(Phase.CLOSING, 4.1, 4.1, 1.0, 0.7, None)
STATE = EyeState(3, 5, ONE, ONE, None)
EYES = (Eye.LEFT, Eye.RIGHT)
Socket = zmq.Socket[bytes]


def rendered_of(width: int = 96, height: int = 80) -> Rendered:
    light = np.full((2, 3, height, width), 2.0, np.float32)
    light[:, :, height // 2, width // 2] = 20_000
    frame = Frame.from_rgb(light, 40.0)
    poses = (EyePose(3.0, -2.0, 4.1, 0.7), EyePose(2.0, -2.0, 4.3, 0.7))
    perceived = perceive(frame, poses, display=SETTINGS.display, effects=SETTINGS, planning=SETTINGS.plan)
    return Rendered(7, 0.5, STATE, poses, frame, perceived, 5.0)


@pytest.fixture(scope="module")
def rendered() -> Rendered:
    return rendered_of()


@pytest.fixture
def publisher() -> Iterator[LivePublisher]:
    made = LivePublisher(ANY)
    yield made
    made.close()


@pytest.fixture
def reader() -> Iterator[Callable[..., Socket]]:
    context: zmq.Context[Socket] = zmq.Context()

    def connect(address: str, *topics: bytes, client: ClientKeys | None = None, kind: int = zmq.SUB) -> Socket:
        socket = context.socket(kind)
        socket.setsockopt(zmq.LINGER, 0)
        if client is not None:
            client.use(socket)
        socket.connect(address)
        for topic in topics:
            socket.setsockopt(zmq.SUBSCRIBE, topic)
        return socket

    yield connect
    context.destroy(linger=0)


def show(publisher: LivePublisher, rendered: Rendered, *, t_ns: int = 12, take: str | None = None) -> None:
    publisher.show(
        rendered,
        EYES,
        SETTINGS,
        t_ns=t_ns,
        fps=24.0,
        reached_fps=23.5,
        dropped=2,
        latency=lambda: LatencyMs(5.0, 10.0, 40.0),
        sink_ms=1.5,
        recording=take,
    )


def until(publisher: LivePublisher, condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_MS / 1e3
    while not condition():
        assert time.monotonic() < deadline
        publisher.take_subscriptions()
        time.sleep(0.002)


def received(socket: Socket) -> tuple[bytes, bytes]:
    assert socket.poll(PATIENCE_MS)
    topic, message = socket.recv_multipart()
    return topic, message


def test_each_topic_carries_what_was_rendered(
    publisher: LivePublisher, reader: Callable[..., Socket], rendered: Rendered
) -> None:
    socket = reader(publisher.address, *messages.TOPICS)
    until(publisher, lambda: all(map(publisher.wants, messages.TOPICS)))
    assert publisher.viewers == 1
    show(publisher, rendered, take="folder")
    bodies: dict[bytes, list[object]] = {}
    for _ in range(6):
        topic, message = received(socket)
        bodies.setdefault(topic, []).append(decode(message, KINDS[topic]))
    (perceived,), (displayed,), (shown,) = (bodies[topic] for topic in messages.TOPICS[:3])
    assert isinstance(perceived, Picture)
    assert isinstance(displayed, Picture)
    assert isinstance(shown, Shown)
    np.testing.assert_array_equal(perceived.image, np.concatenate(list(rendered.perceived.image), axis=1))
    expected = as_displayed(rendered.frame, SETTINGS.display)
    np.testing.assert_array_equal(displayed.image, np.concatenate(list(expected), axis=1))
    assert (perceived.width_px, perceived.height_px, perceived.encoding) == (192, 80, "srgb")
    assert (shown.frame, shown.recording, shown.dropped, shown.reached_fps) == (7, "folder", 2, 23.5)
    assert shown.latency is not None
    assert shown.latency.total == 55.0
    assert [eye.eye for eye in shown.eyes] == ["left", "right"]
    assert shown.eyes[0].phase == "closing"
    assert shown.eyes[0].gaze_px == rendered.frame.view.pixel_of(3.0, -2.0)
    assert [step.effect for step in shown.plan] == [step.effect for step in rendered.perceived.plan]
    assert shown.milliseconds.keys() >= {"scene", "measure", "glare", "encode", "sink", "displayed"}
    (engine,), kernels = bodies[b"engine"], bodies[b"kernel"]
    assert isinstance(engine, EngineFrame)
    first, second = (k.number for k in kernels if isinstance(k, EngineKernel))
    assert 0 < first < second
    assert [eye.kernel for eye in engine.eyes] == [first, second]
    assert engine.eyes[0].blink


def test_what_nobody_wants_is_not_made(
    publisher: LivePublisher, reader: Callable[..., Socket], rendered: Rendered, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []
    watched = ((publish, "as_displayed"), (publish, "picture"), (publish, "eye_shown"))
    for module, name in (*watched, (publish.engine, "engine_kernel"), (publish.engine, "engine_frame")):
        original = getattr(module, name)

        def note(*given: object, name: str = name, original: Callable[..., object] = original) -> object:
            made.append(name)
            return original(*given)

        monkeypatch.setattr(module, name, note)
    show(publisher, rendered)
    assert made == []
    for topic, calls in {
        b"shown": {"eye_shown"},
        b"engine": {"engine_frame"},
        b"kernel": {"engine_kernel"},
        b"perceived": {"picture"},
        b"displayed": {"as_displayed", "picture"},
    }.items():
        socket = reader(publisher.address, topic)
        until(publisher, lambda topic=topic: publisher.wants(topic))  # type: ignore[misc]
        show(publisher, rendered)
        assert received(socket)[0] == topic
        assert set(made) == calls
        socket.close()
        until(publisher, lambda topic=topic: not publisher.wants(topic))  # type: ignore[misc]
        made.clear()
    until(publisher, lambda: publisher.viewers == 0)
    show(publisher, rendered)
    assert made == []


def test_kernels_come_when_they_change_and_to_each_new_subscriber(
    publisher: LivePublisher, reader: Callable[..., Socket], rendered: Rendered
) -> None:
    first = reader(publisher.address, b"kernel")
    until(publisher, lambda: publisher.wants(b"kernel"))
    for t_ns in (0, 10**9, 2 * 10**9):
        show(publisher, rendered, t_ns=t_ns)
    numbers = [decode(received(first)[1], EngineKernel).number for _ in EYES]
    second = reader(publisher.address, b"kernel", b"engine")
    until(publisher, lambda: publisher._kernels_again and publisher.wants(b"engine"))
    show(publisher, rendered, t_ns=3 * 10**9)
    again = [decode(received(second)[1], EngineKernel).number for _ in EYES]
    topic, message = received(second)
    assert topic == b"engine"
    assert numbers == again == [eye.kernel for eye in decode(message, EngineFrame).eyes]
    # A worker that is started anew gives no number for the second time.
    anew = LivePublisher(ANY)
    third = reader(anew.address, b"kernel")
    until(anew, lambda: anew.wants(b"kernel"))
    show(anew, rendered)
    assert min(decode(received(third)[1], EngineKernel).number for _ in EYES) > max(numbers)
    anew.close()


def test_a_reader_that_stalls_goes_without_and_another_gets_all(
    publisher: LivePublisher, reader: Callable[..., Socket]
) -> None:
    big = rendered_of(640, 480)
    other = reader(publisher.address, b"perceived")
    slow = other.context.socket(zmq.SUB)
    for option, value in ((zmq.RCVHWM, 1), (zmq.RCVBUF, 4096), (zmq.LINGER, 0)):
        slow.setsockopt(option, value)
    slow.connect(publisher.address)
    slow.setsockopt(zmq.SUBSCRIBE, b"perceived")
    until(publisher, lambda: publisher.viewers == 2 and publisher.wants(b"perceived"))
    show(publisher, big)
    assert slow.poll(PATIENCE_MS)
    received(other)
    published, bytes_each = 40, 2 * 640 * 480 * 3
    for number in range(published):
        show(publisher, dataclasses.replace(big, frame_number=number))
        _, message = received(other)
        assert decode(message, Picture).frame == number
    got = []
    while slow.poll(500):
        got.append(decode(slow.recv_multipart()[1], Picture).frame)
    # What a queue, the kernels' buffers and the reader's own one message hold.
    most = QUEUE + 2 + 16_000_000 // bytes_each
    assert 0 < len(got) <= most < published
    # It is whole, in order, and goes on once it reads again.
    assert got[1:] == sorted(got[1:])
    show(publisher, dataclasses.replace(big, frame_number=999))
    assert decode(received(slow)[1], Picture).frame == 999


def test_prefixes_count_and_what_is_no_topic_does_not(
    publisher: LivePublisher, reader: Callable[..., Socket], rendered: Rendered
) -> None:
    socket = reader(publisher.address, b"shown-not", b"x" * 900)
    until(publisher, lambda: publisher.viewers == 1)
    show(publisher, rendered)
    assert not any(map(publisher.wants, messages.TOPICS))
    socket.setsockopt(zmq.SUBSCRIBE, b"sh")
    until(publisher, lambda: publisher.wants(b"shown"))
    assert not publisher.wants(b"perceived")
    socket.setsockopt(zmq.SUBSCRIBE, b"")
    until(publisher, lambda: all(map(publisher.wants, messages.TOPICS)))
    socket.setsockopt(zmq.UNSUBSCRIBE, b"")
    until(publisher, lambda: not publisher.wants(b"perceived"))
    assert publisher.wants(b"shown")


def test_foreign_and_oversized_messages_change_nothing(
    publisher: LivePublisher, reader: Callable[..., Socket], rendered: Rendered
) -> None:
    faithful = reader(publisher.address, b"shown")
    loud = reader(publisher.address, kind=zmq.XSUB)
    for said in (b"", b"\x02shown", b"\x00shown", b"\xff" * 100, b"\x01" + b"s" * 5000, b"\x02" * 1_000_000):
        loud.send(said)
    refused = reader(publisher.address, b"y" * 5000)
    until(publisher, lambda: publisher.wants(b"shown"))
    for _ in range(20):
        show(publisher, rendered)
        assert received(faithful)[0] == b"shown"
    assert not any(publisher.wants(topic) for topic in messages.TOPICS if topic != b"shown")
    assert not refused.poll(0)


def test_beyond_this_machine_keys_are_needed_and_a_port_is_one_publishers() -> None:
    with pytest.raises(OpenAddressError, match="--server-keys"):
        LivePublisher("tcp://0.0.0.0:*")
    one = LivePublisher(ANY)
    with pytest.raises(PortInUseError, match="choose another port"):
        LivePublisher(one.address)
    one.close()


def test_with_keys_those_who_are_known_come_in_alone(
    tmp_path: Path, reader: Callable[..., Socket], rendered: Rendered
) -> None:
    folder = tmp_path / "keys"
    keys.make_bridge(folder)
    server = keys.load_server(folder / "bridge")
    publisher = LivePublisher(ANY, server)
    later = keys.load_client(keys.make_client(folder, "later"))
    known = reader(publisher.address, b"shown", client=later)
    until(publisher, lambda: publisher.wants(b"shown"))
    public, secret = zmq.curve_keypair()
    stranger = reader(publisher.address, b"perceived", client=ClientKeys(public, secret, server.public))
    bare = reader(publisher.address, b"perceived")
    for _ in range(10):
        show(publisher, rendered)
        assert received(known)[0] == b"shown"
        time.sleep(0.02)
    assert not publisher.wants(b"perceived")
    assert not stranger.poll(0)
    assert not bare.poll(0)
    publisher.close()


def test_a_picture_that_is_not_as_large_as_it_says_is_refused() -> None:
    fine = Picture(1, 2, 2, 1, "srgb", "uint16", bytes(12))
    assert fine.image.shape == (1, 2, 3)
    for change in ({"width_px": 3}, {"width_px": -1, "height_px": -2}, {"dtype": "object"}, {"pixels": bytes(11)}):
        with pytest.raises(MessageError):
            msgspec.structs.replace(fine, **change).image  # noqa: B018 - the property raises
