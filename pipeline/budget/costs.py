"""What each level of each effect takes: a fixed time and one that grows with the pixels it works on.

Shipped figures hold for two cores at 2.5 GHz. `calibrate` measures those of another machine, device_costs.py keeps
them. A machine's speed changes by half from hour to hour, so a live worker corrects the model by each frame's times:
a factor for the machine, which all levels share, and one for each level beyond it.
"""

from __future__ import annotations

import dataclasses
import math
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy.optimize

from entoptic.pipeline.effects import EFFECTS
from entoptic.pipeline.effects.effect import Cost
from entoptic.pipeline.frame import FrameError

CORRECTION = 0.1
"""Share of a frame's deviation that the model takes over. Engineering choice: ten frames, as a machine that turns slow
must be noticed within half a second, and one slow frame must not count as much."""
FORGETTING = 0.0002
"""Share of its own factor that a level loses in each frame in which it does not run. Engineering choice: 5000 frames. A
level given up after a few slow frames would never be measured again, and so never be taken again; but a trial of one
that is truly too dear costs a few frames their budget, so not more than a few a minute.
"""
OUTLIER = 4.0
"""A time off by more than this factor counts as off by this factor: one frame that compiles takes seconds."""
SLOWEST = 100.0
"""Factors lie between this and its inverse: beyond, a clock was wrong."""


Costs = Mapping[str, Mapping[str, Cost]]
"""By effect, then by level."""


class Timing(NamedTuple):
    """How long one effect took in one frame."""

    effect: str
    level: str
    megapixels: float
    """That it worked on, all eyes' together."""
    milliseconds: float


SCENE = "scene"
"""The part of a frame that is its making. Frames that are given have none."""


@dataclasses.dataclass(frozen=True)
class CostModel:
    """Predicted times on one device."""

    costs: Costs
    pace: float = 1.0
    """By how much slower than `costs` the machine is at present."""
    own: Mapping[tuple[str, str], float] = dataclasses.field(default_factory=dict)
    """By how much slower than that a level is, where it was measured lately."""

    def ms(self, effect: str, level: str, megapixels: float) -> float:
        """Predicted time. A level without a figure takes as long as the dearest of its effect.

        Raises FrameError for an effect that has no figure at all.
        """
        return self._cost(effect, level, megapixels).ms(megapixels) * self.pace * self.own.get((effect, level), 1.0)

    def beside_scene(self, cost: Cost) -> CostModel:
        """The same where making a frame takes this."""
        return dataclasses.replace(self, costs={**self.costs, SCENE: {"whole": cost}})

    def scene_ms(self, megapixels: float) -> float:
        """Predicted time of making a frame."""
        return self.ms(SCENE, "whole", megapixels) if SCENE in self.costs else 0.0

    def _cost(self, effect: str, level: str, megapixels: float) -> Cost:
        levels = self.costs.get(effect)
        if not levels:
            raise FrameError(f"what {effect} costs is not known; measure it: entoptic cost --calibrate")
        return levels.get(level) or max(levels.values(), key=lambda cost: cost.ms(megapixels))


SHIPPED = CostModel(
    {
        "measure": {"whole": Cost(1.0, 6.5)},
        "plan": {"whole": Cost(5.0, 0.0)},
        "encode": {"whole": Cost(0.3, 3.2)},
        **{effect.name: effect.costs for effect in EFFECTS},
    }
)
"""Two cores of a Xeon at 2.5 GHz: medians of a night street, 1440×1600, one eye, kernel at hand. How the glare's times
split was measured on frames of 0.14, 0.58 and 2.3 megapixels; the others work pixel by pixel. Not measured: afterimage
and a person's own curve, taken as dear as their like, and planning. Making a new kernel comes on top, once for each
quarter of a millimetre of pupil, whatever is planned."""


def fitted(timings: Iterable[Timing]) -> dict[str, dict[str, Cost]]:
    """Costs that predict the median times best, in relative terms; neither part below 0.

    Of an effect that was measured at one size alone, all time is taken to grow with the pixels.
    """
    found: dict[tuple[str, str], dict[float, list[float]]] = {}
    for timing in timings:
        if timing.milliseconds > 0 and timing.megapixels > 0:
            of_level = found.setdefault((timing.effect, timing.level), {})
            of_level.setdefault(timing.megapixels, []).append(timing.milliseconds)
    costs: dict[str, dict[str, Cost]] = {}
    for (effect, level), by_size in found.items():
        sizes = np.array(list(by_size))
        medians = np.array([np.median(times) for times in by_size.values()])
        if sizes.size == 1:
            cost = Cost(0.0, float(medians[0] / sizes[0]))
        else:
            both, _ = scipy.optimize.nnls(np.stack([1 / medians, sizes / medians], 1), np.ones_like(medians))
            cost = Cost(*map(float, both))
        costs.setdefault(effect, {})[level] = cost
    return costs


def calibrate(
    runs: Sequence[Callable[[], Iterable[Timing]]], rounds: int, done: Callable[[], None] = lambda: None
) -> CostModel:
    """The model of this machine. Each run makes a frame and says what took how long.

    Runs take turns, so that a busy machine slows all alike; the first round compiles and does not count. What no run
    timed keeps its shipped figure, at the pace of what was timed. `done` is told of every run that has ended.
    """
    timings: list[Timing] = []
    for turn in range(rounds + 1):
        for run in runs:
            of_run = list(run())
            timings += of_run if turn else []
            done()
    measured = fitted(timings)
    known = [timing for timing in timings if timing.effect in SHIPPED.costs and timing.milliseconds > 0]
    slower = [
        timing.milliseconds / SHIPPED.ms(timing.effect, timing.level, timing.megapixels)
        for timing in known
        if timing.megapixels > 0
    ]
    pace = float(np.median(slower)) if slower else 1.0
    return CostModel(over_shipped(measured, pace))


def over_shipped(costs: Costs, pace: float = 1.0) -> dict[str, dict[str, Cost]]:
    """Such costs, and for what they lack the shipped ones, this much slower."""
    merged = {
        effect: {level: Cost(cost.fixed_ms * pace, cost.ms_per_megapixel * pace) for level, cost in levels.items()}
        for effect, levels in SHIPPED.costs.items()
    }
    for effect, levels in costs.items():
        merged[effect] = {**merged.get(effect, {}), **levels}
    return merged


def corrected(model: CostModel, timings: Iterable[Timing]) -> CostModel:
    """The model after one more frame: a moving mean, over frames, of the logarithm of measured over predicted.

    The median of all that ran is the machine's, the rest each level's own. Were it their sum, one dear level would
    count as a slow machine, and once it is given up for that, the machine as fast enough to have it back. A level that
    did not run follows the machine, and slowly forgets what was its own. Live rendering alone calls this: its choices
    then depend on the machine, as they should.
    """
    off = {
        (timing.effect, timing.level): _off(timing.milliseconds, predicted)
        for timing in timings
        if timing.effect in model.costs
        and timing.milliseconds > 0
        and (predicted := model.ms(timing.effect, timing.level, timing.megapixels)) > 0
    }
    if not off:
        return model
    # Of one or two none can say which is the machine's.
    together = statistics.median(off.values()) if len(off) > 2 else 0.0
    pace = min(max(model.pace * math.exp(CORRECTION * together), 1 / SLOWEST), SLOWEST)
    own = {key: factor ** (1 - FORGETTING) for key, factor in model.own.items()}
    for key, apart in off.items():
        corrected_own = model.own.get(key, 1.0) * math.exp(CORRECTION * (apart - together))
        own[key] = min(max(corrected_own, 1 / SLOWEST), SLOWEST)
    return dataclasses.replace(model, pace=pace, own=own)


def _off(measured_ms: float, predicted_ms: float) -> float:
    limit = math.log(OUTLIER)
    return min(max(math.log(measured_ms / predicted_ms), -limit), limit)
