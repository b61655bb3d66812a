"""The whole frame: what each combination of levels costs, how far it is from the truth, and which to take.

Effects whose levels approximate something are combined: glare, acuity, night colour. Measuring, adaptation, tone
mapping and encoding run always. A combination's time is the sum of its parts' medians, with the kernel at hand; its
error is that of its own image against float64: the glare reference, the true acuity filter, tone and tint plainly.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from entoptic.pipeline.cost.comparison import pareto
from entoptic.pipeline.cost.errors import Errors, OnDisplay, errors_between
from entoptic.pipeline.cost.plain import acuity as plain_acuity
from entoptic.pipeline.cost.plain import night_colour as plain_night
from entoptic.pipeline.cost.plain import tone as plain_tone
from entoptic.pipeline.cost.timing import interleaved
from entoptic.pipeline.cost.ways.stage import Reals, Stage
from entoptic.pipeline.cost.ways.way import SKIPPED
from entoptic.pipeline.effects import acuity, adaptation, night_colour, tone
from entoptic.pipeline.effects.encode import encode
from entoptic.pipeline.effects.glare import Glare, GlareLevel
from entoptic.pipeline.effects.glare.reference import of_mixture, reference_glare
from entoptic.pipeline.effects.night_colour import NightColour
from entoptic.pipeline.effects.tone import Tone
from entoptic.pipeline.measure import measure

GLARES = (SKIPPED, *(level.value for level in GlareLevel if level is not GlareLevel.REFERENCE))
ALWAYS = ("measure", "adaptation", "tone", "encode")
"""The parts that every frame needs."""
Size = tuple[int, int]
"""Width and height in pixels."""


@dataclasses.dataclass(frozen=True, order=True)
class Combination:
    """A level of each effect."""

    glare: str
    acuity: str
    night_colour: str

    def __str__(self) -> str:
        return f"glare {self.glare}, acuity {self.acuity}, night colour {self.night_colour}"


COMBINATIONS = tuple(Combination(*levels) for levels in itertools.product(GLARES, (SKIPPED, "fit"), (SKIPPED, "lui")))


@dataclasses.dataclass(frozen=True)
class Whole:
    """One combination on one scene."""

    combination: Combination
    scene: str
    errors: Errors
    milliseconds: Mapping[Size, float]
    """One eye's frame, at each size."""


def parts(stage: Stage) -> dict[str, Callable[[], Any]]:
    """All that combinations are made of, as `effect` or `effect level`, each to be called alone."""
    frame, adapted, display = stage.scene.frame, stage.adapted_cd_m2, stage.display
    rgb, shown = frame.rgb_cd_m2, jnp.asarray(stage.shown)[None]
    return {
        "measure": lambda: measure(frame),
        "adaptation": lambda: adaptation.target_cd_m2(stage.scene.measured, 0.0, 0.0),
        "tone": lambda: tone.show(rgb, [adapted], [adapted], Tone(), display),
        "encode": lambda: encode(shown, display),
        "acuity fit": lambda: acuity.dark_acuity(rgb),
        "night_colour lui": lambda: night_colour.shift(shown, [adapted], NightColour()),
        **{
            f"glare {level}": functools.partial(stage.glare, Glare(level=GlareLevel(level)))
            for level in GLARES
            if level != SKIPPED
        },
    }


def parts_ms(stage: Stage, rounds: int, done: Callable[[str], None] = lambda label: None) -> dict[str, float]:
    """Median time of each part."""
    return {name: timed.times.median_ms for name, timed in interleaved(parts(stage), rounds, done).items()}


def time_of(combination: Combination, milliseconds: Mapping[str, float]) -> float:
    """Of a frame whose parts take so long."""
    runs = [f"{effect} {level}" for effect, level in dataclasses.asdict(combination).items() if level != SKIPPED]
    return sum(milliseconds[part] for part in (*ALWAYS, *runs))


def errors_of_combinations(stage: Stage, done: Callable[[str], None] = lambda label: None) -> dict[Combination, Errors]:
    """Each combination's image on the display against the truth."""
    rgb = np.asarray(stage.rgb, np.float64)
    truth = plain_acuity.true_filter(
        np.maximum(reference_glare(rgb, stage.scene.frame.view, *of_mixture(stage.kernel())), 0)
    )
    peak = stage.display.peak_cd_m2
    toned = plain_tone.aces(truth, stage.exposure, peak)
    true = OnDisplay(np.clip(plain_night.night_tint(toned, stage.adapted_cd_m2), 0, 1) * peak, stage.display)
    done("truth of the whole frame")
    found = {}
    for combination in COMBINATIONS:
        seen = OnDisplay(_image(combination, stage) * peak, stage.display)
        found[combination] = errors_between(seen.light_cd_m2, true.light_cd_m2, seen, true)
        done(str(combination))
    return found


def _image(combination: Combination, stage: Stage) -> Reals:
    """What the program shows, as a share of the peak."""
    image = stage.scene.frame.rgb_cd_m2
    if combination.glare != SKIPPED:
        image = stage.glare(Glare(level=GlareLevel(combination.glare)))[None]
    if combination.acuity != SKIPPED:
        image = acuity.dark_acuity(image)
    adapted = [stage.adapted_cd_m2]
    shown = tone.show(image, adapted, adapted, Tone(), stage.display)
    if combination.night_colour != SKIPPED:
        shown = night_colour.shift(shown, adapted, NightColour())
    return np.clip(np.asarray(shown[0], np.float64), 0, 1)


@dataclasses.dataclass(frozen=True)
class Choice:
    """What to take at one rate and size."""

    fps: float
    size: Size
    combination: Combination | None
    """None where nothing fits."""
    milliseconds: float
    """Of what is taken, on the slowest scene; where nothing fits, of the cheapest."""
    delta_e_p95: float
    share_changed: float
    """Both of the worst scene."""
    worst_scene: str


def choose(wholes: Sequence[Whole], fps: float, size: Size) -> Choice:
    """The combination of least error in its worst scene that fits the time of a frame in its slowest scene."""
    by_combination: dict[Combination, list[Whole]] = {}
    for whole in wholes:
        by_combination.setdefault(whole.combination, []).append(whole)
    slowest = {combination: max(whole.milliseconds[size] for whole in of) for combination, of in by_combination.items()}
    fitting = [combination for combination, ms in slowest.items() if ms <= 1e3 / fps]
    if not fitting:
        return Choice(fps, size, None, min(slowest.values()), np.nan, np.nan, "")
    best = min(fitting, key=lambda combination: (*_worst(by_combination[combination])[:2], slowest[combination]))
    delta_e, changed, scene = _worst(by_combination[best])
    return Choice(fps, size, best, slowest[best], delta_e, changed, scene)


def _worst(of: Sequence[Whole]) -> tuple[float, float, str]:
    """Largest ΔE below which 95 % of a scene's pixels stay, to what an eye could tell; largest share changed."""
    scene = max(of, key=lambda whole: (round(whole.errors.delta_e_p95, 2), whole.errors.share_changed))
    return (
        round(scene.errors.delta_e_p95, 2),
        max(whole.errors.share_changed for whole in of),
        scene.scene,
    )


def front(wholes: Sequence[Whole], size: Size) -> list[Whole]:
    """Of one scene: what none beats in time and error, cheapest first."""
    points = [(whole.milliseconds[size], whole.errors.delta_e_p95) for whole in wholes]
    return [wholes[k] for k in pareto(points)]
