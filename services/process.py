"""What all processes do alike: logs, signals, and ending with their parent."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import NoReturn

import platformdirs
import structlog

from entoptic.threads import fix_threads

INTERRUPTED = 130
"""The exit status of a command that Ctrl-C ended, as of a shell."""
STOPS_WITHIN_S = 10.0
"""An encoder may have frames to flush; after that a process that was asked to stop is ended by force."""
_M_TRIM_THRESHOLD, _M_MMAP_MAX, _M_ARENA_MAX = -1, -4, -8
"""glibc's malloc.h."""


class Stop(threading.Event):
    """Says whether this process was asked to stop. Call it: cheap enough for every turn of a loop."""

    def __call__(self) -> bool:
        """Whether it was."""
        return self.is_set()

    def on_signals(self) -> Stop:
        """Ctrl-C and SIGTERM ask once, gently; a second Ctrl-C ends the process at once."""

        def ask(number: int, frame: FrameType | None) -> None:
            self.set()
            signal.signal(number, signal.SIG_DFL)

        signal.signal(signal.SIGINT, ask)
        signal.signal(signal.SIGTERM, ask)
        return self

    def with_parent(self) -> Stop:
        """Stops when the parent is gone: it holds the other end of this process's standard input.

        In the middle of a long compilation nobody looks whether to stop: then it ends by force.
        """

        def wait() -> None:
            # Not sys.stdin, whose lock this thread would hold when the interpreter ends.
            while os.read(0, 4096):
                pass
            self.set()
            time.sleep(STOPS_WITHIN_S)
            os._exit(1)

        threading.Thread(target=wait, name="parent-watch", daemon=True).start()
        return self


def start_logging(*, as_json: bool) -> structlog.typing.FilteringBoundLogger:
    """A logger to standard error: for a person, or a JSON object a line for the process that started this one."""
    renderer = structlog.processors.JSONRenderer() if as_json else structlog.dev.ConsoleRenderer()
    structlog.configure(
        processors=[structlog.processors.add_log_level, structlog.processors.TimeStamper(fmt="iso"), renderer],
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
    )
    logger: structlog.typing.FilteringBoundLogger = structlog.get_logger()
    return logger


@contextlib.contextmanager
def process(child: bool = False) -> Iterator[tuple[Stop, structlog.typing.FilteringBoundLogger]]:
    """What a process of ours runs in: when to stop, and a log. A child ends with its parent, and tells it why."""
    stop = Stop().on_signals()
    if child:
        stop.with_parent()
    log = start_logging(as_json=child)
    try:
        yield stop, log
    except Exception as error:
        if not child:
            raise
        # The parent cannot see an exception.
        log.error("failed", error=str(error) or type(error).__name__)
        sys.exit(1)


def leave(status: int) -> NoReturn:
    """Ends this process at once, when all its files and sockets are closed.

    The interpreter takes seconds to take compiled code apart, and waits for a thread in the middle of a compilation.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def cache_folder() -> Path:
    """What may go and can be had again: ~/.cache/entoptic, or what the platform has for it."""
    return platformdirs.user_cache_path("entoptic", appauthor=False)


def compiled_folder() -> Path:
    """Where compiled code is kept between runs.

    JAX would take what was compiled for another number of threads, which rounds otherwise, for the same.
    """
    return cache_folder() / f"compiled-{fix_threads()}"


def state_folder() -> Path:
    """Where running processes leave word of themselves, and their logs: ~/.local/state/entoptic, or the like."""
    return platformdirs.user_state_path("entoptic", appauthor=False)


def prepare_jax(*, renders: bool = True) -> None:
    """Lets JAX keep what it compiles on disk, and the processor's memory it has freed for the next frame.

    A process that renders nothing leaves a GPU, of which JAX takes most of the memory, to those that do.

    glibc gives a freed frame back to the system and is handed fresh, zeroed pages for the next one: that took a sixth
    of the time of a frame. Threads other than the first have arenas of their own, which go back whatever else is set:
    one for all keeps 8,000 pages a frame that the kernel zeroed each time.
    """
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):  # another C library: slower, no harm
            mallopt = ctypes.CDLL(None).mallopt
            mallopt(_M_MMAP_MAX, 0)
            mallopt(_M_TRIM_THRESHOLD, 2**31 - 1)
            mallopt(_M_ARENA_MAX, 1)
    import jax

    import entoptic.pipeline  # noqa: F401 - sets up JAX before anything asks it to compile

    if not renders:
        jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_compilation_cache_dir", str(compiled_folder()))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
