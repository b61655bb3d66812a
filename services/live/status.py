"""How running sessions and processes are, for `entoptic status` and others who look from outside."""

from __future__ import annotations

from pathlib import Path

import msgspec
import zmq

from entoptic.services.ipc.client import ControlError, ask
from entoptic.services.ipc.messages import Shown
from entoptic.services.ipc.requests import GiveStatus
from entoptic.services.ipc.shown_reader import ShownReader
from entoptic.services.ipc.status import HostStatus, Problem, Status, problem, status_of
from entoptic.services.live import registry
from entoptic.tracker_bridge.access import ClientKeys

FRAME_WITHIN_MS = 1000
"""A worker that has not shown a frame for so long shows none."""


class Found(msgspec.Struct, frozen=True):
    """One process, or one host with its session."""

    address: str
    status: Status | None
    """None where nobody answers."""
    problems: tuple[Problem, ...] = ()
    shown: Shown | None = None
    """The newest frame of a host's session."""


def hosts() -> list[Found]:
    """All hosts of this user that run."""
    return [_host(one) for one in registry.running()]


def process(address: str, keys: ClientKeys | None) -> Found:
    """The one that answers there: a bridge, a worker or a host."""
    try:
        status = status_of(ask(address, GiveStatus(), keys).data)
    except ControlError as error:
        return Found(address, None, (problem("silent", "error", str(error), "See that it runs"),))
    if status is None:
        return Found(address, None, (problem("silent", "error", f"{address} is of another version", "Update it"),))
    return Found(address, status, status.problems)


def host_that_writes(folder: Path) -> int | None:
    """The pid of a host that records into a folder, or finishes it."""
    for one in registry.running():
        status = process(one.control, None).status
        if isinstance(status, HostStatus) and str(folder.resolve()) in (status.recording, status.finishing):
            return one.pid
    return None


def _host(running: registry.RunningHost) -> Found:
    found = process(running.control, None)
    status = found.status
    if not isinstance(status, HostStatus) or status.addresses is None or status.state != "running":
        return found
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    try:
        newest = ShownReader(context, status.addresses.frames).newest(FRAME_WITHIN_MS)
        return msgspec.structs.replace(found, shown=newest)
    finally:
        context.destroy(linger=0)
