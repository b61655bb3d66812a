"""Effects and eyes whose bounds, times and words a test states, so that every figure of a plan follows by hand."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from entoptic.pipeline.budget import CostModel
from entoptic.pipeline.effects.effect import SKIPPED, Cost, Domain, Effect, TileChanges, TileRanges
from entoptic.pipeline.eye_context import EyeContext
from entoptic.pipeline.plan import Planned, Planning, chain, make, make_plan
from entoptic.pipeline.ranges import Change, Range


class MadeUp(msgspec.Struct, frozen=True):
    """What one effect changes of one eye's image."""

    bounds: Mapping[str, float] = msgspec.field(default_factory=lambda: {SKIPPED: 0.0})
    """Of each reduced level, cheapest first: what it changes, in code values."""
    per_light: float = 0.0
    """And this much more for each cd/m² that a tile may hold."""
    typical: float = 1.0
    """How much of that is left where tiles are as bright all over as they are on average."""
    luminance: float | None = None
    """The change of Y, where it differs from the others'."""
    grows: float = 1.0
    """What it makes of a change before it; of light too where it cannot be left out."""
    on: bool = True
    reducible: bool = True
    """Whether there is any level short of the full one."""


class MadeUpEffect(Effect[Any, None]):
    """One effect whose settings are `MadeUp`."""

    Settings = MadeUp
    costs: Mapping[str, Cost] = {}

    def __init__(self, name: str, domain: Domain, *, optional: bool = True, seen_by_threshold: bool = False) -> None:
        self.name, self.domain, self.optional = name, domain, optional  # type: ignore[misc]
        self.seen_by_threshold = seen_by_threshold  # type: ignore[misc]
        self.asked: list[tuple[TileChanges, TileRanges]] = []

    def is_on(self, settings: MadeUp) -> bool:
        return settings.on

    def full_level(self, settings: MadeUp) -> str:
        return "best"

    def reduced_levels(self, settings: MadeUp) -> Sequence[str]:
        return tuple(settings.bounds) if settings.reducible else ()

    def required(self, eyes: Sequence[EyeContext], settings: MadeUp) -> str | None:
        return None if self.optional else "always"

    def affected_tiles(self, ranges: TileRanges, eye: EyeContext, settings: MadeUp) -> NDArray[np.bool_] | None:
        return eye.dark if self.name == "acuity" else None  # type: ignore[attr-defined]

    def apply(self, *_: Any) -> Any:
        raise AssertionError("planning draws nothing")

    def bound(self, ranges: TileRanges, eye: EyeContext, settings: MadeUp, level: str) -> Change:
        of = eye.bounds.get(self.name, settings)  # type: ignore[attr-defined]
        change = np.full((4, 1, 1), of.bounds[level]) + of.per_light * ranges.image.high
        change *= 1.0 if eye.measured is LIGHT else of.typical
        if of.luminance is not None:
            change[3] = of.luminance
        return change

    def propagate(self, changes: TileChanges, ranges: TileRanges, eye: EyeContext, settings: MadeUp) -> Change:
        self.asked.append((changes, ranges))
        return settings.grows * changes.image

    def ranges_after(self, ranges: TileRanges, hidden: Change, eye: EyeContext, settings: MadeUp) -> Range:
        if self.optional:
            return super().ranges_after(ranges, hidden, eye, settings)
        image = ranges.image
        return Range(settings.grows * image.low, settings.grows * image.high, image.tile_px)

    def reason(self, eye: EyeContext, settings: MadeUp) -> str:
        return f"{self.name} of {eye.called}"  # type: ignore[attr-defined]

    def oracle(self, *_: Any) -> Any:
        raise AssertionError("planning asks no oracle")

    def variants(self) -> Mapping[str, MadeUp]:
        return {}


SCATTER = MadeUpEffect("glare", Domain.SCENE, seen_by_threshold=True)
BLUR = MadeUpEffect("acuity", Domain.SCENE)
TONE = MadeUpEffect("tone", Domain.DISPLAY, optional=False)
TINT = MadeUpEffect("night_colour", Domain.DISPLAY)


LIGHT, TYPICAL = (SimpleNamespace(range_cd_m2=Range(np.zeros((4, 1, 1)), np.ones((4, 1, 1)), 16)) for _ in range(2))
"""What an eye measures: tiles of 0 to 1 cd/m²."""


@dataclasses.dataclass(frozen=True)
class MadeUpEye:
    """As far as planning looks at one."""

    effects: Any
    called: str = "one"
    threshold_cd_m2: float = 0.25
    bounds: Mapping[str, MadeUp] = dataclasses.field(default_factory=dict)
    """Those that differ from the settings."""
    dark: NDArray[np.bool_] | None = None
    lights: tuple[str, ...] = ()
    display: str = "a display"
    time_s: float = 0.0
    measured: Any = dataclasses.field(default_factory=lambda: LIGHT)

    @property
    def frame(self) -> Any:
        return SimpleNamespace(rgb_cd_m2=np.zeros((1, 3, 1000, 1000)))

    @property
    def adapted(self) -> Any:
        return SimpleNamespace(threshold_cd_m2=lambda adaptation: self.threshold_cd_m2)


COSTS = CostModel(
    {
        **{part: {"whole": Cost(1.0, 0.0)} for part in ("measure", "plan", "encode")},
        "tone": {"best": Cost(1.0, 1.0)},
        "glare": {"coarse": Cost(0.0, 4.0), "best": Cost(0.0, 10.0)},
        "acuity": {"best": Cost(0.0, 20.0)},
        "night_colour": {"best": Cost(0.0, 30.0)},
    }
)
"""Whatever is planned, a megapixel takes 5 ms."""


def settings(**of_effects: MadeUp) -> Any:
    """All effects' settings: those not named may be left out at no loss."""
    names = ("glare", "acuity", "tone", "night_colour")
    return SimpleNamespace(adaptation=None, **{name: of_effects.get(name, MadeUp()) for name in names})


def planned(
    eyes: MadeUpEye | Sequence[MadeUpEye],
    planning: Planning = Planning(),
    *,
    scene_ms: float | None = None,
    **more: Any,
) -> Planned:
    """The plan for such eyes."""
    both = [eyes] if isinstance(eyes, MadeUpEye) else list(eyes)
    costs = COSTS if scene_ms is None else COSTS.beside_scene(Cost(scene_ms, 0.0))
    return make_plan(both, planning, costs=costs, **more)  # type: ignore[arg-type]


def use(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plans know these effects alone; one code value is a change of 1."""
    for module in (chain, make):
        monkeypatch.setattr(module, "EFFECTS", (SCATTER, BLUR, TONE, TINT))
    monkeypatch.setattr(chain, "code_values", lambda change, shown, display: change[:3].max(0))
    monkeypatch.setattr(chain, "averaged", lambda measured: TYPICAL)
