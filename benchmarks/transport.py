"""From a sample in the bridge, through its chain, to its state in another process: two eyes, readers of all kinds."""

from __future__ import annotations

import contextlib
import multiprocessing
import tempfile
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import zmq

from entoptic.services import keys
from entoptic.tracker_bridge import wire
from entoptic.tracker_bridge.access import ClientKeys, ServerKeys
from entoptic.tracker_bridge.chain import Chain
from entoptic.tracker_bridge.events import Heartbeat
from entoptic.tracker_bridge.publisher import Publisher
from entoptic.tracker_bridge.samples import NS_PER_S, Direction, EyeState, GazeSample, OneEyeState, Phase, PupilSample
from entoptic.tracker_bridge.source import Item, Tick

RATE_HZ = 400
"""Two eyes at 200 Hz whose cameras take turns: a state each."""
SECONDS = 5
ROUNDS = 5
FILL = 40_000
"""States that fill all queues of a stalled reader."""


def state(sequence: int, t_ns: int) -> EyeState:
    one = OneEyeState(Phase.TRACKING, 4.1, 4.2, 0.97, 0.9, Direction(1.5, -2.5, t_ns), t_ns)
    return EyeState(sequence, t_ns, one, one, Direction(1.5, -2.5, t_ns), 250_000)


def samples(k: int, t_ns: int) -> tuple[Item, ...]:
    """What one eye's camera gives, the eyes taking turns."""
    eye = wire.Eye(k % 2)
    return PupilSample(t_ns, eye, 4.2, 0.97, 0.9), GazeSample(t_ns, eye, 1.5, -2.5, 0.97), Tick(t_ns)


def subscriber(address: str, client: ClientKeys | None) -> zmq.Socket[bytes]:
    socket: zmq.Socket[bytes] = zmq.Context().socket(zmq.SUB)
    if client is not None:
        client.use(socket)
    socket.connect(address)
    socket.setsockopt(zmq.SUBSCRIBE, b"")
    assert socket.poll(20_000)
    return socket


def probe(address: str, client: ClientKeys | None, pipe: Connection) -> None:
    """Measures how old each state is; states of time 0 are no states, one of a negative time is the last."""
    socket = subscriber(address, client)
    pipe.send("ready")
    latencies: list[int] = []
    while (got := wire.decode_state(socket.recv())).t_ns >= 0:
        if got.t_ns:
            latencies.append(time.monotonic_ns() - got.t_ns)
    pipe.send(np.array(latencies))


def fast(address: str, pipe: Connection) -> None:
    socket = subscriber(address, None)
    pipe.send("ready")
    while True:
        wire.decode_state(socket.recv())


def stalled(address: str, pipe: Connection) -> None:
    _socket = subscriber(address, None)
    pipe.send("ready")
    time.sleep(3600)


def greedy(address: str, pipe: Connection) -> None:
    """Asks for lost events without pause."""
    socket: zmq.Socket[bytes] = zmq.Context().socket(zmq.REQ)
    socket.connect(address)
    pipe.send("ready")
    while True:
        socket.send(wire.encode_request(1))
        socket.recv()


@contextlib.contextmanager
def running(target: Callable[..., None], *arguments: object, meanwhile: Callable[[], None]) -> Iterator[Connection]:
    """A process that has said that it is ready."""
    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=target, args=(*arguments, there), daemon=True)
    process.start()
    while not here.poll(0.02):
        meanwhile()
    here.recv()
    yield here
    process.kill()
    process.join()


def resident_mb() -> float:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return float("nan")


class Bare:
    """A socket and nothing else."""

    def __init__(self) -> None:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._socket = self._context.socket(zmq.PUB)
        self._socket.bind("tcp://127.0.0.1:*")
        self.addresses = (self._socket.getsockopt_string(zmq.LAST_ENDPOINT),)

    def send(self, state: EyeState) -> None:
        self._socket.send(wire.encode_state(state))

    def beat(self) -> None:
        pass

    def close(self) -> None:
        self._context.destroy(linger=0)


class Whole(Bare):
    """All of the publisher."""

    def __init__(self, server: ServerKeys | None = None) -> None:
        self.publisher = Publisher("tcp://127.0.0.1:*", "tcp://127.0.0.1:*", keys=server)
        self.addresses = self.publisher.addresses[:1]

    def send(self, state: EyeState) -> None:
        self.publisher.publish_state(state)

    def beat(self) -> None:
        self.publisher.publish_event(Heartbeat(0, 0, 0))

    def close(self) -> None:
        self.publisher.close()


def measure(bridge: Bare, reader: Callable[..., None] | None, client: ClientKeys | None) -> tuple[np.ndarray, float]:
    """Latencies in ms, and by how many MB the bridge's process grew."""

    def pause() -> None:
        bridge.send(state(0, 0))

    with contextlib.ExitStack() as others:
        heard = others.enter_context(running(probe, bridge.addresses[0], client, meanwhile=pause))
        if reader is greedy:
            assert isinstance(bridge, Whole)
            for _ in range(5000):
                bridge.publisher.publish_event(wire.BlinkOnset(0, wire.Eye.LEFT))
            others.enter_context(running(greedy, bridge.publisher.replay_address, meanwhile=pause))
        elif reader is not None:
            others.enter_context(running(reader, bridge.addresses[0], meanwhile=pause))
        before_mb = resident_mb()
        if reader is stalled:
            for k in range(FILL):
                bridge.send(state(0, 0))
                if k % 200 == 0:
                    time.sleep(0.01)
            assert isinstance(bridge, Whole)
            assert bridge.publisher.stalls > 0, "the stalled reader's queues are not full"
            time.sleep(1.0)
        chain = Chain(live=True)
        begun_ns = time.monotonic_ns()
        for k in range(RATE_HZ * SECONDS):
            due_ns = begun_ns + k * NS_PER_S // RATE_HZ
            time.sleep(max(due_ns - time.monotonic_ns(), 0) * 1e-9)
            for item in samples(k, time.monotonic_ns()):
                for record in chain.step(item):
                    if isinstance(record, EyeState):
                        bridge.send(record)
            if k % RATE_HZ == 0:
                bridge.beat()
        grown_mb = resident_mb() - before_mb
        bridge.send(state(0, -1))
        assert heard.poll(20)
        latencies_ns = heard.recv()
    assert len(latencies_ns) == RATE_HZ * SECONDS, "a state was lost to a reader that keeps up"
    return latencies_ns * 1e-6, grown_mb


def main() -> None:
    """Prints one table; the rows take turns."""
    with tempfile.TemporaryDirectory() as folder:
        server = keys.load_server(keys.make_bridge(Path(folder)))
        client = keys.load_client(keys.make_client(Path(folder), "probe"))
        rows: dict[str, tuple[Callable[[], Bare], Callable[..., None] | None, ClientKeys | None]] = {
            "a bare PUB socket, nobody else": (Bare, None, None),
            "no worker": (Whole, None, None),
            "a fast worker": (Whole, fast, None),
            "a stalled worker, all its queues full": (Whole, stalled, None),
            "a reader that asks for 5000 lost events without pause": (Whole, greedy, None),
            "no worker, with keys": (lambda: Whole(server), None, client),
        }
        latencies: dict[str, list[np.ndarray]] = {name: [] for name in rows}
        grown_mb = dict.fromkeys(rows, 0.0)
        for _ in range(ROUNDS):
            for name, (make, reader, keys_of_probe) in rows.items():
                bridge = make()
                measured, grown = measure(bridge, reader, keys_of_probe)
                bridge.close()
                latencies[name].append(measured)
                grown_mb[name] = max(grown_mb[name], grown)
    print(f"\n### From a sample to its state in another process, {RATE_HZ} states/s\n")
    print(
        "| beside the reader that measures | p50 ms | p99 ms | longest ms | bridge grew by MB |\n"
        "|---|---:|---:|---:|---:|"
    )
    for name, parts in latencies.items():
        # The middle of the rounds, so that one in which the machine was busy elsewhere does not count.
        middle, late, latest = np.median([np.percentile(part, [50, 99, 100]) for part in parts], axis=0)
        print(f"| {name} | {middle:.2f} | {late:.2f} | {latest:.1f} | {grown_mb[name]:.1f} |")


if __name__ == "__main__":
    main()
