"""Levels from frame to frame: no flicker between two that are about as good, and no jump where one gives way.

A better level comes at once when the present one's error exceeds the tolerance. A cheaper one comes only after its own
error has stayed below half the tolerance for half a second. Where a budget binds, levels are given up at once when they
no longer fit, and taken on again only where they fit with a tenth to spare; errors are traded between effects only
where that halves them.

The picture passes from the old level to the new one over 0.2 s, both computed and mixed. A change back turns the fade
round where it stands; a third level waits for its end. Steps of any length: two halves make the whole.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

from entoptic.pipeline.budget.choose import TOLERANCE_CODE_VALUES, Option, Options, choose, counted_error, option_at

CALM_S = 0.5
"""How long a cheaper level must have been good enough. Engineering choice: longer than a blink (0.3–0.4 s, equations
12), so that the frames of a blink change nothing."""
CALM_SHARE = 0.5
"""Of the tolerance that its error must stay within. Engineering choice: bounds waver by less than a factor of two while
a scene stays the same."""
SPARE_SHARE = 0.1
"""Of the budget that new levels leave free. Engineering choice: predicted times waver by less."""
WORTHWHILE_SHARE = 0.5
"""Of the present error that is left after a trade between effects, or it is not made."""
FADE_S = 0.2
"""From one level to the next. Engineering choice: slow enough not to be seen as a jump, a fixation's length."""


@dataclasses.dataclass(frozen=True)
class Choice:
    """The level of one effect, and how it came to be."""

    level: str
    fade_from: str | None = None
    """The level before, while the picture still passes from it."""
    fade: float = 1.0
    """Weight of `level`, 0 to 1; that of `fade_from` is the rest."""
    calm_s: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """How long each cheaper level's error has stayed below half the tolerance."""

    @property
    def weights(self) -> dict[str, float]:
        """The levels to compute and their weights, which add up to 1."""
        if self.fade_from is None:
            return {self.level: 1.0}
        return {level: weight for level, weight in ((self.level, self.fade), (self.fade_from, 1 - self.fade)) if weight}


def settle(
    before: Mapping[str, Choice],
    options: Options,
    dt_s: float,
    *,
    budget_ms: float = math.inf,
    tolerance_code_values: float = TOLERANCE_CODE_VALUES,
) -> dict[str, Choice]:
    """The choices for this frame, `dt_s` after those of the frame before.

    An effect without a choice before, or whose level is no longer offered, takes its level without a fade; so do all in
    a first frame. A `dt_s` that is negative or no number counts as 0.
    """
    dt_s = dt_s if dt_s > 0 else 0.0
    calm = {effect: _calm(before.get(effect), of, dt_s, tolerance_code_values) for effect, of in options.items()}
    levels = _levels(before, options, calm, budget_ms, tolerance_code_values)
    return {
        effect: _passed(before.get(effect), level, options[effect], calm[effect], dt_s)
        for effect, level in levels.items()
    }


def _levels(
    before: Mapping[str, Choice],
    options: Options,
    calm_s: Mapping[str, Mapping[str, float]],
    budget_ms: float,
    tolerance_code_values: float,
) -> dict[str, str]:
    """The levels to aim at, fades apart."""
    aim_ms = budget_ms * (1 - SPARE_SHARE)
    present = {
        effect: option
        for effect, of_effect in options.items()
        if effect in before and (option := option_at(of_effect, before[effect].level)) is not None
    }
    calm = {
        effect: [option for option in options[effect] if _is_rest(option, now, calm_s[effect])]
        for effect, now in present.items()
    }
    steps = {
        effect: of_effect
        if effect not in present
        else [
            option
            for option in of_effect
            if option in calm[effect] or _is_better(option, present[effect], tolerance_code_values)
        ]
        for effect, of_effect in options.items()
    }
    called_for = choose(steps, math.inf, tolerance_code_values)
    if _ms(options, called_for) <= aim_ms:
        return called_for
    best = choose(options, aim_ms, tolerance_code_values)
    if len(present) < len(options):
        return best
    kept = choose(steps, aim_ms, tolerance_code_values)
    if _ms(options, kept) > aim_ms:
        kept = choose(calm, math.inf, tolerance_code_values)
        if _ms(options, kept) > budget_ms:
            # Where nothing fits, a little less does not help either.
            return best if _ms(options, best) <= (1 - SPARE_SHARE) * _ms(options, kept) else kept
    left, paid = (
        sum(counted_error(_at(options, *chosen).error_code_values, tolerance_code_values) for chosen in levels.items())
        for levels in (best, kept)
    )
    return best if left < WORTHWHILE_SHARE * paid else kept


def _is_rest(option: Option, present: Option, calm_s: Mapping[str, float]) -> bool:
    """Whether it is the present level, or one worth descending to."""
    cheaper = option.ms < present.ms * (1 - SPARE_SHARE)
    return option.level == present.level or (cheaper and calm_s[option.level] >= CALM_S)


def _is_better(option: Option, present: Option, tolerance_code_values: float) -> bool:
    """Whether it may follow at once: what is dearer if it is better at all, what is cheaper only if by far."""
    paid = counted_error(present.error_code_values, tolerance_code_values)
    if option.ms <= present.ms:
        return option.error_code_values < WORTHWHILE_SHARE * paid
    return counted_error(option.error_code_values, tolerance_code_values) < paid


def _ms(options: Options, levels: Mapping[str, str]) -> float:
    return math.fsum(_at(options, effect, level).ms for effect, level in levels.items())


def _at(options: Options, effect: str, level: str) -> Option:
    return next(option for option in options[effect] if option.level == level)


def _calm(
    choice: Choice | None, options: Sequence[Option], dt_s: float, tolerance_code_values: float
) -> dict[str, float]:
    so_far = {} if choice is None else choice.calm_s
    calm = CALM_SHARE * tolerance_code_values
    return {
        option.level: so_far.get(option.level, 0.0) + dt_s if option.error_code_values <= calm else 0.0
        for option in options
    }


def _passed(
    before: Choice | None, level: str, options: Sequence[Option], calm_s: Mapping[str, float], dt_s: float
) -> Choice:
    """The choice `dt_s` later, on its way to that level."""
    if before is None or option_at(options, before.level) is None:
        return Choice(level)
    fading = before.fade_from is not None and option_at(options, before.fade_from) is not None
    if not fading:
        before = dataclasses.replace(before, fade_from=None, fade=1.0)
    step = dt_s / FADE_S
    if level == before.level or (fading and level != before.fade_from):
        passed = dataclasses.replace(before, fade=before.fade + step, calm_s=calm_s)
    else:
        passed = Choice(level, before.level, 1 - before.fade + step)
    return passed if passed.fade < 1 else dataclasses.replace(passed, fade_from=None, fade=1.0)
