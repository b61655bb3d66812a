"""What host, bridge and worker say of themselves, asked for all the time, and what is made of it for problems.py."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any, TypeVar

import msgspec

from entoptic.services.ipc.addresses import Addresses
from entoptic.services.ipc.client import Client, ControlError
from entoptic.services.ipc.requests import GiveStatus
from entoptic.tracker_bridge.access import ClientKeys

PERIOD_S = 0.5
PATIENCE_MS = 1500
"""Engineering choice: a process that renders answers between two frames."""
SILENT_S = 3.0
"""Without an answer for as long a process is taken for gone. Engineering choice: six questions."""


class ProcessSays(msgspec.Struct, frozen=True):
    """One process, as the host has it."""

    pid: int | None = None
    state: str = "starting"
    restarts: int = 0
    last_error: str | None = None


class HostSays(msgspec.Struct, frozen=True):
    """A host's status; unknown keys are passed over, here and below."""

    running: bool = False
    state: str | None = None
    config: dict[str, Any] | None = None
    started: str | None = None
    folder: str | None = None
    finishing: str | None = None
    last_folder: str | None = None
    root: str | None = None
    processes: dict[str, ProcessSays] = {}
    addresses: dict[str, str] | None = None
    trouble: str | None = None

    @property
    def places(self) -> Addresses | None:
        """Where its processes are to be reached."""
        try:
            return msgspec.convert(self.addresses, Addresses) if self.addresses else None
        except msgspec.ValidationError:
            return None


class BridgeSays(msgspec.Struct, frozen=True):
    """A bridge's status."""

    source: str | None = None
    states: int = 0
    rate_hz: float | None = None
    late_samples: int = 0
    clock_uncertainty_ms: float | None = None
    silent: str | None = None
    trouble: str | None = None
    calibrating: dict[str, Any] | None = None
    calibrated: dict[str, Any] | None = None


class WorkerSays(msgspec.Struct, frozen=True):
    """A worker's status."""

    scene: str | None = None
    fps: float | None = None
    reached_fps: float | None = None
    dropped: int | None = None
    preparing: bool = False
    trouble: str | None = None
    settings: dict[str, Any] | None = None
    """Those in force."""


Says = TypeVar("Says", HostSays, BridgeSays, WorkerSays)


def read(data: dict[str, Any] | None, kind: type[Says]) -> Says | None:
    """What a process said; None where it makes no sense."""
    try:
        return msgspec.convert(data, kind, strict=False)
    except msgspec.ValidationError:
        return None


class Snapshot(msgspec.Struct, frozen=True, kw_only=True):
    """All that is known at a moment. Of a process that does not answer nothing is known: None."""

    hosted: bool
    host: HostSays | None = None
    bridge: BridgeSays | None = None
    worker: WorkerSays | None = None
    host_silent_s: float = 0.0
    """Since it last answered."""
    bridge_silent_s: float = 0.0
    worker_silent_s: float = 0.0
    lost_s: dict[str, float] = {}
    """For how long each lost eye has been lost."""
    states_silent_s: float | None = None
    """Since the last state came; None if none ever came."""
    frames_silent_s: float | None = None
    """The same of frames."""
    dropped_share: float = 0.0
    """Of the frames due in the last ten seconds."""
    trouble: str | None = None
    """What the worker's frames say is wrong."""
    latency_p95_ms: float | None = None
    free_bytes: int | None = None
    """On the disk where takes go; None where that is not known."""

    @property
    def running(self) -> bool:
        """Whether a session runs; bridge and worker that nobody hosts always do."""
        return True if not self.hosted else self.host is not None and self.host.running


class Watched:
    """Asks one process for its status, again and again. For one event loop."""

    def __init__(self, keys: ClientKeys | None) -> None:
        self._keys = keys
        self.data: dict[str, Any] | None = None
        """The last answer; None while there is none, or the last one is too old."""
        self.heard_s = time.monotonic()

    @property
    def silent_s(self) -> float:
        """Since the last answer, or the first question."""
        return time.monotonic() - self.heard_s

    async def watch(self, address: Callable[[], str | None]) -> None:
        """Until cancelled. `address`: None while it is not known."""
        while True:
            begun_s = time.monotonic()
            if (place := address()) is None:
                self.data, self.heard_s = None, begun_s
            else:
                data = await self._ask(place)
                if data is not None:
                    self.data, self.heard_s = data, time.monotonic()
                elif self.silent_s > SILENT_S:
                    self.data = None
            await asyncio.sleep(max(PERIOD_S - (time.monotonic() - begun_s), 0.1))

    async def _ask(self, address: str) -> dict[str, Any] | None:
        try:
            with Client(address, self._keys) as client:
                data: dict[str, Any] | None = (await client.ask_async(GiveStatus(), PATIENCE_MS)).data
                return data
        except ControlError:
            return None
