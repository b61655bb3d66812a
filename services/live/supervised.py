"""A process that is kept running: started, listened to, started again where it crashes (supervision.py says when)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import Any, Literal

import msgspec

from entoptic.services.ipc.status import Gap, Problem, ProcessStatus, problem
from entoptic.services.live.children import Child
from entoptic.services.live.journal import Journal
from entoptic.services.live.supervision import Restarts

State = Literal["starting", "running", "restarting", "stopped", "failed"]


class Supervised:
    """One process of a session, through all its lives. `step` it now and then; nothing here waits."""

    def __init__(
        self,
        name: str,
        config: Callable[[], msgspec.Struct],
        ready_event: str,
        journal: Journal,
        on_message: Callable[[dict[str, Any]], None] = lambda message: None,
    ) -> None:
        """`config` is asked for at each start; `ready_event` is what it logs when it is ready."""
        self.name, self.state = name, "stopped"
        self.restarts = Restarts()
        self.restarts_count = 0
        self.last_error: str | None = None
        self.gaps: list[Gap] = []
        self.ended: dict[str, Any] | None = None
        """What it said when it ended by itself, all done."""
        self._config, self._ready_event = config, ready_event
        self._journal, self._on_message = journal, on_message
        self._child: Child | None = None
        self._error: str | None = None
        self._ready_at_s: float | None = None
        self._start_at_s = 0.0
        self._kill_at_s: float | None = None

    state: State

    @property
    def pid(self) -> int | None:
        """Of the one that lives."""
        return None if self._child is None else self._child.pid

    @property
    def is_ready(self) -> bool:
        """Whether it can do its work."""
        return self.state == "running"

    @property
    def lives(self) -> bool:
        """Whether there is a process now."""
        return self._child is not None

    def start(self) -> None:
        """Starts it for the first time, or again."""
        again = self.state == "restarting"
        self._error, self._ready_at_s = None, None
        self._child = Child(self.name, self._config())
        self.state = "restarting" if again else "starting"
        self._journal.say("started", child=self.name, child_pid=self._child.pid, again=again)

    def step(self) -> bool:
        """Listens and looks; whether it has just been started again."""
        if self._child is None:
            if self.state == "restarting" and time.monotonic() >= self._start_at_s:
                self.start()
                self.restarts_count += 1
                return True
            return False
        # Asked first and read after, so that nothing said before the end is missed.
        code = self._child.code()
        ended = None
        for message in self._child.drain():
            self._journal.add(message)
            self._error = message.get("error", self._error) if message.get("level") == "error" else self._error
            if message["event"] == self._ready_event:
                self._ready()
            if message["event"] == "ended":
                ended = message
            self._on_message(message)
        self.ended = ended or self.ended
        if code is not None:
            self._gone(code)
        elif self._kill_at_s is not None and time.monotonic() >= self._kill_at_s:
            self._kill_at_s = math.inf
            self._journal.say("killed", child=self.name, why="it did not stop in time")
            self._child.kill()
        return False

    def _ready(self) -> None:
        self._ready_at_s = self._ready_at_s or time.monotonic()
        if self.state in ("starting", "restarting"):
            self.state = "running"
        self._close_gap()

    def _close_gap(self) -> None:
        if self.gaps and self.gaps[-1].to_ns is None:
            last = self.gaps[-1]
            self.gaps[-1] = Gap(last.process, last.from_ns, time.monotonic_ns(), last.why)

    def _gone(self, code: int) -> None:
        assert self._child is not None
        child, self._child = self._child, None
        why = f"it ended by itself {child.ending(self._error)}"
        now_s = time.monotonic()
        if child.output and code != 0:
            self._journal.say("output", child=self.name, lines=child.output)
        child.end(0.0)
        if self._kill_at_s is not None or (code == 0 and self.ended is not None):
            self.state = "stopped"
            self._journal.say("stopped", child=self.name, code=code)
            return
        self.last_error = why
        worked_s = None if self._ready_at_s is None else now_s - self._ready_at_s
        self.restarts = self.restarts.crashed(now_s, now_s - child.started_s, worked_s)
        if not (self.gaps and self.gaps[-1].to_ns is None):
            self.gaps.append(Gap(self.name, time.monotonic_ns(), None, why))
        given_up = self.restarts.given_up
        self.state = "failed" if given_up else "restarting"
        self._start_at_s = time.monotonic() + self.restarts.delay_s
        self._journal.say("crashed", child=self.name, code=code, why=why, given_up=given_up)

    def stop(self, within_s: float) -> None:
        """Asks it to stop; it is ended by force after that time."""
        if self._child is None:
            self.state = "stopped" if self.state != "failed" else self.state
            return
        self._child.ask_to_stop()
        at_s = time.monotonic() + within_s
        self._kill_at_s = at_s if self._kill_at_s is None else min(self._kill_at_s, at_s)

    def kill(self) -> None:
        """Ends it by force, at once, and waits until it is gone."""
        if self._child is not None:
            self._child.end(0.0)
            self._child, self.state = None, "stopped"

    def status(self) -> ProcessStatus:
        """As of now."""
        return ProcessStatus(self.name, self.pid, self.state, self.restarts_count, self.last_error)

    def problems(self) -> Iterator[Problem]:
        """Whether it crashed."""
        if self.state == "restarting":
            yield problem(
                f"{self.name} restarting",
                "warning",
                f"The {self.name} crashed and is being started again: {self.last_error}",
                "Wait a moment. If it happens again and again, stop the session and look at its log",
            )
        elif self.state == "failed":
            yield problem(
                f"{self.name} failed",
                "error",
                f"The {self.name} crashed again and again and is not started any more: {self.last_error}",
                "Mend what it says, then start again",
            )
