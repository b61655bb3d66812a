"""What does a person really see here? HDR frames and the live state of the eyes in, the frames as perceived out.

pipeline/        the light side: frames, effects, plans
tracker_bridge/  the eye side: sources, clocks, filters, calibration
services/        processes, commands and the console

In the checkout these three lie at the top level; here are links to them. Names are looked up when they are first used:
a process that renders nothing does not wait for JAX.
"""

from __future__ import annotations

import importlib
import importlib.metadata
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from entoptic.pipeline import *  # noqa: F403 - what the light side names is what users get

__version__ = importlib.metadata.version("entoptic")


def __getattr__(name: str) -> Any:
    if not name.startswith("_") and name not in ("pipeline", "services", "tracker_bridge"):
        pipeline = importlib.import_module("entoptic.pipeline")
        if name in pipeline.__all__:
            return getattr(pipeline, name)
    raise AttributeError(f"module 'entoptic' has no attribute {name!r}")
