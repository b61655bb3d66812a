"""What renders frames: the same one, with the same version of this program, gives the same bytes."""

from __future__ import annotations

import contextlib
import functools
import platform
from importlib.metadata import version
from pathlib import Path

import jax

from entoptic.threads import fix_threads

LIBRARIES = ("jaxlib", "numpy", "scipy")
"""Those that compute frames."""


@functools.cache
def machine() -> str:
    """Processor, threads, graphics card and libraries, for a person, and to be compared."""
    cards = sorted({device.device_kind for device in jax.devices() if device.platform != "cpu"})
    libraries = [f"{name} {version(name)}" for name in LIBRARIES]
    return ", ".join([_processor(), f"{fix_threads()} threads", *cards, *libraries])


def _processor() -> str:
    name = platform.processor()
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                name = line.partition(":")[2].strip()
                break
    return f"{name} ({platform.machine()})" if name else platform.machine()
