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
from entoptic.services.console import listing, requests
from entoptic.services.console.live import Live
from entoptic.services.console.protocol import PERCEIVED, Replied
from entoptic.services.console.viewers import Page
from entoptic.services.ipc import requests as asked
from entoptic.services.ipc.addresses import Addresses
from entoptic.services.ipc.client import PATIENCE_MS, Client
from entoptic.services.settings import Settings, changed
from entoptic.tracker_bridge.access import ClientKeys

HOST_PATIENCE_MS = 15_000
"""It looks at all that a choice names before it answers."""
_TOLD = {
    requests.StopCalibratingPupils: asked.StopCalibratingPupils,
    requests.CalibrateGaze: asked.StartCalibration,
    requests.StopCalibratingGaze: asked.StopCalibration,
    requests.StopRecordTracker: asked.StopRecording,
}
"""Requests that a bridge is told as they are."""
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

    async def do(self, request: requests.Request, page: Page) -> Replied:
        """Never raises: an error is a reply."""
        try:
            reply = await self._do(request, page)
        except (EntopticError, OSError, ValueError, msgspec.ValidationError) as error:
            return Replied(request.id, False, str(error))
        except Refused as refused:
            return Replied(request.id, False, str(refused), refused.data)
        return Replied(request.id, reply.done, reply.reply, reply.data)

    async def _do(self, request: requests.Request, page: Page) -> Replied:
        match request:
            case requests.Watch():
                page.kinds = frozenset(
                    kind for kind, wanted in enumerate((request.perceived, request.displayed), PERCEIVED) if wanted
                )
                self._live.viewers.note()
                return _done("seen")
            case requests.Start():
                return await self._start(request)
            case requests.Stop():
                return await self._host(asked.StopSession())
            case requests.Record():
                return await self._host(asked.Record(request.name))
            case requests.StopRecord():
                return await self._host(asked.StopRecord())
            case requests.CalibratePupils():
                return await self._calibrate(request)
            case requests.StartScreens():
                if not await self._screens.start():
                    raise Refused("no display is there: open the page of the screens first")
                return _done("the screens begin")
            case requests.RecordTracker():
                return await self._bridge(asked.StartRecording(request.name))
            case requests.Perceive():
                return await self._perceive(
                    lambda now: changed(now, request.changes, from_defaults=request.from_defaults), None, request, page
                )
            case requests.SaveObserver():
                return await self._save(request, page)
            case requests.LoadObserver():
                folder, name = self._folders.observers, request.name
                loaded = await self._aside(lambda: listing.load_observer(folder, name))
                return await self._perceive(lambda _: loaded, name, request, page)
            case requests.List():
                folders = self._folders
                found = await self._aside(
                    lambda: listing.listed(
                        request.what, root=folders.root, observers=folders.observers, inputs=folders.inputs
                    )
                )
                return _done(f"{len(found)} {request.what}", found)
            case _:
                return await self._bridge(_TOLD[type(request)]())

    async def _start(self, request: requests.Start) -> Replied:
        settings = self._live.settings
        replied = await self._host(asked.StartSession(replace(request.config, settings=settings)))
        if replied.done:
            self._live.begins(settings)
        return replied

    async def _perceive(
        self, settings: Callable[[Settings], Settings], observer: str | None, request: requests.Request, page: Page
    ) -> Replied:
        live = self._live
        async with self._changing:
            addresses = self._running()
            if addresses is not None:
                await live.learn_settings(addresses)
            new = settings(live.settings)
            replied = _done("These settings are for the next session.")
            if addresses is not None:
                perceive = asked.Perceive(msgspec.to_builtins(new))
                replied = await self._ask(addresses.worker, perceive, live.places.worker_keys)
            if replied.done:
                live.use(new, observer)
                page.newest("settings", live.settings_message(request.id))
        return replied

    async def _save(self, request: requests.SaveObserver, page: Page) -> Replied:
        path = listing.path_of(self._folders.observers, request.name)
        if path.exists() and not request.overwrite:
            raise Refused(f"{request.name} is there already: choose another name, or overwrite it", {"exists": True})
        settings = self._live.settings

        def write() -> None:
            path.parent.mkdir(parents=True, exist_ok=True)
            settings_file.write(path, settings)

        await self._aside(write)
        if self._live.settings is settings:
            self._live.use(settings, request.name)
            page.newest("settings", self._live.settings_message(request.id))
        return _done(f"kept as {path}", {"path": str(path)})

    async def _calibrate(self, request: requests.CalibratePupils) -> Replied:
        folder = (self._folders.observers / listing.PUPIL_MAPS).resolve()
        await self._aside(lambda: folder.mkdir(parents=True, exist_ok=True))
        out = folder / f"{request.name or f'{datetime.now():%Y-%m-%d_%H-%M-%S}'}.toml"
        if out.exists() and not request.overwrite:
            raise Refused(f"{out.stem} is there already: choose another name, or overwrite it", {"exists": True})
        wish = asked.CalibratePupils(
            str(out), request.protocol, request.white_s, request.black_s, request.eyes, request.map_mm
        )
        return replace(await self._bridge(wish), data={"pupil_map": str(out)})

    def _running(self) -> Addresses | None:
        """Where a session runs; None while none does."""
        return self._live.addresses if self._live.snapshot().running else None

    async def _host(self, request: msgspec.Struct) -> Replied:
        control = self._live.places.host_control
        if control is None:
            raise Refused("bridge and worker run by themselves here: start and stop them where they were started")
        return await self._ask(control, request, None, HOST_PATIENCE_MS)

    async def _bridge(self, request: msgspec.Struct) -> Replied:
        if (addresses := self._running()) is None:
            raise Refused("no session runs: start one first")
        return await self._ask(addresses.bridge, request, self._live.places.bridge_keys)

    async def _ask(
        self, address: str, request: msgspec.Struct, keys: ClientKeys | None, patience_ms: int = PATIENCE_MS
    ) -> Replied:
        with Client(address, keys) as client:
            reply = await client.ask_async(request, patience_ms)
        return Replied(None, reply.done, reply.reply, reply.data)

    async def _aside(self, work: Callable[[], Answer]) -> Answer:
        return await asyncio.get_running_loop().run_in_executor(self._pool, work)


def _done(reply: str, data: Any = None) -> Replied:
    return Replied(None, True, reply, data)
