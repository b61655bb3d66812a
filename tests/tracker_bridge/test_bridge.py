"""The chain of samples to states, and the sockets they leave by."""

import threading
import time
from collections.abc import Iterator

import pytest
import zmq

from services.reader import BridgeSilentError, StateReader
from tracker_bridge import bridge, wire
from tracker_bridge.samples import (
    Eye,
    EyeState,
    GazeSample,
    Phase,
    PupilSample,
    SourceInfo,
)

MS = 1_000_000


class Samples:
    """A source of samples made up by a test."""

    def __init__(self, samples: list[PupilSample | GazeSample]) -> None:
        self._samples = samples
        self.info = SourceInfo("made up", samples[0].t_ns, samples[-1].t_ns)

    def samples(self) -> Iterator[PupilSample | GazeSample]:
        return iter(self._samples)


def never() -> bool:
    return False


def both_eyes(count: int) -> list[PupilSample | GazeSample]:
    made: list[PupilSample | GazeSample] = []
    for k in range(count):
        made += [PupilSample(k * 5 * MS, eye, 4.0, 1.0) for eye in Eye]
        made.append(GazeSample(k * 5 * MS, None, k % 10, -1.0, 0.9))
    return made


def test_one_state_a_moment_with_everything_of_that_moment() -> None:
    states = [state for state, _ in bridge.states_of(iter(both_eyes(20)))]
    assert [state.sequence for state in states] == list(range(20))
    assert [state.t_ns for state in states] == [k * 5 * MS for k in range(20)]
    last = states[-1]
    assert last.left.phase is last.right.phase is Phase.TRACKING
    assert last.gaze is not None
    assert (last.gaze.azimuth_deg, last.gaze.elevation_deg) == (9, -1)


def test_before_an_eye_is_seen_it_is_lost_and_without_a_diameter() -> None:
    (state, _) = next(bridge.states_of(iter([GazeSample(0, None, 1.0, 1.0, 1.0)])))
    assert state.left.phase is Phase.LOST
    assert state.left.diameter_mm is None
    assert state.gaze is not None


def test_gaze_of_both_eyes_is_the_mean_of_the_fresh_ones() -> None:
    samples: list[PupilSample | GazeSample] = [
        GazeSample(0, Eye.LEFT, 4.0, 0.0, 1.0),
        GazeSample(0, Eye.RIGHT, 2.0, 2.0, 1.0),
        GazeSample(100 * MS, Eye.LEFT, 8.0, 0.0, 1.0),
        GazeSample(101 * MS, Eye.RIGHT, 50.0, 0.0, 0.1),
    ]
    gazes = [state.gaze for state, _ in bridge.states_of(iter(samples))]
    assert [(gaze.azimuth_deg, gaze.elevation_deg) for gaze in gazes if gaze] == [(3.0, 1.0), (8.0, 0.0), (8.0, 0.0)]


def test_the_chain_is_the_same_to_the_bit_twice() -> None:
    samples = both_eyes(200)
    first, second = ([wire.encode(state) for state, _ in bridge.states_of(iter(samples))] for _ in range(2))
    assert first == second


def publish(source: Samples, publisher: bridge.Publisher, *, real_time: bool = False) -> threading.Thread:
    def work() -> None:
        publisher.wait_for_reader(never)
        bridge.run(
            source, publisher, real_time=real_time, seconds=None, stopped=never, on_state=lambda state, events: None
        )
        publisher.close()

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    return thread


def test_a_slow_reader_by_recorded_time_gets_every_state() -> None:
    source = Samples(both_eyes(5000))
    publisher = bridge.Publisher("tcp://127.0.0.1:*", "tcp://127.0.0.1:*")
    reader = StateReader(*publisher.addresses, newest_only=False)
    thread = publish(source, publisher)
    started = reader.wait_for_start(never)
    assert started is not None
    assert (started.t_ns, started.t_end_ns) == (0, 4999 * 5 * MS)
    newest = []
    for frame in range(0, 25_000, 40):
        state = reader.until(frame * MS, never)
        newest.append(None if state is None else state.t_ns // MS)
        if frame == 4000:
            time.sleep(0.5)  # long enough for the publisher to run into the reader's full queue
    assert newest == list(range(0, 25_000, 40))
    assert reader.until(10**12, never) is not None
    assert reader.received == 5000
    assert reader.ended is not None
    assert reader.ended.state_count == 5000
    thread.join(10)
    reader.close()


def test_a_reader_of_the_newest_sees_the_newest_and_the_end() -> None:
    publisher = bridge.Publisher("tcp://127.0.0.1:*", "tcp://127.0.0.1:*")
    reader = StateReader(*publisher.addresses, newest_only=True)
    thread = publish(Samples(both_eyes(3000)), publisher)
    assert reader.wait_for_start(never) is not None
    thread.join(10)
    last: EyeState | None = None
    for _ in range(200):
        last = reader.newest() or last
        if reader.ended is not None and last is not None and last.sequence == 2999:
            break
        time.sleep(0.02)
    assert last is not None
    assert last.sequence == 2999
    assert reader.ended is not None
    reader.close()


def test_garbage_on_the_socket_is_counted_and_lived_through() -> None:
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    context.setsockopt(zmq.LINGER, 0)
    states, events = (context.socket(zmq.XPUB) for _ in range(2))
    for socket in (states, events):
        socket.bind("tcp://127.0.0.1:*")
    reader = StateReader(
        *(socket.getsockopt_string(zmq.LAST_ENDPOINT) for socket in (states, events)), newest_only=False
    )
    reader.subscribe()
    for socket in (states, events):
        assert socket.poll(5000)
        socket.recv()
    good = next(bridge.states_of(iter(both_eyes(1))))[0]
    for message in (b"", b"\xc1", b"\x81\xa1a\x01", wire.encode(good)[:-3], wire.encode(good)):
        states.send(message)
    events.send(b"\x6enoise")
    events.send(wire.encode(wire.StreamEnded(0, 5)))
    assert reader.until(0, never) == good
    assert reader.refused == {"TruncatedMessageError": 3, "ForeignMessageError": 2}
    reader.close()
    context.destroy(linger=0)


def test_a_port_in_use_is_named_with_the_remedy() -> None:
    publisher = bridge.Publisher("tcp://127.0.0.1:*", "tcp://127.0.0.1:*")
    with pytest.raises(bridge.PortInUseError, match=r"choose another port"):
        bridge.Publisher(publisher.addresses[0], "tcp://127.0.0.1:*")
    publisher.close()


def test_a_bridge_that_says_nothing_is_named() -> None:
    reader = StateReader("tcp://127.0.0.1:1", "tcp://127.0.0.1:2", newest_only=False)
    with pytest.raises(BridgeSilentError, match=r"127\.0\.0\.1:1"):
        reader.wait_for_start(never, patience_s=0.3)
    reader.close()
