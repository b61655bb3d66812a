"""What a live worker is asked, answered from a thread of its own: a frame may take ten seconds, where code is compiled.

Theory of operation: the thread looks at a request and answers what it can; what changes files is put in a queue,
which the loop that renders takes from between two frames. Who ends a recording waits until its files are whole; all
others have their answer within two seconds.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as StillBusyError
from pathlib import Path
from typing import Final

import zmq

from entoptic.pipeline import FrameError
from entoptic.pipeline.effects.tone.own_curve import read_curve
from entoptic.services.ipc.client import Reply
from entoptic.services.ipc.handler import RequestHandler
from entoptic.services.ipc.requests import ChangeSettings, GiveStatus, StartRecording, StopRecording, WorkerRequest
from entoptic.services.ipc.status import WorkerStatus
from entoptic.services.settings import Settings
from entoptic.tracker_bridge.access import ServerKeys

TURN_MS: Final = 50
ANSWER_WITHIN_S: Final = 1.5
"""A loop that is busy for longer has its say in the status."""
STOPS: Final = Reply(False, "the worker stops")

Command = StartRecording | StopRecording
"""What the loop has to do."""


class WorkerRequests:
    """The worker's ear. Raises what Control raises."""

    def __init__(
        self,
        address: str,
        keys: ServerKeys | None,
        status: Callable[[], WorkerStatus],
        change: Callable[[Settings], int],
        context: zmq.Context[zmq.Socket[bytes]],
    ) -> None:
        """`status` and `change`, which says the revision of the new settings, are called from the thread."""
        self._status, self._change = status, change
        self._commands: queue.Queue[tuple[Command, Future[Reply]]] = queue.Queue()
        self._ended: Reply | None = None
        """What became of the recording when the loop ended."""
        self._over = threading.Event()
        # From here on it is the thread's.
        self._control: RequestHandler[WorkerRequest] = RequestHandler(
            address, WorkerRequest, self._answer, keys, context
        )
        self.address = self._control.address
        """Where requests are to be sent."""
        self._thread = threading.Thread(target=self._listen, name="requests", daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        try:
            while not self._over.is_set():
                self._control.serve(TURN_MS)
        finally:
            self._control.close()

    def _answer(self, request: WorkerRequest) -> Reply:
        match request:
            case GiveStatus():
                return Reply(True, "rendering", self._status())
            case ChangeSettings(settings):
                try:
                    if settings.tone.curve:
                        read_curve(settings.tone.curve)
                except FrameError as error:
                    return Reply(False, f"settings: {error}")
                return Reply(True, "from the next frame on", self._change(settings))
            case StartRecording(folder):
                if not Path(folder).is_dir():
                    return Reply(False, f"{folder} is no folder: make it first")
                begun = self._command(request)
                try:
                    return begun.result(ANSWER_WITHIN_S)
                except StillBusyError:
                    if self._ended is not None:
                        return STOPS
                    return Reply(True, "the recording begins with the next frame, which takes a while")
            case StopRecording():
                return self._wait_for(self._command(request))

    def _command(self, command: Command) -> Future[Reply]:
        answer: Future[Reply] = Future()
        self._commands.put((command, answer))
        return answer

    def _wait_for(self, answer: Future[Reply]) -> Reply:
        while not self._over.is_set():
            try:
                return answer.result(TURN_MS / 1e3)
            except StillBusyError:
                if self._ended is not None:
                    break
        return answer.result() if answer.done() else self._ended or STOPS

    def serve(self, do: Callable[[Command], Reply], wait_s: float) -> None:
        """Does what was asked; where nothing was, waits so long for a command. For the loop."""
        until_s = time.monotonic() + wait_s
        while True:
            try:
                command, answer = (
                    self._commands.get(timeout=max(until_s - time.monotonic(), 0.0))
                    if wait_s > 0
                    else (self._commands.get_nowait())
                )
            except queue.Empty:
                return
            answer.set_result(do(command))
            wait_s = 0.0

    def over(self, ended: Reply) -> None:
        """The loop has ended; what whoever waits for the end of the recording is told."""
        self._ended = ended

    def close(self) -> None:
        """Stops listening."""
        self._over.set()
        self._thread.join()
