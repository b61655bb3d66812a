"""The host of live sessions: starts, watches and ends their processes, and answers what a console or a person asks.

Theory of operation: one loop in one thread that never waits for a process or a disk. One session at a time, of which
LiveSession takes care; the console's server, if there is one, lives as long as the host. All processes end with the
host, whatever ends it, since each holds the other end of a pipe to it.
"""

from __future__ import annotations

import contextlib
import functools
import os
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Final, Self

import zmq

from entoptic.services import recording
from entoptic.services.ipc.client import Reply
from entoptic.services.ipc.handler import RequestHandler
from entoptic.services.ipc.requests import GiveStatus, HostRequest, Record, StartSession, StopRecord, StopSession
from entoptic.services.ipc.status import HostStatus, Problem, merged, problem
from entoptic.services.live import registry
from entoptic.services.live.journal import Journal
from entoptic.services.live.live_session import ENDS_WITHIN_S, LiveSession
from entoptic.services.live.supervised import Supervised
from entoptic.services.live.web import Web
from entoptic.services.process import Stop
from entoptic.services.results import session_file
from entoptic.services.session_config import OpenedSession, SessionConfig, open_session

TURN_MS: Final = 20
CHECK_ANSWERS_WITHIN_S: Final = 1.2
"""A session that takes longer to open is answered before it is known to be good; a request's patience is 2 s."""
PROCESSES_END_WITHIN_S: Final = 0.9
"""Where the host itself is asked to end."""
ALL_ENDS_WITHIN_S: Final = 1.8
"""With the files; a report that takes longer to draw is left to `entoptic report`."""
WEB = "web"


class Host:
    """A context that leaves nothing running. Call `turn` in a loop, or `run`."""

    def __init__(
        self,
        root: Path,
        web: Web | None = None,
        control_address: str = "tcp://127.0.0.1:*",
    ) -> None:
        """Recordings go into `root`; `web` is settled."""
        self.root = root
        self.console_url = None if web is None else web.url
        self.session: LiveSession | None = None
        self.problems: tuple[Problem, ...] = ()
        self._last: LiveSession | None = None
        self._opened = contextlib.ExitStack()
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._opened.callback(self._context.destroy, linger=0)
        self.journal = Journal()
        self._opened.callback(self.journal.close)
        self._control: RequestHandler[HostRequest] = RequestHandler(
            control_address, HostRequest, self.answer, None, self._context
        )
        self._opened.callback(self._control.close)
        self._scratch = self._register()
        self._work = ThreadPoolExecutor(1, "host-work")
        self._checking: Future[OpenedSession] | None = None
        self._checks: list[Future[OpenedSession]] = []
        """That are not over: a check that nobody waits for any more still goes on."""
        self._web: Supervised | None = None
        if web is not None:
            config = functools.partial(web.config, self.control)
            self._web = Supervised(WEB, config, "ready", self.journal)
            self._web.start()
        self.journal.say("host", control=self.control, root=str(root), console=self.console_url)

    def _register(self) -> Path:
        """Says that this host runs, where others look; the folder for what is needed meanwhile."""
        running = registry.RunningHost(os.getpid(), self.control, session_file.now(), self.console_url)
        try:
            registration = registry.Registration(running)
        except OSError as error:
            what = f"`entoptic status` will not find this session: {error}"
            self.problems = (problem("not registered", "warning", what, "Make room, or look at the permissions"),)
            return Path(self._opened.enter_context(tempfile.TemporaryDirectory(prefix="entoptic-")))
        self._opened.callback(registration.close)
        return registration.scratch

    @property
    def control(self) -> str:
        """Where it answers."""
        return self._control.address

    def answer(self, request: HostRequest) -> Reply:
        """Does what is asked, or says why not."""
        if not isinstance(request, GiveStatus):
            self.journal.say("asked", request=type(request).__name__)
        try:
            match request:
                case StartSession():
                    return self.start(request.config)
                case StopSession():
                    return self.stop_session()
                case Record():
                    return self._record(request.name)
                case StopRecord():
                    return self._stop_record()
                case GiveStatus():
                    return Reply(True, "running" if self.session is not None else "idle", self.status())
        except Exception as error:
            self.journal.say("failed", error=str(error), kind=type(error).__name__)
            return Reply(False, str(error) or type(error).__name__)

    def start(self, config: SessionConfig) -> Reply:
        """Starts a session. Raises what `open_session` does, or says it in the status where that takes long."""
        if self.session is not None and self.session.finishing is not None and self.session.state == "stopping":
            return Reply(False, f"the last session is still finishing {self.session.finishing}: wait a moment")
        if self.session is not None or self._checking is not None:
            return Reply(False, "a session is running: stop it first")
        self.problems = ()
        self._checking = self._work.submit(open_session, config)
        self._checks = [one for one in (*self._checks, self._checking) if not one.done()]
        wait([self._checking], CHECK_ANSWERS_WITHIN_S)
        if self._checking.done():
            self._start_checked()
        return Reply(True, "the session starts")

    def _start_checked(self) -> None:
        checking, self._checking = self._checking, None
        assert checking is not None
        try:
            self.begin(checking.result())
        except Exception as error:
            what = str(error) or type(error).__name__
            self.problems = (problem("not started", "error", what, "Mend what it says, then start again"),)
            raise

    def begin(self, opened: OpenedSession, record_to: Path | None = None) -> LiveSession:
        """Starts a session, recorded from its first frame on if a folder for it is given."""
        self.session = LiveSession(opened, self._scratch, self._context, self.journal, self._work)
        for note in opened.notes:
            self.journal.say("note", note=note)
        if record_to is not None:
            self.session.record(record_to)
        return self.session

    def stop_session(self, within_s: float = ENDS_WITHIN_S) -> Reply:
        """Ends the session; its processes have that long before they are ended by force."""
        if self._checking is not None:
            self._checking.cancel()
            self._checking = None
            return Reply(True, "the session does not start")
        if self.session is None:
            return Reply(False, "no session is running")
        self.session.stop(within_s)
        return Reply(True, "the session ends")

    def _record(self, name: str) -> Reply:
        if self.session is None:
            return Reply(False, "no session is running: start one first")
        return self.session.record(recording.folder_for(self.root, name))

    def _stop_record(self) -> Reply:
        return Reply(False, "no session is running") if self.session is None else self.session.stop_record()

    def turn(self, wait_ms: int = TURN_MS) -> None:
        """One turn of the loop; returns after that time at the latest where there is nothing to do."""
        self._control.serve(wait_ms)
        if self._web is not None:
            self._web.step()
        if self._checking is not None and self._checking.done():
            with contextlib.suppress(Exception):  # a problem of the status
                self._start_checked()
        if self.session is not None:
            self.session.step()
            if self.session.is_over:
                self._last, self.session = self.session, None

    def run(self, stop: Stop, on_turn: Callable[[], bool] = lambda: True) -> None:
        """Until asked to stop, or until `on_turn` says so by False; then all ends within two seconds."""
        while not stop() and on_turn():
            self.turn()
        self.end(interrupted=stop())

    def end(self, *, interrupted: bool) -> None:
        """Ends everything within two seconds."""
        until_s = time.monotonic() + ALL_ENDS_WITHIN_S
        if self._checking is not None:
            self.stop_session()
        if self._web is not None:
            self._web.stop(PROCESSES_END_WITHIN_S)
        if self.session is not None and interrupted:
            self.session.interrupt(PROCESSES_END_WITHIN_S)
        elif self.session is not None:
            self.session.stop(PROCESSES_END_WITHIN_S)
        while time.monotonic() < until_s and (self.session is not None or (self._web and self._web.lives)):
            self.turn(5)

    @property
    def is_busy(self) -> bool:
        """Whether a thread still works, after `end`: on a report that takes long, or on a choice that is checked."""
        return self.session is not None or not all(one.done() for one in self._checks)

    def status(self) -> HostStatus:
        """As of now."""
        now, session = self.session, self.session or self._last
        supervised = [*(() if session is None else session.processes), *(() if self._web is None else (self._web,))]
        return HostStatus(
            pid=os.getpid(),
            running=now is not None or self._checking is not None,
            state="starting" if self._checking is not None else "idle" if now is None else now.state,
            config=None if now is None else now.opened.config,
            started=None if now is None else now.started,
            recording=None if now is None or now.folder is None else str(now.folder),
            finishing=None if now is None or now.finishing is None else str(now.finishing),
            last_recording=None if session is None or session.last_folder is None else str(session.last_folder),
            root=str(self.root.resolve()),
            processes={one.name: one.status() for one in supervised},
            addresses=None if now is None else now.addresses,
            console_url=self.console_url,
            gaps=() if session is None else tuple(gap.since(session.begun_ns) for gap in session.gaps),
            bridge=None if now is None else now.bridge_status,
            worker=None if now is None else now.worker_status,
            log=str(self.journal.path),
            problems=self.all_problems(),
        )

    def all_problems(self) -> tuple[Problem, ...]:
        """What is wrong now, and what ended the last session."""
        return merged(
            self.problems,
            () if self.journal.problem is None else (self.journal.problem,),
            () if self._last is None or self.session is not None else self._last.problems,
            () if self.session is None else self.session.all_problems(),
            () if self._web is None else self._web.problems(),
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.session is not None:
            self.session.close()
        if self._web is not None:
            self._web.kill()
        self._work.shutdown(wait=False, cancel_futures=True)
        self._opened.close()
