"""Calls that take turns, each timed."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping
from typing import Generic, TypeVar

import jax
import numpy as np
from numpy.typing import NDArray

Result = TypeVar("Result")


@dataclasses.dataclass(frozen=True)
class Times:
    """How long a call takes."""

    first_ms: float
    """The first in this process: with compiling, and with making what later calls have at hand."""
    steady_ms: NDArray[np.float64]
    """Of each later round; of the first where there is no other."""

    @property
    def median_ms(self) -> float:
        """Of the later rounds."""
        return float(np.median(self.steady_ms))

    @property
    def middle_half_ms(self) -> tuple[float, float]:
        """Lower and upper quartile of the later rounds."""
        low, high = np.percentile(self.steady_ms, [25, 75])
        return float(low), float(high)


@dataclasses.dataclass(frozen=True)
class Timed(Generic[Result]):
    """A call's first result and its times."""

    result: Result
    times: Times


def interleaved(
    parts: Mapping[str, Callable[[], Result]], rounds: int, done: Callable[[str], None] = lambda name: None
) -> dict[str, Timed[Result]]:
    """Each part timed to its end, once at first and then `rounds` times in turns: a busy machine slows all alike.

    `done` is told the name of each call that has ended.
    """
    results: dict[str, Result] = {}
    milliseconds: dict[str, list[float]] = {name: [] for name in parts}
    for turn in range(rounds + 1):
        for name, run in parts.items():
            begun = time.perf_counter()
            result = jax.block_until_ready(run())
            milliseconds[name].append((time.perf_counter() - begun) * 1e3)
            if turn == 0:
                results[name] = result
            done(name)
    return {
        name: Timed(results[name], Times(each[0], np.array(each[1:] or each))) for name, each in milliseconds.items()
    }
