"""The IPC backbone: whatever is sent to one of its ports comes out of the other, to those who subscribed to it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import msgpack  # type: ignore[import-untyped]  # ships no types
import zmq

from entoptic.tracker_bridge.sources.pupil_core.form import Map

NOTIFICATIONS: Final = b"notify."

_AT_ONCE: Final = 100
"""Engineering choice."""


class Backbone:
    """Both ends, on ports that the system chooses. Not for several threads."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], host: str) -> None:
        self.to_all: zmq.Socket[bytes] = context.socket(zmq.XPUB)
        self.from_clients: zmq.Socket[bytes] = context.socket(zmq.XSUB)
        for socket in (self.to_all, self.from_clients):
            socket.linger = 0
        self.sub_port = self.to_all.bind_to_random_port(f"tcp://{host}")
        self.pub_port = self.from_clients.bind_to_random_port(f"tcp://{host}")
        # The program itself listens to its clients' notifications.
        self.from_clients.send(b"\x01" + NOTIFICATIONS)

    def publish(self, frames: list[bytes]) -> None:
        """Sends a message to its subscribers; those who read too slowly miss it."""
        self.to_all.send_multipart(frames)

    def pass_on(self) -> list[list[bytes]]:
        """Passes on what has come, both ways. Returns the notifications among it."""
        for _ in waiting(self.to_all):
            self.from_clients.send(self.to_all.recv())
        notifications = []
        for _ in waiting(self.from_clients):
            frames = self.from_clients.recv_multipart()
            self.publish(frames)
            if frames[0].startswith(NOTIFICATIONS):
                notifications.append(frames)
        return notifications

    def close(self) -> None:
        """Frees both ports at once; what was not sent yet is lost."""
        self.to_all.close()
        self.from_clients.close()


def waiting(socket: zmq.Socket[bytes]) -> Iterator[None]:
    """Once for each message that waits in a socket, up to a bound: a flood must not hold up what is due."""
    for _ in range(_AT_ONCE):
        if not socket.poll(0):
            return
        yield


def frames_of(topic: str, datum: Map) -> list[bytes]:
    """A message as Capture sends it."""
    packed: bytes = msgpack.packb(datum, use_bin_type=True)
    return [topic.encode(), packed]


def notification(frames: list[bytes]) -> dict[str, Any] | None:
    """A client's notification; None where it has no map or no subject, of which the real eye processes die."""
    if len(frames) < 2:
        return None
    try:
        contents = msgpack.unpackb(frames[1], strict_map_key=False)
    except (ValueError, TypeError, msgpack.UnpackException):
        # TypeError: a map whose key is a list.
        return None
    return contents if isinstance(contents, dict) and isinstance(contents.get("subject"), str) else None
