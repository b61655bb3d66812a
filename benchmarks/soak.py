"""One bridge on a stand-in for Pupil Capture that misbehaves in every way it can, one way after the other.

`python -m benchmarks.soak` runs for ten minutes at 2×200 Hz and prints a table; `--minutes 1` is a first look.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import dataclasses
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import zmq

from entoptic.services.event_feed import EventFeed
from entoptic.tracker_bridge import wire
from entoptic.tracker_bridge.wire import EyeState, Heartbeat, Phase

FAULTS = (
    (),
    ("restart@5s",),
    ("silence@5s:3s",),
    ("late=3s",),
    ("duplicate",),
    ("backwards",),
    ("corrupt",),
    ("drift=200ppm",),
    ("timebase=+100s@5s",),
    ("stuck@3s:6s",),
)


@dataclasses.dataclass
class Tally:
    """What came of one fault."""

    states: int = 0
    tracking: int = 0
    backwards: int = 0
    gaps: int = 0
    events: collections.Counter[str] = dataclasses.field(default_factory=collections.Counter)
    longest_wait_s: float = 0.0
    memory_mib: float = 0.0
    last: EyeState | None = None

    def take(self, state: EyeState) -> None:
        if self.last is not None:
            self.backwards += state.t_ns < self.last.t_ns
            self.gaps += state.sequence - self.last.sequence - 1
        self.last = state
        self.states += 1
        self.tracking += state.left.phase is Phase.TRACKING


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    seconds = parser.parse_args(arguments).minutes * 60 / len(FAULTS)
    remote_port, states_port, events_port = (_free_port() for _ in range(3))
    states, events = (f"tcp://127.0.0.1:{port}" for port in (states_port, events_port))
    command = ["bridge", "--source", "capture", "--remote", f"tcp://127.0.0.1:{remote_port}"]
    with _entoptic(*command, "--states", states, "--events", events) as bridge:
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        reader = context.socket(zmq.SUB)
        reader.setsockopt(zmq.RCVHWM, 0)
        reader.connect(states)
        feed = EventFeed(context, events, None)
        for one in (reader, feed.socket):
            one.setsockopt(zmq.SUBSCRIBE, b"")
        print("\n### Ten ways to misbehave, one bridge\n")
        print("| fault | states | tracking | behind each other | missed | longest wait s | memory MiB | events |")
        print("|---|---:|---:|---:|---:|---:|---:|---|")
        before = Tally()
        for faults in FAULTS:
            options = [option for fault in faults for option in ("--fault", fault)]
            with _entoptic("capture", "simulated", "--port", str(remote_port), *options):
                tally = _watch(reader, feed, bridge, seconds, before.last)
            if bridge.poll() is not None:
                raise SystemExit(f"the bridge ended with status {bridge.returncode} under {faults or 'no fault'}")
            told = ", ".join(f"{name} {count}" for name, count in sorted(tally.events.items()))
            print(
                f"| {' '.join(faults) or 'none'} | {tally.states:,} | {tally.tracking / max(tally.states, 1):.0%} | "
                f"{tally.backwards} | {tally.gaps} | {tally.longest_wait_s:.1f} | {tally.memory_mib:.0f} | {told} |",
                flush=True,
            )
            before = tally
        print(f"\nevents lost: {feed.lost}")
        context.destroy(linger=0)


def _watch(
    reader: zmq.Socket[bytes],
    feed: EventFeed,
    bridge: subprocess.Popen[bytes],
    seconds: float,
    last: EyeState | None,
) -> Tally:
    tally = Tally(last=last)
    begun = waiting = time.monotonic()
    while time.monotonic() - begun < seconds and bridge.poll() is None:
        for event in feed.read(0):
            if not isinstance(event, Heartbeat):
                tally.events[type(event).__name__] += 1
        if not reader.poll(20):
            continue
        now = time.monotonic()
        tally.take(wire.decode_state(reader.recv()))
        tally.longest_wait_s = max(tally.longest_wait_s, now - waiting)
        waiting = now
    tally.memory_mib = _resident_mib(bridge.pid)
    return tally


def _resident_mib(process: int) -> float:
    """Linux alone says it without another library."""
    status = Path(f"/proc/{process}/status")
    if not status.exists():
        return float("nan")
    line = next(line for line in status.read_text().splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


def _free_port() -> int:
    with contextlib.closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def _entoptic(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(
        [sys.executable, "-m", "entoptic", *arguments], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(5)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


if __name__ == "__main__":
    main()
