"""What a frame may cost: predicted times, the levels that fit a budget, and levels that do not flicker.

All pure: costs, errors, a budget and what was chosen before go in, choices come out. No clock is read here, so offline
frames are the same on every machine; only a live worker feeds measured times back (`corrected`).

costs.py         milliseconds of each effect's levels, corrected by what was measured
device_costs.py  those of each device, kept in a folder
choose.py        the levels of least error that fit a budget
steady.py        the same from frame to frame: hysteresis and cross-fades
"""

from entoptic.pipeline.budget.choose import TOLERANCE_CODE_VALUES, Option, choose, counted_error, option_at
from entoptic.pipeline.budget.costs import SCENE, SHIPPED, CostModel, Timing, calibrate, corrected, fitted
from entoptic.pipeline.budget.device_costs import costs_file, device_name, load, processor_name, save
from entoptic.pipeline.budget.steady import Choice, settle
from entoptic.pipeline.effects.effect import Cost

__all__ = [
    "SCENE",
    "SHIPPED",
    "TOLERANCE_CODE_VALUES",
    "Choice",
    "Cost",
    "CostModel",
    "Option",
    "Timing",
    "calibrate",
    "choose",
    "corrected",
    "costs_file",
    "counted_error",
    "device_name",
    "fitted",
    "load",
    "option_at",
    "processor_name",
    "save",
    "settle",
]
