"""What a page asks for, done."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from msgspec.structs import replace

from entoptic.errors import EntopticError
from entoptic.services import settings as settings_file
from entoptic.services.calibration.page import Screens
from entoptic.services.config import CalibrationConfig
from entoptic.services.console import listing, requests
from entoptic.services.console.live import Live
from entoptic.services.console.protocol import PERCEIVED, Replied
from entoptic.services.console.viewers import Page
from entoptic.services.ipc import requests as ipc
from entoptic.services.ipc.addresses import Addresses
from entoptic.services.ipc.client import PATIENCE_MS, Client, Reply
from entoptic.services.ipc.status import WorkerStatus, status_of
from entoptic.services.settings import Settings, changed
from entoptic.tracker_bridge.access import ClientKeys

HOST_PATIENCE_MS = 15_000
"""It looks at all that a session names before it replies."""
Answer = TypeVar("Answer")


class Folders(msgspec.Struct, frozen=True):
    """Where things lie."""

    root: Path
    """Sessions."""
    observers: Path
    inputs: Path | None
    """Scenes and recordings to choose from."""


class Refused(Exception):
    """A request is not done: the message says why, and what to do."""

    def __init__(self, why: str, data: Any = None) -> None:
        super().__init__(why)
        self.data = data


class Actions:
    """For one event loop; what takes time is done by a pool of threads."""

    def __init__(self, live: Live, folders: Folders, pool: ThreadPoolExecutor, screens: Screens) -> None:
        self._live, self._folders, self._pool, self._screens = live, folders, pool, screens
        self._changing = asyncio.Lock()
        """Settings are changed by one page after the other."""

    async def do(self, numbered: requests.Numbered, page: Page) -> Replied:
        """Never raises: an error is a reply."""
        try:
            reply = await self._do(numbered.request, numbered.id, page)
        except (EntopticError, OSError, ValueError, msgspec.ValidationError) as error:
            reply = Reply(False, str(error))
        except Refused as refused:
            reply = Reply(False, str(refused), refused.data)
        return Replied(numbered.id, reply.done, reply.reply, reply.data)

    async def _do(self, request: requests.Request, number: int, page: Page) -> Reply:
        live, folders = self._live, self._folders
        match request:
            case requests.Watch():
                wanted = enumerate((request.perceived, request.displayed), PERCEIVED)
                page.kinds = frozenset(kind for kind, is_wanted in wanted if is_wanted)
                live.viewers.note()
                return Reply(True, "seen")
            case ipc.StartSession():
                return await self._host(replace(request, config=replace(request.config, settings=live.settings)))
            case requests.CalibratePupils():
                return await self._calibrate(request)
            case requests.StartScreens():
                if not await self._screens.start():
                    raise Refused("no display is there: open the page of the screens first")
                return Reply(True, "the screens begin")
            case requests.ChangeSettings(changes, from_defaults):
                change = lambda now: changed(now, changes, from_defaults=from_defaults)  # noqa: E731
                return await self._change(change, None, number, page)
            case requests.SaveObserver():
                return await self._save(request, number, page)
            case requests.LoadObserver(name):
                loaded = await self._aside(lambda: listing.load_observer(folders.observers, name))
                return await self._change(lambda _: loaded, name, number, page)
            case requests.List(what):
                where = {"root": folders.root, "observers": folders.observers, "inputs": folders.inputs}
                found = await self._aside(lambda: listing.listed(what, **where))  # type: ignore[arg-type]
                return Reply(True, f"{len(found)} {what}", found)
            case _ if isinstance(request, requests.OF_HOST):
                return await self._host(request)
            case _:
                return await self._bridge(request)

    async def _change(
        self, change: Callable[[Settings], Settings], observer: str | None, number: int, page: Page
    ) -> Reply:
        """Of the settings in force, which are the worker's."""
        live, keys = self._live, self._live.places.worker_keys
        async with self._changing:
            if (addresses := self._running()) is None:
                live.use(change(live.settings), observer)
                reply = Reply(True, "These settings are for the next session.")
            else:
                status_reply = await self._ask(addresses.worker, ipc.GiveStatus(), keys)
                if isinstance(status := status_of(status_reply.data), WorkerStatus):
                    live.take_over(status)
                new = change(live.settings)
                reply = await self._ask(addresses.worker, ipc.ChangeSettings(new), keys)
                if reply.done:
                    live.use(new, observer, reply.data)
            if reply.done:
                page.newest("settings", live.settings_message(number))
        return reply

    async def _save(self, request: requests.SaveObserver, number: int, page: Page) -> Reply:
        path = listing.path_of(self._folders.observers, request.name)
        if path.exists() and not request.overwrite:
            raise Refused(f"{request.name} is there already: choose another name, or overwrite it", {"exists": True})
        settings = self._live.settings

        def write() -> None:
            path.parent.mkdir(parents=True, exist_ok=True)
            settings_file.write(path, settings)

        await self._aside(write)
        if self._live.settings == settings:
            self._live.use(settings, request.name)
            page.newest("settings", self._live.settings_message(number))
        return Reply(True, f"saved as {path}", {"path": str(path)})

    async def _calibrate(self, request: requests.CalibratePupils) -> Reply:
        folder = (self._folders.observers / listing.PUPIL_MAPS).resolve()
        await self._aside(lambda: folder.mkdir(parents=True, exist_ok=True))
        out = folder / f"{request.name or f'{datetime.now():%Y-%m-%d_%H-%M-%S}'}.toml"
        if out.exists() and not request.overwrite:
            raise Refused(f"{out.stem} is there already: choose another name, or overwrite it", {"exists": True})
        how = {name: getattr(request, name) for name in CalibrationConfig.__struct_fields__}
        return replace(await self._bridge(ipc.CalibratePupils(str(out), **how)), data={"pupil_map": str(out)})

    def _running(self) -> Addresses | None:
        """Where a session runs; None while none does."""
        return self._live.addresses if self._live.running else None

    async def _host(self, request: msgspec.Struct) -> Reply:
        control = self._live.places.host_control
        if control is None:
            raise Refused("bridge and worker run by themselves here: start and stop them where they were started")
        return await self._ask(control, request, None, HOST_PATIENCE_MS)

    async def _bridge(self, request: msgspec.Struct) -> Reply:
        if (addresses := self._running()) is None:
            raise Refused("no session runs: start one first")
        return await self._ask(addresses.bridge, request, self._live.places.bridge_keys)

    @staticmethod
    async def _ask(
        address: str, request: msgspec.Struct, keys: ClientKeys | None, patience_ms: int = PATIENCE_MS
    ) -> Reply:
        with Client(address, keys) as client:
            return await client.ask_async(request, patience_ms)

    async def _aside(self, work: Callable[[], Answer]) -> Answer:
        return await asyncio.get_running_loop().run_in_executor(self._pool, work)
