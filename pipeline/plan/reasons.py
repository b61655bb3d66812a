"""Why an effect runs or does not, in words, with the figures that decided it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from entoptic.pipeline.effects import acuity
from entoptic.pipeline.effects.night_colour import share as night_colour
from entoptic.pipeline.effects.settings import Effects
from entoptic.pipeline.measure import MAX_SOURCES, Measurement
from entoptic.pipeline.plan.chain import Chain, Eye
from entoptic.pipeline.plan.settings import Planning
from entoptic.pipeline.plan.steps import SKIPPED, Effect


@dataclasses.dataclass(frozen=True, eq=False)
class Lesser:
    """What a level short of full may change, in one eye."""

    eye: Eye
    chain: Chain
    error_code_values: float
    """What it counts: see make_plan."""
    bound_code_values: float
    """The most by which any component of any pixel changes."""
    change_cd_m2: float
    """The most by which the luminance of any pixel changes; infinite after tone mapping."""
    threshold_cd_m2: float
    """The least that the eye sees."""


Found = Mapping[tuple[Effect, str], Lesser]


def reason_of(
    effect: Effect,
    level: str,
    eyes: Sequence[Eye],
    lights: int,
    effects: Effects,
    planning: Planning,
    found: Found,
) -> str:
    """Why an effect is at this level."""
    if effect in planning.leave_out:
        return "left out as asked" if planning.budget_ms is None else f"nothing more fits {planning.budget_ms:g} ms"
    match effect:
        case Effect.ADAPTATION:
            return f"adapted to {_list([eye.adapted.luminance_cd_m2 for eye in eyes])} cd/m²"
        case Effect.TONE:
            return "every display needs it"
        case Effect.GLARE if lights:
            return f"{lights} {'lights of their own are' if lights > 1 else 'light of its own is'} drawn with it"
    if planning.everything:
        return "everything was asked for"
    # What decides: the level that it is at, or else the one that it is too much for.
    lesser = found.get((effect, level)) or found.get((effect, SKIPPED))
    if lesser is None:
        return "beside lights of their own nothing is left out" if lights else "it was asked for"
    why = _seen(effect, lesser.eye, effects)
    if (effect, level) not in found:
        stays = (
            "; it stays until that has lasted 0.5 s"
            if lesser.error_code_values <= planning.tolerance_code_values
            else ""
        )
        return f"{why}: without it, {_change(effect, lesser)}{stays}"
    short = "without it" if level == SKIPPED else f"with no more than {level}"
    fits = lesser.error_code_values <= planning.tolerance_code_values
    within = "" if fits or planning.budget_ms is None else f"; more does not fit {planning.budget_ms:g} ms"
    return f"{why}: {short}, {_change(effect, lesser)}{within}"


def _change(effect: Effect, lesser: Lesser) -> str:
    codes = f"a pixel changes by {_number(lesser.bound_code_values)} code values at most"
    if effect is not Effect.GLARE:
        return codes
    beside = "below" if lesser.change_cd_m2 <= lesser.threshold_cd_m2 else "over"
    return (
        f"by {_number(lesser.change_cd_m2)} cd/m² at most, {beside} the eye's threshold of "
        f"{_number(lesser.threshold_cd_m2)}; {codes}"
    )


def _seen(effect: Effect, eye: Eye, effects: Effects) -> str:
    measured = eye.measured
    match effect:
        case Effect.GLARE:
            return f"brightest pixel {_number(measured.max_cd_m2)} cd/m², {_lights(measured)}"
        case Effect.ACUITY:
            limit = acuity.limit_cd_m2(measured.view.ppd_centre, effects.acuity)
            sharp = f"; an eye resolves every pixel above {limit:.2g}" if measured.min_cd_m2 >= limit else ""
            return f"{_darkest(measured, 0.01)}{sharp}"
        case Effect.ROD_NOISE:
            return _darkest(measured, effects.rod_noise.below_cd_m2)
        case Effect.NIGHT_COLOUR if effects.night_colour.per_pixel:
            return f"{_darkest(measured, 3.0)}, and each has its own share of rods"
        case Effect.NIGHT_COLOUR:
            adapted = eye.adapted.luminance_cd_m2
            (share,) = night_colour.adapted_share(np.array([adapted]), effects.night_colour)
            return f"adapted to {adapted:.3g} cd/m², rods carry {share:.2g} of vision"
        case _:
            return "what the retina keeps of what was seen before"


def _darkest(measured: Measurement, below_cd_m2: float) -> str:
    share = measured.share_below(below_cd_m2)
    return f"darkest pixel {_number(measured.min_cd_m2)} cd/m², {share:.0%} of the frame below {below_cd_m2:g} cd/m²"


def _lights(measured: Measurement) -> str:
    count = len(measured.sources)
    more = " or more" if count == MAX_SOURCES else ""
    return f"{count}{more} {'light stands' if count == 1 else 'lights stand'} out" if count else "no light stands out"


def _number(value: float) -> str:
    return f"{value:.0f}" if 10 <= value < 1e4 else f"{value:.2g}"


def _list(values: Sequence[float]) -> str:
    return " and ".join(f"{value:.3g}" for value in dict.fromkeys(values))
