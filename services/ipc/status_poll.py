"""The status of a process, asked for twice a second."""

from __future__ import annotations

import contextlib
import time

from entoptic.services.ipc.client import Client, Context, ControlError
from entoptic.services.ipc.requests import GiveStatus
from entoptic.services.ipc.status import Status, status_of
from entoptic.tracker_bridge.access import ClientKeys

PERIOD_S = 0.5
PATIENCE_S = 1.5
"""Engineering choice: a process that renders answers from a thread of its own."""
SILENT_S = 3.0
"""Without a reply for as long a process is taken for gone. Engineering choice: two requests."""


class StatusPoll:
    """One process. `step` it often; nothing here waits. Raises ControlError for an address that is none."""

    def __init__(self, address: str, keys: ClientKeys | None = None, context: Context | None = None) -> None:
        self.address = address
        self.status: Status | None = None
        """As it said last."""
        self._client = Client(address, keys, context)
        self._answered_s = time.monotonic()
        self._due_s = 0.0

    def step(self) -> None:
        """Takes a reply, and asks where that is due."""
        now_s = time.monotonic()
        with contextlib.suppress(ControlError):
            if (reply := self._client.poll()) is not None and (status := status_of(reply.data)) is not None:
                self.status, self._answered_s = status, now_s
        if now_s >= self._due_s and (self._client.request is None or now_s - self._client.sent_s > PATIENCE_S):
            self._due_s = now_s + PERIOD_S
            self._client.send(GiveStatus())

    @property
    def silent_s(self) -> float:
        """Since the last reply, or since `excuse`."""
        return time.monotonic() - self._answered_s

    @property
    def is_silent(self) -> bool:
        """Whether the last reply is too old."""
        return self.silent_s > SILENT_S

    def excuse(self) -> None:
        """It cannot answer now: the silence counts from here."""
        self._answered_s = time.monotonic()

    def close(self) -> None:
        """Asks no more."""
        self._client.close()
