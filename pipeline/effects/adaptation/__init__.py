"""The luminance an eye is adapted to, over time, and the exposure that follows from it (LUI §5.1).

settings.py   which target, which course, and what else
targets.py    the luminance that an eye is on its way to, from a frame's tiles
courses.py    how fast it goes there
pigments.py   what strong light bleaches, and what the eye loses by it for half an hour
state.py      one eye's adaptation from frame to frame
"""

from entoptic.pipeline.effects.adaptation.courses import (
    TAU_CONE_S,
    TAU_ROD_S,
    adapt_cd_m2,
    overshoot_threshold_cd_m2,
    rod_sensitivity,
)
from entoptic.pipeline.effects.adaptation.pigments import (
    Pigments,
    equivalent_cd_m2,
    sensitivity,
    settled,
    step_pigments,
)
from entoptic.pipeline.effects.adaptation.settings import GAZE_SD_DEG, Adaptation, Bleaching, Course, Target
from entoptic.pipeline.effects.adaptation.state import Adapted, begin, exposure, step
from entoptic.pipeline.effects.adaptation.targets import FLOOR_CD_M2, target_cd_m2

__all__ = [
    "FLOOR_CD_M2",
    "GAZE_SD_DEG",
    "TAU_CONE_S",
    "TAU_ROD_S",
    "Adaptation",
    "Adapted",
    "Bleaching",
    "Course",
    "Pigments",
    "Target",
    "adapt_cd_m2",
    "begin",
    "equivalent_cd_m2",
    "exposure",
    "overshoot_threshold_cd_m2",
    "rod_sensitivity",
    "sensitivity",
    "settled",
    "step",
    "step_pigments",
    "target_cd_m2",
]
