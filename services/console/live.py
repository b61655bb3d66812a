"""What the console knows of a session, from whatever runs it; kept up to date, and sent to all pages twice a second."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import msgspec
import zmq
from msgspec.structs import replace

from entoptic.services.console import protocol
from entoptic.services.console.feed import Feed, name_of
from entoptic.services.console.figures import Figures
from entoptic.services.console.pictures import Pictures
from entoptic.services.console.problems import Snapshot, problems
from entoptic.services.console.protocol import StatusNow
from entoptic.services.console.viewers import Viewers
from entoptic.services.ipc.addresses import Addresses
from entoptic.services.ipc.status import BridgeStatus, HostStatus, ProcessStatus, Status, WorkerStatus
from entoptic.services.ipc.status_poll import StatusPoll
from entoptic.services.settings import Settings
from entoptic.tracker_bridge.access import ClientKeys

STEP_S, STATUS_S = 0.05, 0.5


class Places(msgspec.Struct, frozen=True):
    """Where all is to be reached: a host says it, or it is given."""

    host_control: str | None = None
    addresses: Addresses | None = None
    bridge_keys: ClientKeys | None = None
    worker_keys: ClientKeys | None = None


class Live:
    """One session after the other. For one event loop, save for what says otherwise."""

    def __init__(self, places: Places, root: Path, pool: ThreadPoolExecutor) -> None:
        """Raises ControlError for an address that is none."""
        self.places = places
        self.viewers = Viewers()
        self.settings = Settings()
        """In force by the worker's word; while no session runs, those of the next one."""
        self.revision = 0
        """The worker's, of these settings."""
        self.observer: str | None = None
        self._root, self._pool = root, pool
        self._zero_s = time.monotonic()
        self._polls = dict(self._open_polls())
        self._feed: Feed | None = None
        self._pictures: Pictures | None = None
        self._figures = Figures()
        self._unreachable: str | None = None
        self._recording: tuple[str, float] | None = None
        """Its name, and when it was first seen."""
        self._loop: asyncio.AbstractEventLoop | None = None

    def _open_polls(self) -> Iterator[tuple[str, StatusPoll]]:
        places = self.places
        if places.host_control is not None:
            yield "host", StatusPoll(places.host_control)
        elif places.addresses is not None:
            yield "bridge", StatusPoll(places.addresses.bridge, places.bridge_keys)
            yield "worker", StatusPoll(places.addresses.worker, places.worker_keys)

    @property
    def hosted(self) -> bool:
        """Whether a host runs sessions."""
        return self.places.host_control is not None

    def _polled(self, name: str) -> Status | None:
        poll = self._polls.get(name)
        return None if poll is None or poll.is_silent else poll.status

    @property
    def host(self) -> HostStatus | None:
        """As it said last; None where it does not answer."""
        status = self._polled("host")
        return status if isinstance(status, HostStatus) else None

    @property
    def bridge(self) -> BridgeStatus | None:
        """The same of the bridge."""
        status = self.host.bridge if self.host is not None else self._polled("bridge")
        return status if isinstance(status, BridgeStatus) else None

    @property
    def worker(self) -> WorkerStatus | None:
        """The same of the worker."""
        status = self.host.worker if self.host is not None else self._polled("worker")
        return status if isinstance(status, WorkerStatus) else None

    @property
    def addresses(self) -> Addresses | None:
        """Of the session that runs."""
        return self.places.addresses or (self.host.addresses if self.host is not None else None)

    @property
    def running(self) -> bool:
        """Whether a session runs; bridge and worker that nobody hosts always do."""
        return not self.hosted or (self.host is not None and self.host.running)

    def kept(self) -> list[bytes]:
        """Traces and marks of the last seconds, for a page that comes."""
        return [] if self._feed is None else self._feed.kept()

    async def run(self) -> None:
        """Until cancelled."""
        self._loop = asyncio.get_running_loop()
        due_s = 0.0
        while True:
            for poll in self._polls.values():
                poll.step()
            await self._follow()
            for each in (self._feed, self._pictures):
                if each is not None and each.error is not None:
                    raise each.error
            if self.worker is not None:
                self.take_over(self.worker)
            if time.monotonic() >= due_s:
                due_s = time.monotonic() + STATUS_S
                if self.viewers.pages:
                    self.viewers.newest("status", protocol.encode(self.status()))
            await asyncio.sleep(STEP_S)

    def close(self) -> None:
        """Ends all; from any thread, when the loop has ended."""
        self._stop_reading()
        for poll in self._polls.values():
            poll.close()

    def _stop_reading(self) -> None:
        for each in (self._feed, self._pictures):
            if each is not None:
                each.close()
        self._feed = self._pictures = None

    async def _follow(self) -> None:
        """Reads what runs now."""
        addresses = self.addresses
        if addresses == (None if self._feed is None else self._feed.addresses):
            return
        assert self._loop is not None
        await self._loop.run_in_executor(self._pool, self._stop_reading)
        # What was wrong with the session that is over says nothing of the next one.
        self._figures, self._unreachable = Figures(), None
        if addresses is None:
            return
        places = self.places
        try:
            self._feed = Feed(addresses, self._zero_s, self._on_feed, places.bridge_keys, places.worker_keys)
            wanted, peak = self.viewers.wanted, self._peak_cd_m2
            self._pictures = Pictures(addresses.frames, wanted, self._on_picture, peak, places.worker_keys)
            self._figures = self._feed.figures
        except zmq.ZMQError as error:
            self._unreachable = f"An address cannot be connected to: {error.strerror}"

    def _peak_cd_m2(self) -> float:
        return self.settings.display.peak_cd_m2

    def _on_feed(self, messages: list[bytes]) -> None:
        """By the feed's thread."""
        if self.viewers.pages:
            self._from_thread(self.viewers.queue, messages)

    def _on_picture(self, kind: int, message: bytes) -> None:
        """By the pictures' thread."""
        self._from_thread(self.viewers.picture, kind, message)

    def _from_thread(self, call: Any, *arguments: Any) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            if self._loop is not None:
                self._loop.call_soon_threadsafe(call, *arguments)

    def take_over(self, worker: WorkerStatus) -> None:
        """The settings in force are the worker's; what it said before the newest change is old."""
        if worker.revision > self.revision:
            self.use(worker.settings, self.observer if worker.settings == self.settings else None, worker.revision)

    def use(self, settings: Settings, observer: str | None, revision: int | None = None) -> None:
        """These are in force now, or for the next session; all pages are told."""
        changed = (settings, observer) != (self.settings, self.observer)
        self.settings, self.observer = settings, observer
        self.revision = self.revision if revision is None else revision
        if changed:
            self.viewers.newest("settings", self.settings_message(None))

    def settings_message(self, because_of: int | None) -> bytes:
        """For a page."""
        return protocol.encode(protocol.SettingsNow(msgspec.to_builtins(self.settings), self.observer, because_of))

    def snapshot(self) -> Snapshot:
        """All that is known now, to find what is wrong."""
        figures, now_s = self._figures, time.monotonic()
        latency = figures.latency()
        return Snapshot(
            hosted=self.hosted,
            host=self.host,
            bridge=self.bridge,
            worker=self.worker,
            silent_s={name: poll.silent_s for name, poll in self._polls.items() if poll.is_silent},
            lost_s=figures.lost_s(now_s),
            states_silent_s=None if figures.state_s is None else now_s - figures.state_s,
            frames_silent_s=None if figures.shown_s is None else now_s - figures.shown_s,
            dropped_share=figures.dropped_share(now_s),
            unreachable=self._unreachable,
            latency_p95_ms=None if latency is None else latency.p95_ms,
            free_bytes=_free_bytes(self._root),
        )

    def status(self) -> StatusNow:
        """For the pages."""
        host, bridge, worker = self.host, self.bridge, self.worker
        running = self.running and any(one is not None for one in (host, bridge, worker))
        folder = host.recording if host is not None else worker.recording if worker is not None else None
        return StatusNow(
            running=running,
            host=None if host is None else replace(host, bridge=None, worker=None),
            bridge=bridge,
            worker=worker,
            processes=tuple(self._processes()),
            recording=self._recording_now(name_of(folder)),
            recording_s=None if self._recording is None else round(time.monotonic() - self._recording[1], 1),
            finishing=name_of(host.finishing) if host is not None else None,
            last_recording=name_of(host.last_recording) if host is not None else None,
            states_hz=self._figures.states_hz(time.monotonic()),
            latency=self._figures.latency() if running else None,
            pages=len(self.viewers),
            problems=problems(self.snapshot()),
        )

    def _recording_now(self, name: str | None) -> str | None:
        if name is None:
            self._recording = None
        elif self._recording is None or self._recording[0] != name:
            self._recording = (name, time.monotonic())
        return name

    def _processes(self) -> Iterator[ProcessStatus]:
        if self.host is not None:
            yield from self.host.processes.values()
        for name, poll in self._polls.items():
            if name != "host":
                state = "silent" if poll.is_silent else "starting" if poll.status is None else "running"
                yield ProcessStatus(name, state=state)  # type: ignore[arg-type]


def _free_bytes(root: Path) -> int | None:
    for folder in (root, *root.absolute().parents):
        with contextlib.suppress(OSError):
            return shutil.disk_usage(folder).free
    return None
