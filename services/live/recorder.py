"""A recording that runs: bridge and worker are told of its folder, also those that are started again."""

from __future__ import annotations

import time
from pathlib import Path

from entoptic.services.ipc.client import Client, Context
from entoptic.services.ipc.requests import StartRecording, StopRecording
from entoptic.services.ipc.status import Problem, problem

ENDS_WITHIN_S = 60.0
"""A worker that compiles answers late; what it does not write in that time is not recorded."""


class Recorder:
    """Tells each process that a recording begins and ends. `step` it now and then; nothing here waits."""

    def __init__(self, context: Context, folder: Path, addresses: dict[str, str]) -> None:
        """`addresses` are the controls of the processes, by name."""
        self.folder = folder
        self.start_ns = time.monotonic_ns()
        """Zero of the tables' times."""
        self.problem: Problem | None = None
        self._context, self._addresses = context, addresses
        self._asked: dict[str, Client] = {}
        self._recording: set[str] = set()
        self._ends_at_s: float | None = None
        for name in addresses:
            self.tell(name)

    def tell(self, name: str) -> None:
        """Begins in a process that has just been started."""
        self.lost(name)
        if self._ends_at_s is None:
            self._ask(name, StartRecording(str(self.folder), self.start_ns))

    def lost(self, name: str) -> None:
        """A process is gone: no answer of it is awaited any more."""
        self._recording.discard(name)
        if (asked := self._asked.pop(name, None)) is not None:
            asked.close()

    def end(self) -> None:
        """The processes are to keep nothing any more."""
        if self._ends_at_s is None:
            self._ends_at_s = time.monotonic() + ENDS_WITHIN_S
            for name in tuple(self._recording):
                self._ask(name, StopRecording())

    def step(self) -> None:
        """Takes answers."""
        for name, asked in tuple(self._asked.items()):
            request = asked.request
            if (reply := asked.poll()) is None:
                continue
            asked.close()
            del self._asked[name]
            if isinstance(request, StartRecording) and reply.done:
                self._recording.add(name)
                if self._ends_at_s is not None:
                    self._ask(name, StopRecording())
            elif isinstance(request, StopRecording):
                self._recording.discard(name)
            if not reply.done:
                self.problem = problem(
                    f"{name} records nothing",
                    "error",
                    f"The {name} records nothing: {reply.reply}",
                    "Mend it, then record again",
                )

    @property
    def is_over(self) -> bool:
        """Whether all processes ended it, or had their time for it."""
        return self._ends_at_s is not None and (not self._asked or time.monotonic() > self._ends_at_s)

    @property
    def is_ending(self) -> bool:
        """Whether it was asked to end."""
        return self._ends_at_s is not None

    def close(self) -> None:
        """Awaits nothing any more."""
        for name in tuple(self._asked):
            self.lost(name)

    def _ask(self, name: str, request: StartRecording | StopRecording) -> None:
        self._asked[name] = Client(self._addresses[name], context=self._context)
        self._asked[name].send(request)
