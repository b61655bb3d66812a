"""Why an effect runs or does not, in words, with the figures that decided it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from entoptic.pipeline.effects.effect import SKIPPED, Effect
from entoptic.pipeline.eye_context import EyeContext
from entoptic.pipeline.plan.settings import Planning
from entoptic.pipeline.words import number

NAMED_SHARE = 0.25
"""Of a budget, from which on the scene is named. Engineering choice."""


@dataclasses.dataclass(frozen=True)
class Reduced:
    """What a level short of full may change, in one eye."""

    which: int
    """Which of the eyes."""
    error_code_values: float
    """What it counts: see make_plan."""
    bound_code_values: float
    """The most by which any component of any pixel changes."""
    change_cd_m2: float
    """The most by which the luminance of any pixel changes; infinite for an effect that no threshold decides."""
    threshold_cd_m2: float
    """The least that the eye sees."""


def reason_of(
    effect: Effect[Any, Any],
    level: str,
    eyes: Sequence[EyeContext],
    settings: Any,
    planning: Planning,
    found: Mapping[str, Reduced],
    scene_ms: float = 0.0,
) -> str:
    """Why an effect is at this level; `found` is what its reduced levels may change.

    `scene_ms` is what of a budget the making of the frame takes.
    """
    budget_ms, tolerance = planning.budget_ms, planning.tolerance_code_values
    budget = "" if budget_ms is None else f"{budget_ms:g} ms"
    if budget_ms is not None and scene_ms > NAMED_SHARE * budget_ms:
        budget += f", of which the scene takes {number(scene_ms)}"
    if effect.name in planning.leave_out:
        return "left out as asked" if budget_ms is None else f"nothing more fits {budget}"
    if (required := effect.required(eyes, settings)) is not None:
        return required
    if planning.everything:
        return "everything was asked for"
    # What decides: the level that it is at, or else the one that it is too much for.
    reduced = found.get(level) or found.get(SKIPPED)
    if reduced is None:
        return "beside lights of their own nothing is left out" if eyes[0].lights else "it was asked for"
    why = effect.reason(eyes[reduced.which], settings)
    fits = reduced.error_code_values <= tolerance
    if level not in found:
        stays = "; it stays until that has lasted 0.5 s" if fits else ""
        return f"{why}: without it, {_change(reduced)}{stays}"
    short = "without it" if level == SKIPPED else f"with no more than {level}"
    within = "" if fits or budget_ms is None else f"; more does not fit {budget}"
    return f"{why}: {short}, {_change(reduced)}{within}"


def _change(reduced: Reduced) -> str:
    codes = f"a pixel changes by {number(reduced.bound_code_values)} code values at most"
    if math.isinf(reduced.change_cd_m2):
        return codes
    beside = "below" if reduced.change_cd_m2 <= reduced.threshold_cd_m2 else "over"
    return (
        f"by {number(reduced.change_cd_m2)} cd/m² at most, {beside} the eye's threshold of "
        f"{number(reduced.threshold_cd_m2)}; {codes}"
    )
