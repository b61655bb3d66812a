"""How running sessions and processes are, as they say themselves, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import zmq

from entoptic.services.ipc.client import ControlError, ask
from entoptic.services.ipc.messages import Shown
from entoptic.services.ipc.requests import GiveStatus
from entoptic.services.ipc.shown_reader import ShownReader
from entoptic.services.live import registry
from entoptic.tracker_bridge.access import ClientKeys

FRAME_WITHIN_MS = 1000
"""A worker that has not shown a frame for so long shows none."""


class Found(msgspec.Struct, frozen=True):
    """One process, or one host with its session."""

    address: str
    said: dict[str, Any]
    """Its status' data; empty where nobody answers."""
    shown: Shown | None = None
    """The newest frame of a host's session."""
    silent: str | None = None
    """Why there is no status."""

    @property
    def wrong(self) -> tuple[str, ...]:
        """What is wrong, a sentence each."""
        found = [self.silent, self.said.get("trouble")]
        # A bridge that was asked itself, or what a host heard of its own.
        bridges = (self.said, self.said.get("figures", {}).get("bridge", {}))
        found += [f"the tracker is silent: {bridge['silent']}" for bridge in bridges if bridge.get("silent")]
        found += [
            f"the {name} is {one['state']}"
            for name, one in self.said.get("processes", {}).items()
            if one["state"] in ("restarting", "failed")
        ]
        return tuple(one for one in found if one)


def hosts() -> list[Found]:
    """All hosts of this user that run."""
    return [_host(one) for one in registry.running()]


def process(address: str, keys: ClientKeys | None) -> Found:
    """The one that answers there: a bridge, a worker or a host."""
    try:
        return Found(address, ask(address, GiveStatus(), keys).data or {})
    except ControlError as error:
        return Found(address, {}, silent=str(error))


def host_that_writes(folder: Path) -> int | None:
    """The pid of a host that records into a folder, or finishes it."""
    for one in registry.running():
        said = process(one.control, None).said
        if str(folder.resolve()) in (said.get("folder"), said.get("finishing")):
            return one.pid
    return None


def _host(running: registry.RunningHost) -> Found:
    found = process(running.control, None)
    said = {"pid": running.pid, **found.said}
    frames = (said.get("addresses") or {}).get("frames")
    if frames is None or said.get("state") != "running":
        return msgspec.structs.replace(found, said=said)
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    try:
        return msgspec.structs.replace(found, said=said, shown=ShownReader(context, frames).newest(FRAME_WITHIN_MS))
    finally:
        context.destroy(linger=0)
