"""The best levels within a budget, against trying them all."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.budget import Option, choose, counted_error
from entoptic.pipeline.budget.choose import Options

LADDER = {
    "glare": (
        Option("skipped", 40.0, 0.0),
        Option("veil", 12.0, 24.0),
        Option("sources", 5.0, 41.0),
        Option("window", 0.4, 87.0),
        Option("frame", 0.0, 165.0),
    ),
    "acuity": (Option("skipped", 3.0, 0.0), Option("dark tiles", 0.1, 9.0), Option("all", 0.0, 38.0)),
    "tone": (Option("aces", 0.0, 7.0),),
}

# Quarters of milliseconds and of code values: sums are exact, so ties are ties.
quarters = st.integers(0, 200).map(lambda quarter: quarter / 4)
errors = st.one_of(quarters, quarters, st.just(math.inf))
ladders = st.lists(st.tuples(errors, quarters), min_size=1, max_size=5).map(
    lambda drawn: tuple(Option(str(k), error, milliseconds) for k, (error, milliseconds) in enumerate(drawn))
)


def tried(options: Options, budget_ms: float) -> tuple[tuple[float, ...], tuple[Option, ...]]:
    """The best of all combinations."""
    ranked = []
    for combination in itertools.product(*options.values()):
        milliseconds = sum(option.ms for option in combination)
        counted = [counted_error(option.error_code_values) for option in combination]
        finite = sum(error for error in counted if error < math.inf)
        over = max(milliseconds - budget_ms, 0.0)
        rank = (over > 0, milliseconds if over else 0.0, counted.count(math.inf), finite, milliseconds)
        ranked.append((rank, combination))
    return min(ranked, key=lambda each: each[0])


@given(st.lists(ladders, min_size=1, max_size=4), st.integers(0, 400).map(lambda quarter: quarter / 4))
def test_no_combination_is_better(drawn: list[tuple[Option, ...]], budget_ms: float) -> None:
    options = {str(k): ladder for k, ladder in enumerate(drawn)}
    levels = choose(options, budget_ms)
    chosen = tuple(next(o for o in options[effect] if o.level == level) for effect, level in levels.items())
    rank, _ = tried(options, budget_ms)
    assert tried({effect: (option,) for effect, option in zip(options, chosen, strict=True)}, budget_ms)[0] == rank


def test_without_a_budget_each_effect_takes_its_cheapest_level_within_the_tolerance() -> None:
    assert choose(LADDER) == {"glare": "window", "acuity": "dark tiles", "tone": "aces"}
    assert choose(LADDER, tolerance_code_values=4.0) == {"glare": "window", "acuity": "skipped", "tone": "aces"}
    assert (counted_error(0.5), counted_error(0.501), counted_error(3.0, 3.0)) == (0, 0.501, 0)
    assert choose({"a": (Option("skipped", 0.5, 0.0), Option("all", 0.0, 1.0))}) == {"a": "skipped"}
    assert choose(LADDER, tolerance_code_values=0.0) == {"glare": "frame", "acuity": "all", "tone": "aces"}


@pytest.mark.parametrize(
    ("budget_ms", "levels"),
    [
        (103.0, ("window", "dark tiles")),
        (100.0, ("window", "skipped")),
        (90.0, ("sources", "dark tiles")),
        (50.0, ("sources", "skipped")),
        (40.0, ("veil", "dark tiles")),
        (16.0, ("skipped", "dark tiles")),
        (7.0, ("skipped", "skipped")),
        (1.0, ("skipped", "skipped")),
        (-1.0, ("skipped", "skipped")),
    ],
)
def test_a_tighter_budget_pays_with_the_least_error(budget_ms: float, levels: tuple[str, str]) -> None:
    assert tuple(choose(LADDER, budget_ms).values()) == (*levels, "aces")


def test_of_equal_errors_the_cheapest_is_taken_wherever_it_stands() -> None:
    alike = (Option("slow", 2.0, 9.0), Option("quick", 2.0, 1.0), Option("slower", 2.0, 10.0))
    assert choose({"a": alike}) == {"a": "quick"}
    assert choose({"a": (Option("rough", 0.4, 5.0), Option("fine", 0.1, 5.0))}) == {"a": "fine"}


def test_a_bound_is_better_than_none() -> None:
    options = {
        "a": (Option("unknown", math.inf, 0.0), Option("bounded", 900.0, 10.0)),
        "b": (Option("unknown", math.inf, 0.0), Option("bounded", 1.0, 10.0)),
    }
    assert choose(options) == {"a": "bounded", "b": "bounded"}
    assert choose(options, 10.0) == {"a": "unknown", "b": "bounded"}


def test_many_effects_with_many_levels_are_no_work() -> None:
    options = {
        f"effect {k}": tuple(Option(str(j), 10.0 / (j + 1) + k, j * (3.0 + k) + 0.1 * k) for j in range(8))
        for k in range(9)
    }
    levels = choose(options, 100.0)
    assert sum(next(o.ms for o in options[e] if o.level == level) for e, level in levels.items()) <= 100
    assert choose({}) == {}
