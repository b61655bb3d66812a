"""One way to run one effect, and how it is measured: errors against its truth, times in turns with its rivals."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from entoptic.pipeline.cost.errors import Errors, OnDisplay, errors_between
from entoptic.pipeline.cost.timing import Times, interleaved
from entoptic.pipeline.cost.ways.stage import Reals, Stage

TRUTH, SKIPPED = "reference", "skipped"
"""What the truth is called as a way of its own; and what leaving an effect out is."""


@dataclasses.dataclass(frozen=True, eq=False)
class Way:
    """One way to run one effect."""

    name: str
    run: Callable[[], Any] | None
    """The program's own, timed; None where the effect is left out."""
    of: str
    """Which truth it stands beside: ways with the same one are rivals, others are other pictures."""
    image: Callable[[Any], Reals]
    """The image that what ran stands for, (3, y, x): in cd/m², or from tone mapping on as a share of the peak."""


@dataclasses.dataclass(frozen=True, eq=False)
class Ways:
    """All ways of an effect on one stage."""

    ways: Sequence[Way]
    truths: dict[str, Callable[[], Reals]]
    """In float64."""
    unit_cd_m2: float = 1.0
    """What an image's 1 is in cd/m²."""
    timed_truth: tuple[str, ...] = ()
    """Truths that are settings of the program, and ways of their own therefore."""


@dataclasses.dataclass(frozen=True)
class Row:
    """One way on one scene."""

    effect: str
    setting: str
    of: str
    scene: str
    errors: Errors
    times: Times | None
    """None where nothing ran."""

    @property
    def median_ms(self) -> float:
        """0 where nothing ran."""
        return 0.0 if self.times is None else self.times.median_ms


def measure_ways(
    effect: str, ways: Ways, stage: Stage, rounds: int, done: Callable[[str], None] = lambda label: None
) -> list[Row]:
    """A row for each way; and one for each truth that is a setting, timed once. `done` is told of each call."""
    timed = interleaved({way.name: way.run for way in ways.ways if way.run is not None}, rounds, done)
    rows = []
    for of, compute in ways.truths.items():
        begun = time.perf_counter()
        truth = compute()
        took_ms = (time.perf_counter() - begun) * 1e3
        done(f"{effect} truth")
        true_shown = OnDisplay(stage.on_display(effect, truth), stage.display)
        for way in ways.ways:
            if way.of != of:
                continue
            ran = timed.get(way.name)
            image = np.asarray(way.image(None if ran is None else ran.result), np.float64)
            errors = errors_between(
                image * ways.unit_cd_m2,
                truth * ways.unit_cd_m2,
                OnDisplay(stage.on_display(effect, image), stage.display),
                true_shown,
            )
            rows.append(Row(effect, way.name, of, stage.scene.name, errors, None if ran is None else ran.times))
        if of in ways.timed_truth:
            name = TRUTH if len(ways.timed_truth) == 1 else f"{TRUTH} of {of}"
            rows.append(Row(effect, name, of, stage.scene.name, NO_ERRORS, Times(took_ms, np.array([took_ms]))))
    return rows


NO_ERRORS = Errors(0.0, 0.0, 0, 0, 0.0, 0.0, 0.0)
