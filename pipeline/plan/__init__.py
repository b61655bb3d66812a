"""Which effects a frame calls for, at which level, and why: pure functions of what was measured.

steps.py     what a plan says: records
settings.py  how much it may leave out
chain.py     the most that leaving something out changes, carried through all later effects to the display
make.py      what is left out
reasons.py   why, in words
"""

from entoptic.pipeline.effects.effect import SKIPPED
from entoptic.pipeline.plan.make import Planned, make_plan
from entoptic.pipeline.plan.settings import Planning
from entoptic.pipeline.plan.steps import OFF, Plan, Step

__all__ = ["OFF", "SKIPPED", "Plan", "Planned", "Planning", "Step", "make_plan"]
