"""The pages that watch, and what each of them is sent.

Theory of operation: everything is encoded once, whoever watches. A page has a queue for what must not be missing in
between, bounded in bytes, whose oldest part is given up first; a slot for the newest status, settings and picture of
each kind; and a task that sends what has gathered, as one text, every so often. That pace and the rate of pictures come
out of one budget for all pages: fifty cost hardly more than five. A page that takes nothing for PATIENCE_S is closed.
"""

from __future__ import annotations

import asyncio
import collections
import time
from collections.abc import Awaitable, Callable, Iterable

from entoptic.services.console import protocol
from entoptic.services.console.protocol import DISPLAYED, PERCEIVED

PATIENCE_S = 20.0
"""Longer than a tablet's browser sleeps between two looks at its sockets. Engineering choice."""
MOST_PAGES = 100
QUEUE_BYTES = 1_000_000
"""For each page: half a minute."""
TEXTS_A_S, TEXT_S = 150.0, 0.04
"""For all pages together; and from one to the next of a page at least."""
PICTURES_A_S, PICTURE_S, RAREST_S = 60.0, 1 / 15, 2.0
"""For all pages together, of both kinds; from one to the next of a kind at least, and at most."""


class Page:
    """One page. All methods are for the event loop."""

    def __init__(self, abort: Callable[[], None]) -> None:
        """`abort` ends its connection at once, whatever is still to be sent."""
        self.kinds = frozenset((PERCEIVED, DISPLAYED))
        """Of pictures, that it wants."""
        self._abort = abort
        self._queue: collections.deque[bytes] = collections.deque()
        self._bytes = 0
        self._newest: dict[str, bytes] = {}
        self._pictures: dict[int, bytes] = {}
        self._wake = asyncio.Event()
        self._last_words: bytes | None = None

    @property
    def waiting_bytes(self) -> int:
        """Of all that is kept for it."""
        return self._bytes + sum(map(len, (*self._newest.values(), *self._pictures.values())))

    def queue(self, messages: Iterable[bytes]) -> None:
        """What is not to be missing."""
        for message in messages:
            self._queue.append(message)
            self._bytes += len(message)
        while self._bytes > QUEUE_BYTES:
            self._bytes -= len(self._queue.popleft())
        self._wake.set()

    def newest(self, kind: str, message: bytes) -> None:
        """What replaces what there was of its kind."""
        self._newest[kind] = message
        self._wake.set()

    def picture(self, kind: int, message: bytes) -> None:
        """The same for pictures."""
        if kind in self.kinds:
            self._pictures[kind] = message
            self._wake.set()

    def end(self, bye: bytes) -> None:
        """Sends this and no more."""
        self._last_words = bye
        self._wake.set()

    async def send(
        self,
        text: Callable[[str], Awaitable[None]],
        data: Callable[[bytes], Awaitable[None]],
        pace_s: Callable[[], float],
        patience_s: float = PATIENCE_S,
    ) -> None:
        """Until its end is said or it takes nothing for too long."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            begun_s = time.monotonic()
            try:
                async with asyncio.timeout(patience_s):
                    if self._last_words is not None:
                        await text(protocol.together([*self._take(), self._last_words]))
                        return
                    if messages := self._take():
                        await text(protocol.together(messages))
                    while self._pictures:
                        await data(self._pictures.pop(min(self._pictures)))
            except TimeoutError:
                self._abort()
                return
            if self._last_words is None:
                await asyncio.sleep(max(begun_s + pace_s() - time.monotonic(), 0.0))

    def _take(self) -> list[bytes]:
        messages = [*self._queue, *self._newest.values()]
        self._queue.clear()
        self._newest.clear()
        self._bytes = 0
        return messages


class Viewers:
    """All pages. `wanted` alone is for other threads too."""

    def __init__(self) -> None:
        self.pages: set[Page] = set()
        self._wanted: dict[int, float] = {}

    def __len__(self) -> int:
        return len(self.pages)

    def add(self, page: Page) -> bool:
        """Whether there is room for it."""
        if len(self.pages) >= MOST_PAGES:
            return False
        self.pages.add(page)
        self.note()
        return True

    def remove(self, page: Page) -> None:
        """It is gone."""
        self.pages.discard(page)
        self.note()

    def note(self) -> None:
        """A page came, went or wants other pictures."""
        watching = {kind: sum(kind in page.kinds for page in self.pages) for kind in (PERCEIVED, DISPLAYED)}
        every_s = min(max(sum(watching.values()) / PICTURES_A_S, PICTURE_S), RAREST_S)
        self._wanted = {kind: every_s for kind, count in watching.items() if count}

    def wanted(self) -> dict[int, float]:
        """Which pictures somebody watches, and how many seconds there are from one to the next."""
        return self._wanted

    def pace_s(self) -> float:
        """From one text to the next, of a page."""
        return max(len(self.pages) / TEXTS_A_S, TEXT_S)

    def queue(self, messages: list[bytes]) -> None:
        """For all pages; nothing of it may be missing."""
        for page in self.pages:
            page.queue(messages)

    def newest(self, kind: str, message: bytes) -> None:
        """For all pages; the newest counts."""
        for page in self.pages:
            page.newest(kind, message)

    def picture(self, kind: int, message: bytes) -> None:
        """For those that want it."""
        for page in self.pages:
            page.picture(kind, message)

    def end(self, reason: str, *, again: bool) -> None:
        """All are told that this is the end."""
        bye = protocol.encode(protocol.Bye(reason, again))
        for page in self.pages:
            page.end(bye)
