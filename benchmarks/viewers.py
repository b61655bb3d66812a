"""What pages that watch cost a session: frames a second with none, with 50, and with one that never reads.

Real processes: bridge, worker and the console's server, with simulated eyes on the street at night. The ways take
turns, so that what else the machine does falls on all of them.

    python -m benchmarks.viewers [--width 240] [--fps 12] [--seconds 8] [--rounds 3]
"""

from __future__ import annotations

import argparse
import contextlib
import os
import select
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import zmq

from entoptic.services.config import ViewConfig
from entoptic.services.ipc import messages
from entoptic.services.ipc.addresses import free_addresses
from entoptic.services.ipc.messages import SHOWN, Shown
from entoptic.services.live.children import Child
from entoptic.services.process_config import (
    BridgeConfig,
    FoldersConfig,
    PageConfig,
    PageLinks,
    ServerConfig,
    WorkerLinks,
)
from entoptic.services.session_config import WorkerConfig

READY_WITHIN_S = 240.0
SETTLES_S = 2.0
WAYS = {"nobody": (0, False), "1 page": (1, False), "50 pages": (50, False), "1 that never reads": (1, True)}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--width", type=int, default=240)
    parser.add_argument("--fps", type=float, default=12.0)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--watch", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.watch is not None:
        port, count, stuck = options.watch
        watch(int(port), int(count), stuck == "True")
        return
    view = ViewConfig(width_px=options.width, height_px=options.width * 10 // 9, fps=options.fps)
    with tempfile.TemporaryDirectory() as folder, session(view, Path(folder)) as (frames, port):
        measured: dict[str, list[float]] = {way: [] for way in WAYS}
        sent: dict[str, list[float]] = {way: [] for way in WAYS}
        for _ in range(options.rounds):
            for way, (count, stuck) in WAYS.items():
                with pages(port, count, stuck) as read:
                    fps = rate(frames, options.seconds)
                measured[way].append(fps)
                sent[way].append(read())
    print(f"{options.width} px wide, {options.fps:g} frames a second asked for, {os.cpu_count()} processors")
    print(f"{'':20} {'frames/s':>9} {'ratio':>6}   {'each':24} {'kB/s to pages':>14}")
    for way, values in measured.items():
        ratio = statistics.median(value / none for value, none in zip(values, measured["nobody"], strict=True))
        each = " ".join(f"{value:.2f}" for value in values)
        print(
            f"{way:20} {statistics.median(values):9.2f} {ratio:6.3f}   {each:24} {statistics.median(sent[way]):14.0f}"
        )


@contextlib.contextmanager
def session(view: ViewConfig, folder: Path) -> Iterator[tuple[zmq.Socket[bytes], int]]:
    """The frames of a worker that renders, and the console's port."""
    addresses = free_addresses()
    at = addresses
    bridge = BridgeConfig(
        states=at.states, events=at.events, replay=at.replay, control=at.bridge, screens=at.screens,
        answers=at.answers, sees=at.frames, live=True,
    )  # fmt: skip
    links = WorkerLinks(states=at.states, events=at.events, frames=at.frames, control=at.worker)
    named = ("states", "events", "bridge", "screens", "answers", "frames", "worker")
    server = ServerConfig(
        page=PageConfig(port=0),
        folders=FoldersConfig(root=str(folder)),
        links=PageLinks(**{name: getattr(at, name) for name in named}),
    )
    with contextlib.ExitStack() as opened:
        opened.callback(Child("bridge", bridge).end)
        opened.callback(Child("worker", WorkerConfig(links=links, view=view)).end)
        web = Child("web", server)
        opened.callback(web.end)
        port = int(_ready(web)["port"])
        context = opened.enter_context(zmq.Context())
        frames = opened.enter_context(context.socket(zmq.SUB))
        frames.setsockopt(zmq.LINGER, 0)
        frames.connect(addresses.frames)
        frames.setsockopt(zmq.SUBSCRIBE, SHOWN)
        if not frames.poll(round(READY_WITHIN_S * 1000)):
            raise SystemExit("the worker shows no frames")
        yield frames, port


def _ready(child: Child) -> dict[str, Any]:
    deadline_s = time.monotonic() + READY_WITHIN_S
    while time.monotonic() < deadline_s:
        for message in child.drain():
            if message["event"] == "ready":
                return message
        time.sleep(0.05)
    raise SystemExit(f"the {child.name} is not ready: {child.output}")


def rate(frames: zmq.Socket[bytes], seconds: float) -> float:
    """Frames a second that are rendered, once all have settled."""
    ends_s = time.monotonic() + SETTLES_S
    first: Shown | None = None
    count, last = 0, None
    while time.monotonic() < ends_s + seconds:
        if frames.poll(100):
            shown = messages.decode(frames.recv_multipart()[-1], Shown)
            if time.monotonic() >= ends_s:
                first, last, count = first or shown, shown, count + 1
    if first is None or last is None or count < 2:
        return 0.0
    return (count - 1) / ((last.t_ns - first.t_ns) * 1e-9)


@contextlib.contextmanager
def pages(port: int, count: int, stuck: bool) -> Iterator[Any]:
    """Pages that watch, in a process of their own; after it, how many kB a second they were sent."""
    begun_s = time.monotonic()
    command = [sys.executable, "-m", "benchmarks.viewers", "--watch", str(port), str(count), str(stuck)]
    watching = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    said: list[bytes] = []
    try:
        yield lambda: float(said[0] or 0) / 1000 / (time.monotonic() - begun_s)
    finally:
        said.append(watching.communicate()[0])


def watch(port: int, count: int, stuck: bool) -> None:
    """Takes all that comes, at the cost of a browser elsewhere: next to none. Prints the bytes."""
    os.nice(19)
    sockets = [_page(port) for _ in range(count)]
    read = 0
    while True:
        ready, _, _ = select.select([sys.stdin, *([] if stuck else sockets)], [], [])
        if sys.stdin in ready:
            break
        read += sum(len(one.recv(1 << 20)) for one in sockets if one in ready)
        time.sleep(0.02)
    print(read)


def _page(port: int) -> socket.socket:
    one = socket.create_connection(("127.0.0.1", port))
    at = f"127.0.0.1:{port}"
    one.sendall(
        f"GET /live HTTP/1.1\r\nHost: {at}\r\nOrigin: http://{at}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    return one


if __name__ == "__main__":
    main()
