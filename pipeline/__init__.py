"""The light side: from frames in cd/m² and the state of the eyes to what a person perceives.

frame.py      Frame, view geometry, display
observer.py   the person who looks
eye_pose.py   how one eye looks at a frame
eye_context.py  one eye viewing one image: what effects get to know of it
viewing.py    how eyes have adapted and moved since the frame before
ranges.py     what may stand in a frame's tiles, and what may change
scenes/       where frames come from
measure.py    what a frame contains
plan/         which effects it calls for, at which level, and why
budget/       what levels cost, and which fit a time
effects/      what an eye does to a frame, one file an effect
optics/       light inside the eye
threshold.py  the smallest difference that is seen
mesopic.py    luminance between day and night
fft_length.py lengths of FFTs that always give the same bytes
fast_math.py  cube root, exponential and arc tangent at a fraction of their price
display_gamut.py  the colours that a display has
render.py     runs a plan
sinks/        where perceived frames go
cost/         what accuracy costs in time
"""

import jax

from entoptic.threads import fix_threads

fix_threads()
# Kernels and their energy are computed in float64; frames say float32 themselves, everywhere.
jax.config.update("jax_enable_x64", True)

from entoptic.pipeline.effects import EFFECTS, OPTIONAL, Effects  # noqa: E402 - after the switch above
from entoptic.pipeline.effects.effect import Effect  # noqa: E402
from entoptic.pipeline.effects.glare import Glare, GlareLevel, GlareModel  # noqa: E402
from entoptic.pipeline.eye_context import EyeContext  # noqa: E402
from entoptic.pipeline.eye_pose import EyePose  # noqa: E402
from entoptic.pipeline.frame import Display, Encoding, Frame, FrameError, Light, View  # noqa: E402
from entoptic.pipeline.observer import Iris, Observer, OcularDynamics  # noqa: E402
from entoptic.pipeline.plan import Plan, Planning, Step  # noqa: E402
from entoptic.pipeline.render import Perceived, as_displayed, light_after, perceive  # noqa: E402
from entoptic.pipeline.viewing import RenderState  # noqa: E402

__all__ = [
    "EFFECTS",
    "OPTIONAL",
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
    "as_displayed",
    "light_after",
    "perceive",
]
