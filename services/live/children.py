"""One process of a session: started, listened to, asked to stop, and ended by force where it does not.

Theory of operation: what a child is to do goes to it by its standard input, a line of JSON. It writes its log to
standard error, a JSON object a line, and stops when its standard input closes: so it stops too if this process is
killed, whatever way. services/child.py is the child's half.
"""

from __future__ import annotations

import contextlib
import json
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import msgspec

from entoptic.services.process import STOPS_WITHIN_S

OUTPUT_LINES = 20
"""What a process says without being a log, as a traceback: the last of it is kept."""


class Child:
    """One process of ours. Not for several threads at once."""

    def __init__(self, name: str, config: msgspec.Struct) -> None:
        """`name` is one of services.child.NAMES, `config` the record that goes with it."""
        self.name = name
        self.started_s = time.monotonic()
        self._messages: queue.Queue[dict[str, Any]] = queue.Queue()
        self._output: list[str] = []
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "entoptic.services.child", name],
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,  # Ctrl-C reaches its parent alone, which then asks it to stop.
        )
        self._reader = threading.Thread(target=self._read, name=f"{name}-log", daemon=True)
        self._reader.start()
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # it ended at once: its exit status says so
            self._process.stdin.write(msgspec.json.encode(config).decode() + "\n")
            self._process.stdin.flush()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def _read(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            message = _json_of(line)
            if message is not None:
                self._messages.put({"process": self.name, "pid": self.pid, **message})
            else:
                self._output = [*self._output[1 - OUTPUT_LINES :], line.rstrip()]

    def drain(self) -> Iterator[dict[str, Any]]:
        """The log's messages that have come since the last call, with the process's name and pid."""
        with contextlib.suppress(queue.Empty):
            while True:
                yield self._messages.get_nowait()

    def code(self) -> int | None:
        """Its exit status, None while it runs. All it said is read by then."""
        code = self._process.poll()
        if code is not None:
            self._reader.join(2.0)
        return code

    @property
    def output(self) -> tuple[str, ...]:
        """The last lines that it said beside its log."""
        return tuple(self._output)

    def ending(self, error: str | None) -> str:
        """How it ended, in its own words: `error` is the last error in its log."""
        code = self._process.returncode
        how = f"signal {-code}" if code is not None and code < 0 else f"exit status {code}"
        return f"({how}): {error or (self._output[-1] if self._output else 'it said nothing')}"

    def ask_to_stop(self) -> None:
        """Closes its standard input."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()

    def kill(self) -> None:
        """Ends it by force, at once."""
        with contextlib.suppress(OSError):
            self._process.kill()

    def end(self, within_s: float = STOPS_WITHIN_S) -> bool:
        """Asks it to stop and waits, then ends it by force; whether it stopped by itself."""
        self.ask_to_stop()
        by_itself = True
        try:
            self._process.wait(max(within_s, 0.0))
        except subprocess.TimeoutExpired:
            by_itself = False
            self.kill()
            self._process.wait()
        self._reader.join(2.0)
        assert self._process.stderr is not None
        self._process.stderr.close()
        return by_itself


def _json_of(line: str) -> dict[str, Any] | None:
    try:
        message = json.loads(line)
    except ValueError:
        return None
    return message if isinstance(message, dict) and "event" in message else None
