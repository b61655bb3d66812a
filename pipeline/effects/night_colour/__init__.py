"""Colour where rods see: it pales, shifts towards blue, and reds go dark.

settings.py   which method, and what decides the rods' share
share.py      the rods' share of vision: by adaptation, by CIE 191, or pixel by pixel
tints.py      what grey looks like to rods, and which light they see
shift.py      the effect
bounds.py     how much it may change at most, for the planner
"""

from entoptic.pipeline.effects.night_colour.settings import NightColour, NightMethod
from entoptic.pipeline.effects.night_colour.shift import night_tint, shift
from entoptic.pipeline.effects.night_colour.tints import TINT

__all__ = ["TINT", "NightColour", "NightMethod", "night_tint", "shift"]
