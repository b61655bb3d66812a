"""What does a person really see here? HDR frames and the live state of the eyes in, the frames as perceived out.

pipeline/        the light side: frames, effects, plans
tracker_bridge/  the eye side: sources, clocks, filters, calibration
services/        processes, commands and the console

In the checkout these three lie at the top level; here are links to them. Names are looked up when they are first used:
a process that renders nothing does not wait for JAX.
"""

from __future__ import annotations

import importlib.metadata
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from entoptic.pipeline import (
        EFFECTS,
        Display,
        Effect,
        Effects,
        Encoding,
        EyeContext,
        EyePose,
        Frame,
        FrameError,
        Glare,
        GlareLevel,
        GlareModel,
        Iris,
        Light,
        Observer,
        OcularDynamics,
        Perceived,
        Plan,
        Planning,
        RenderState,
        Step,
        View,
        as_displayed,
        perceive,
    )

__version__ = importlib.metadata.version("entoptic")

__all__ = [
    "EFFECTS",
    "Display",
    "Effect",
    "Effects",
    "Encoding",
    "EyeContext",
    "EyePose",
    "Frame",
    "FrameError",
    "Glare",
    "GlareLevel",
    "GlareModel",
    "Iris",
    "Light",
    "Observer",
    "OcularDynamics",
    "Perceived",
    "Plan",
    "Planning",
    "RenderState",
    "Step",
    "View",
    "__version__",
    "as_displayed",
    "perceive",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'entoptic' has no attribute {name!r}")
    from entoptic import pipeline

    return getattr(pipeline, name)
