"""The levels of least error that fit a budget, for all effects at once."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

TOLERANCE_CODE_VALUES = 0.5
"""An error up to here counts as none: half a code value rounds to the same code value."""


class Option(NamedTuple):
    """One way to run an effect, or to skip it."""

    level: str
    error_code_values: float
    """The most by which it may change an output pixel; infinite if no bound is known."""
    ms: float
    """Predicted time; 0 for a skip."""


Options = Mapping[str, Sequence[Option]]
"""By effect; one option or more of each."""


class _Part(NamedTuple):
    """A level for each of the effects so far."""

    counted: tuple[int, float]
    """How many errors are infinite, then the sum of the others that count: less is better, in this order."""
    ms: float
    error: float
    """Sum of all finite errors, also of those that count as none."""
    levels: tuple[str, ...]


def counted_error(error_code_values: float, tolerance_code_values: float = TOLERANCE_CODE_VALUES) -> float:
    """What an error counts: nothing within the tolerance, all of it beyond."""
    return 0.0 if error_code_values <= tolerance_code_values else error_code_values


def choose(
    options: Options, budget_ms: float = math.inf, tolerance_code_values: float = TOLERANCE_CODE_VALUES
) -> dict[str, str]:
    """The level of each effect: together of least counted error within the budget, of these the cheapest.

    Without a budget that is each effect's cheapest level within the tolerance, or its level of least error where none
    is. If nothing fits the budget, each effect's cheapest level. Effects' errors are added: each is a bound. Exact: of
    partial combinations only those are dropped that another beats in both error and time.
    """
    front = [_Part((0, 0.0), 0.0, 0.0, ())]
    for of_effect in options.values():
        front = _undominated([_with(part, option, tolerance_code_values) for part in front for option in of_effect])
    # Sorted by time, and each of less error than the ones before.
    fitting = [part for part in front if part.ms <= budget_ms]
    best = fitting[-1] if fitting else front[0]
    return dict(zip(options, best.levels, strict=True))


def option_at(options: Sequence[Option], level: str) -> Option | None:
    """The option of that level, if there is one."""
    return next((option for option in options if option.level == level), None)


def _with(part: _Part, option: Option, tolerance_code_values: float) -> _Part:
    unbounded = math.isinf(option.error_code_values)
    error = 0.0 if unbounded else option.error_code_values
    infinite, counted = part.counted
    return _Part(
        (infinite + unbounded, counted + counted_error(error, tolerance_code_values)),
        part.ms + option.ms,
        part.error + error,
        (*part.levels, option.level),
    )


def _undominated(parts: Sequence[_Part]) -> list[_Part]:
    kept: list[_Part] = []
    for part in sorted(parts, key=lambda part: (part.ms, part.counted, part.error)):
        if not kept or part.counted < kept[-1].counted:
            kept.append(part)
    return kept
