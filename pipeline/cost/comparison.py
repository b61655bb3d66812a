"""Settings beside the truth: their errors, and their times in turns."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Array, Float

from entoptic.pipeline.cost.errors import Errors, errors_of
from entoptic.pipeline.cost.scenes import CostScene
from entoptic.pipeline.cost.timing import Times, interleaved
from entoptic.pipeline.frame import Display


@dataclasses.dataclass(frozen=True, eq=False)
class Setting:
    """One way to compute an image."""

    label: str
    """What a plot calls it."""
    names: Mapping[str, str]
    """What it is called in each of the groups that it belongs to."""
    image: Callable[[CostScene], Float[Array, "3 y x"]]
    """In cd/m², linear Rec.709."""
    fresh: bool = True
    """Whether each image makes its kernel anew; or finds it at hand."""
    own_truth: bool = False
    """Whether its truth is another than that of most settings, so that its errors stand apart."""


@dataclasses.dataclass(frozen=True)
class Row:
    """One setting on one scene."""

    group: str
    """What is varied."""
    setting: str
    label: str
    scene: str
    fresh: bool
    """Whether the times hold the making of a kernel."""
    own_truth: bool
    """Whether the errors are against another truth than most rows'."""
    errors: Errors
    times: Times


def compare(
    settings: Sequence[Setting],
    scene: CostScene,
    truth: Float[np.ndarray, "3 y x"],
    rounds: int,
    display: Display,
    done: Callable[[str], None] = lambda label: None,
) -> list[Row]:
    """Each setting's errors against the truth in cd/m², and times over so many rounds; a row for each of its groups.

    `done` is told the label of each call that has ended.
    """
    parts = {setting.label: lambda setting=setting: setting.image(scene) for setting in settings}
    timed = interleaved(parts, rounds, done)
    rows = []
    for setting in settings:
        of_setting = timed[setting.label]
        errors = errors_of(np.asarray(of_setting.result), truth, scene.exposure, display)
        rows += [
            Row(group, name, setting.label, scene.name, setting.fresh, setting.own_truth, errors, of_setting.times)
            for group, name in setting.names.items()
        ]
    return rows


def worst(rows: Sequence[Row]) -> Row:
    """Of rows of one setting in several circumstances, that of the largest relative error, with the times of all.

    Its first call is that of the first row.
    """
    largest = max(rows, key=lambda row: row.errors.relative_l2)
    times = Times(rows[0].times.first_ms, np.concatenate([row.times.steady_ms for row in rows]))
    return dataclasses.replace(largest, times=times)


def pareto(points: Sequence[tuple[float, float]]) -> list[int]:
    """Which points none beats in both values, less being better; in the order of the first value."""
    best, front = np.inf, []
    for k in sorted(range(len(points)), key=lambda k: points[k]):
        if points[k][1] < best:
            best = points[k][1]
            front.append(k)
    return front
