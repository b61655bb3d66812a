"""A whole session: bridge and worker as two processes, their progress, their failures, and what they leave.

Theory of operation: each process writes its log to standard error, a JSON object a line; this one reads both. A
process is asked to stop by closing its standard input, so it stops too if this one dies. All results are written into
a folder beside the final one, which takes its name only when they are whole.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from services.process import Stop

SUMMARY = "summary.json"
READY_WITHIN_S = 60.0
STOPS_WITHIN_S = 10.0
"""An encoder may have frames to flush; after that a process is ended by force."""


class SessionError(Exception):
    """A session failed: the message names the process and what it said."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of a session."""

    bridge: dict[str, Any]
    """What the bridge said when it ended."""
    worker: dict[str, Any]
    """What the worker said when it ended."""
    interrupted: bool


class _Child:
    """One process of a session."""

    def __init__(self, name: str, arguments: Sequence[str]) -> None:
        self.name = name
        self.messages: queue.Queue[dict[str, Any]] = queue.Queue()
        self._spoken: list[str] = []
        self._process = subprocess.Popen(
            [sys.executable, "-m", "services.cli", *arguments, "--child"],
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
            encoding="utf-8",
            start_new_session=True,  # Ctrl-C reaches the session alone, which then asks its processes to stop.
        )
        self._reader = threading.Thread(target=self._read, name=f"{name}-log", daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            try:
                message = json.loads(line)
                self.messages.put(message)
            except (ValueError, TypeError):
                self._spoken = [*self._spoken[-19:], line.rstrip()]

    def drain(self) -> Iterator[dict[str, Any]]:
        """The messages that have come since the last call."""
        with contextlib.suppress(queue.Empty):
            while True:
                yield self.messages.get_nowait()

    def code(self) -> int | None:
        """Its exit status, None while it runs. All it said is read by then."""
        code = self._process.poll()
        if code is not None:
            self._reader.join()
        return code

    def failure(self, said: str | None) -> SessionError:
        """Why it failed, in its own words."""
        spoken = said or (self._spoken[-1] if self._spoken else "it said nothing")
        return SessionError(f"the {self.name} failed (exit status {self._process.returncode}): {spoken}")

    def ask_to_stop(self) -> None:
        """Closes its standard input."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()

    def end(self) -> None:
        """Waits for it to stop, then ends it by force."""
        self.ask_to_stop()
        try:
            self._process.wait(STOPS_WITHIN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        assert self._process.stderr is not None
        self._process.stderr.close()


def run(bridge_arguments: Sequence[str], worker_arguments: Sequence[str], stop: Stop, console: Console) -> Outcome:
    """Runs both processes to their end, or until asked to stop. Raises SessionError; leaves no process behind."""
    with contextlib.ExitStack() as children:
        bridge = _Child("bridge", ["bridge", *bridge_arguments])
        children.callback(bridge.end)
        ready = _wait_for_ready(bridge, stop)
        if ready is None:
            return Outcome({}, {}, interrupted=True)
        addresses = ["--states", ready["states"], "--events", ready["events"]]
        worker = _Child("worker", ["worker", *addresses, *worker_arguments])
        children.callback(worker.end)
        return _watch(bridge, worker, stop, console)


def _wait_for_ready(bridge: _Child, stop: Stop) -> dict[str, Any] | None:
    deadline, said = time.monotonic() + READY_WITHIN_S, None
    while not stop():
        ended = bridge.code() is not None
        for message in bridge.drain():
            if message["event"] == "ready":
                return message
            said = message.get("error", said)
        if ended or time.monotonic() > deadline:
            raise bridge.failure(said)
        time.sleep(0.02)
    return None


def _watch(bridge: _Child, worker: _Child, stop: Stop, console: Console) -> Outcome:
    endings: dict[str, dict[str, Any]] = {"bridge": {}, "worker": {}}
    said: dict[str, str | None] = {"bridge": None, "worker": None}
    interrupted = False
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
    ) as progress:
        task = progress.add_task("starting", total=None)
        while True:
            if stop() and not interrupted:
                interrupted = True
                progress.update(task, description="stopping")
                for child in (worker, bridge):
                    child.ask_to_stop()
            # Asked first and read after, so that nothing said before the end is missed.
            codes = {child.name: child.code() for child in (bridge, worker)}
            for child in (bridge, worker):
                for message in child.drain():
                    said[child.name] = message.get("error", said[child.name])
                    match message["event"]:
                        case "ended":
                            endings[child.name] = message
                        case "preparing":
                            progress.update(task, description="compiling")
                        case "progress":
                            _show(progress, task, message)
            for child in (bridge, worker):
                if codes[child.name] not in (None, 0):
                    raise child.failure(said[child.name])
            if codes["worker"] == 0:
                # An early end of the frames leaves the bridge with states nobody wants.
                bridge.ask_to_stop()
                if codes["bridge"] == 0:
                    return Outcome(endings["bridge"], endings["worker"], interrupted)
            time.sleep(0.02)


def _show(progress: Progress, task: Any, message: dict[str, Any]) -> None:
    dropped = message["dropped"]
    progress.update(
        task,
        description="rendering" + (f", {dropped} frames dropped" if dropped else ""),
        completed=message["frame"],
        total=message["frames"],
    )
