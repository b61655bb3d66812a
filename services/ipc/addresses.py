"""Where the processes of a live session are to be reached."""

from __future__ import annotations

import contextlib
import socket

import msgspec


class Addresses(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """ZeroMQ addresses. They stay the same when a process is started again, so that all others find it again."""

    states: str
    events: str
    replay: str
    bridge: str
    """The bridge's control."""
    screens: str
    """Where the bridge asks for the screens of a pupil calibration (PUB)."""
    answers: str
    """Where a display answers it (PULL)."""
    frames: str
    """Where the worker publishes (messages.py)."""
    worker: str
    """The worker's control."""


def free_addresses(host: str = "127.0.0.1") -> Addresses:
    """Ports that nobody listens on now."""
    with contextlib.ExitStack() as held:
        ports = []
        for _ in msgspec.structs.fields(Addresses):
            one = held.enter_context(socket.socket())
            one.bind((host, 0))
            ports.append(one.getsockname()[1])
    return Addresses(*(f"tcp://{host}:{port}" for port in ports))
