"""The light side: from frames in cd/m² and the state of the eyes to what a person perceives.

frame.py      Frame, view geometry, display
observer.py   the person who looks
eye_pose.py    how one eye looks at a frame
ranges.py     what may stand in a frame's tiles, and what may change
scenes/       where frames come from
measure.py    what a frame contains
plan/         which effects it calls for, at which level, and why
budget/       what levels cost, and which fit a time
effects/      what an eye does to a frame, one file an effect
optics/       light inside the eye
threshold.py  the smallest difference that is seen
mesopic.py    luminance between day and night
render.py     runs a plan
sinks/        where perceived frames go
cost/         what accuracy costs in time
"""

import jax

# Kernels and their energy are computed in float64; frames say float32 themselves, everywhere.
jax.config.update("jax_enable_x64", True)

from entoptic.pipeline.effects.glare import Glare, GlareLevel, GlareModel  # noqa: E402 - after the switch above
from entoptic.pipeline.effects.settings import Effects  # noqa: E402
from entoptic.pipeline.eye_pose import EyePose  # noqa: E402
from entoptic.pipeline.frame import Display, Encoding, Frame, FrameError, Light, View  # noqa: E402 - after the switch above
from entoptic.pipeline.observer import Iris, Observer, OcularDynamics  # noqa: E402
from entoptic.pipeline.plan import Effect, Plan, Planning, Step  # noqa: E402
from entoptic.pipeline.render import Perceived, RenderState, as_displayed, perceive  # noqa: E402

__all__ = [
    "Display",
    "Effect",
    "Effects",
    "Encoding",
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
    "as_displayed",
    "perceive",
]
