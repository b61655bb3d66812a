"""A process that another one of ours starts: `python -m entoptic.services.child NAME`.

What it is to do is the first line of its standard input, a record as JSON. The input stays open as long as its parent
lives (process.py), and the log on standard error is a JSON object a line. live/children.py is the parent's half.
"""

from __future__ import annotations

import os
import sys
from typing import Final

import msgspec
import structlog

from entoptic.services.process import Stop, leave, prepare_jax, process

NAMES: Final = ("bridge", "worker", "web")


def main(name: str) -> None:
    """Runs one of NAMES to its end."""
    line = _first_line()
    with process(child=True) as (stop, log):
        _run(name, line, stop, log)
    if name != "bridge":
        leave(0)


def _run(name: str, line: bytes, stop: Stop, log: structlog.typing.FilteringBoundLogger) -> None:
    # Each loads what it needs, and no more.
    match name:
        case "bridge":
            from entoptic.services.bridge import process as bridges
            from entoptic.services.process_config import BridgeConfig

            bridges.run(msgspec.json.decode(line, type=BridgeConfig), stop, log)
        case "worker":
            prepare_jax()
            from entoptic.services.session_config import WorkerConfig
            from entoptic.services.worker import live

            live.run(msgspec.json.decode(line, type=WorkerConfig), stop, log)
        case "web":
            from entoptic.services.console import process as pages
            from entoptic.services.process_config import ServerConfig

            pages.run(msgspec.json.decode(line, type=ServerConfig), stop, log, may_make_token=False)
        case _:
            raise ValueError(f"there is no child {name!r}: it is one of {', '.join(NAMES)}")


def _first_line() -> bytes:
    """Read without a buffer: what comes after it is process.py's."""
    line = b""
    while not line.endswith(b"\n"):
        more = os.read(0, 4096)
        if not more:
            sys.exit(1)  # a parent that is gone already
        line += more
    return line


if __name__ == "__main__":
    main(sys.argv[1])
