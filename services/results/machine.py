"""What renders frames: the same one, with the same version of this program, gives the same bytes."""

from __future__ import annotations

import functools
import platform
from importlib.metadata import version

import jax

from entoptic.pipeline.budget import processor_name
from entoptic.threads import fix_threads

LIBRARIES = ("jaxlib", "numpy", "scipy")
"""Those that compute frames."""


@functools.cache
def machine() -> str:
    """Processor, threads, graphics card and libraries, for a person, and to be compared."""
    cards = sorted({device.device_kind for device in jax.devices() if device.platform != "cpu"})
    libraries = [f"{name} {version(name)}" for name in LIBRARIES]
    return ", ".join([f"{processor_name()} ({platform.machine()})", f"{fix_threads()} threads", *cards, *libraries])
