"""What the console knows of a session, from whatever runs it; kept up to date, and told to all pages twice a second."""

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

from entoptic.services.console import protocol
from entoptic.services.console.feed import Feed, name_of
from entoptic.services.console.figures import Figures
from entoptic.services.console.pictures import Pictures
from entoptic.services.console.problems import problems
from entoptic.services.console.protocol import Process, Status
from entoptic.services.console.status import SILENT_S, BridgeSays, HostSays, Snapshot, Watched, WorkerSays, read
from entoptic.services.console.viewers import Viewers
from entoptic.services.ipc.addresses import Addresses
from entoptic.services.ipc.client import Client
from entoptic.services.ipc.requests import GiveStatus
from entoptic.services.settings import Settings
from entoptic.tracker_bridge.access import ClientKeys

TICK_S = 0.5
SETTLED_S = 15.0
"""Settings that were sent so long ago are in force, or never will be: what the worker says is right then. Engineering
choice: a frame for which code is compiled takes ten seconds."""


class Places(msgspec.Struct, frozen=True):
    """Where all is to be reached: a host says it, or it is given."""

    host_control: str | None = None
    addresses: Addresses | None = None
    bridge_keys: ClientKeys | None = None
    worker_keys: ClientKeys | None = None


class Live:
    """One session after the other. For one event loop, save for what says otherwise."""

    def __init__(self, places: Places, root: Path, pool: ThreadPoolExecutor) -> None:
        self.places = places
        self.viewers = Viewers()
        self.settings = Settings()
        """Those in force, as far as is known here."""
        self.observer: str | None = None
        self._root, self._pool = root, pool
        self._zero_s = time.monotonic()
        self._host = Watched(None)
        self._bridge = Watched(places.bridge_keys)
        self._worker = Watched(places.worker_keys)
        self._feed: Feed | None = None
        self._pictures: Pictures | None = None
        self._figures = Figures()
        self._trouble: str | None = None
        self._take: tuple[str, float] | None = None
        """Its name, and when it was first seen."""
        self._session: tuple[str, float] | None = None
        """When it began by the host's word, and when it was first seen here."""
        self._knows_settings = False
        """Whether those here are the session's: its worker said so, or it was started here."""
        self._own_begins = False
        """Whether the next session is one that was started here: its settings may have changed since."""
        self._used_s = 0.0
        """When settings were last changed here."""
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def hosted(self) -> bool:
        """Whether a host runs sessions."""
        return self.places.host_control is not None

    @property
    def host(self) -> HostSays | None:
        """What it last said."""
        return read(self._host.data, HostSays)

    @property
    def addresses(self) -> Addresses | None:
        """Of the session that runs."""
        if self.places.addresses is not None:
            return self.places.addresses
        host = self.host
        return host.places if host is not None else None

    def kept(self) -> list[bytes]:
        """Traces and marks of the last seconds, for a page that comes."""
        return [] if self._feed is None else self._feed.kept()

    async def run(self) -> None:
        """Until cancelled."""
        self._loop = asyncio.get_running_loop()
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._host.watch(lambda: self.places.host_control))
            tasks.create_task(self._bridge.watch(lambda: self.addresses.bridge if self.addresses else None))
            tasks.create_task(self._worker.watch(lambda: self.addresses.worker if self.addresses else None))
            tasks.create_task(self._tick())

    def close(self) -> None:
        """Ends all; from any thread, when the loop has ended."""
        self._stop_reading()

    def _stop_reading(self) -> None:
        for each in (self._feed, self._pictures):
            if each is not None:
                each.close()
        self._feed = self._pictures = None

    async def _tick(self) -> None:
        while True:
            await self._follow()
            for each in (self._feed, self._pictures):
                if each is not None and each.error is not None:
                    raise each.error
            self._take_over_settings()
            if self.viewers.pages:
                self.viewers.newest("status", protocol.encode(self.status()))
            await asyncio.sleep(TICK_S)

    async def _follow(self) -> None:
        """Reads what runs now."""
        addresses = self.addresses
        if addresses == (None if self._feed is None else self._feed.addresses):
            return
        assert self._loop is not None
        await self._loop.run_in_executor(self._pool, self._stop_reading)
        # What was wrong with the session that is over says nothing of the next one.
        self._figures, self._trouble = Figures(), None
        if addresses is None:
            return
        places = self.places
        try:
            self._feed = Feed(addresses, self._zero_s, self._hear, places.bridge_keys, places.worker_keys)
            wanted, peak = self.viewers.wanted, self._peak_cd_m2
            self._pictures = Pictures(addresses.frames, wanted, self._hear_picture, peak, places.worker_keys)
            self._figures = self._feed.figures
        except zmq.ZMQError as error:
            self._trouble = f"an address cannot be connected to: {error.strerror}"

    def _peak_cd_m2(self) -> float:
        return self.settings.display.peak_cd_m2

    def _hear(self, messages: list[bytes]) -> None:
        """By the feed's thread."""
        if self.viewers.pages:
            self._from_thread(self.viewers.queue, messages)

    def _hear_picture(self, kind: int, message: bytes) -> None:
        """By the pictures' thread."""
        self._from_thread(self.viewers.picture, kind, message)

    def _from_thread(self, call: Any, *arguments: Any) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            if self._loop is not None:
                self._loop.call_soon_threadsafe(call, *arguments)

    def _take_over_settings(self) -> None:
        """Those of a session that somebody else started, or that was there before this server."""
        host = self.host
        began = host.started if host is not None else None if self.hosted else "before"
        if began is None or (host is not None and not host.running):
            return
        if self._session is None or self._session[0] != began:
            self._session = began, time.monotonic()
            self._knows_settings, self._own_begins = self._own_begins, False
            if not self._knows_settings and host is not None and host.config is not None:
                self._adopt(host.config.get("settings"))
        # What a worker said before may be of the session before.
        if self._worker.heard_s > self._session[1]:
            self._hear_worker(self._worker.data)

    async def learn_settings(self, addresses: Addresses) -> None:
        """Before they are changed: asks the worker if it has not said yet what is in force. Raises ControlError."""
        self._take_over_settings()
        if not self._knows_settings:
            said = await Client(addresses.worker, self.places.worker_keys).ask_async(GiveStatus())
            self._hear_worker(said.data)

    def _hear_worker(self, data: dict[str, Any] | None) -> None:
        """Takes over the settings that it says are in force, but not while it may not have heard of newer ones."""
        worker = read(data, WorkerSays)
        if worker is None:
            return
        if not self._knows_settings or (not worker.preparing and time.monotonic() - self._used_s > SETTLED_S):
            self._adopt(worker.settings)
        self._knows_settings = True

    def _adopt(self, said: dict[str, Any] | None) -> None:
        with contextlib.suppress(msgspec.ValidationError):
            if said and (settings := msgspec.convert(said, Settings)) != self.settings:
                self.use(settings, None)

    def begins(self, settings: Settings) -> None:
        """A session was started here, with these settings."""
        self._own_begins = True
        if settings != self.settings:
            self.use(settings, None)

    def use(self, settings: Settings, observer: str | None) -> None:
        """These are in force now; all pages are told."""
        self.settings, self.observer, self._used_s = settings, observer, time.monotonic()
        self.viewers.newest("settings", self.settings_message(None))

    def settings_message(self, because_of: int | None) -> bytes:
        """For a page."""
        values = msgspec.to_builtins(self.settings)
        return protocol.encode(protocol.SettingsNow(values, self.observer, because_of))

    def snapshot(self) -> Snapshot:
        """All that is known now."""
        figures, now_s = self._figures, time.monotonic()
        latency = figures.latency()
        return Snapshot(
            hosted=self.hosted,
            host=self.host if self.hosted else None,
            bridge=read(self._bridge.data, BridgeSays),
            worker=read(self._worker.data, WorkerSays),
            host_silent_s=self._host.silent_s,
            bridge_silent_s=self._bridge.silent_s,
            worker_silent_s=self._worker.silent_s,
            lost_s=figures.lost_s(now_s),
            states_silent_s=None if figures.state_s is None else now_s - figures.state_s,
            frames_silent_s=None if figures.shown_s is None else now_s - figures.shown_s,
            dropped_share=figures.dropped_share(now_s),
            trouble=self._trouble or (figures.shown.trouble if figures.shown is not None else None),
            latency_p95_ms=None if latency is None else latency.p95_ms,
            free_bytes=_free_bytes(self._root),
        )

    def status(self) -> Status:
        """For the pages."""
        now = self.snapshot()
        host, bridge, worker = now.host, now.bridge or BridgeSays(), now.worker or WorkerSays()
        config = host.config if host is not None and host.config is not None else {}
        figures, shown = self._figures, self._figures.shown if now.running and now.worker is not None else None
        folder = host.folder if host is not None else shown.take if shown is not None else None
        take = self._take_now(name_of(folder))
        return Status(
            running=now.running and (now.bridge is not None or now.worker is not None or host is not None),
            preparing=now.worker is not None and worker.preparing,
            source=bridge.source or config.get("eyes", {}).get("source"),
            scene=worker.scene or config.get("view", {}).get("scene"),
            config=config or None,
            started=host.started if host is not None else None,
            sample_rate_hz=bridge.rate_hz,
            states_hz=figures.states_hz(time.monotonic()),
            clock_uncertainty_ms=bridge.clock_uncertainty_ms,
            late_samples=bridge.late_samples,
            silent=bridge.silent,
            fps=worker.fps,
            reached_fps=worker.reached_fps,
            dropped=worker.dropped,
            budget_ms=shown.budget_ms if shown is not None else self.settings.plan.budget_ms,
            latency=figures.latency() if now.running else None,
            processes=tuple(_processes(now)),
            take=take,
            take_s=None if self._take is None else round(time.monotonic() - self._take[1], 1),
            finishing=name_of(host.finishing) if host is not None else None,
            last_take=name_of(host.last_folder) if host is not None else None,
            calibrating=bridge.calibrating,
            calibrated=bridge.calibrated,
            pages=len(self.viewers),
            problems=problems(now),
            root=host.root if host is not None else None,
            state=host.state if host is not None else None,
        )

    def _take_now(self, name: str | None) -> str | None:
        if name is None:
            self._take = None
        elif self._take is None or self._take[0] != name:
            self._take = (name, time.monotonic())
        return name


def _processes(now: Snapshot) -> Iterator[Process]:
    known = now.host.processes if now.host is not None else {}
    for name, one in known.items():
        yield Process(name, one.state, one.restarts, one.last_error)
    for name, said, silent_s in (
        ("bridge", now.bridge, now.bridge_silent_s),
        ("worker", now.worker, now.worker_silent_s),
    ):
        if name not in known and not now.hosted:
            state = "running" if said is not None else "silent" if silent_s > SILENT_S else "starting"
            yield Process(name, state)


def _free_bytes(root: Path) -> int | None:
    for folder in (root, *root.absolute().parents):
        with contextlib.suppress(OSError):
            return shutil.disk_usage(folder).free
    return None
