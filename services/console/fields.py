"""The console's forms: what settings and a session's parts are to move, made of their records."""

from __future__ import annotations

import enum
import functools
import math
from typing import Final

import msgspec

from entoptic.services.config import EyesConfig, ViewConfig
from entoptic.services.console.protocol import Field
from entoptic.services.records import Leaf, leaves, options_of
from entoptic.services.settings import Settings

FIRST = (
    "observer.age_years",
    "observer.iris",
    "observer.particles",
    "observer.particle_mm",
    "observer.defocus_d",
    "observer.ocular_dynamics.lids",
    "observer.ocular_dynamics.lashes",
    "observer.ocular_dynamics.squint",
    "observer.ocular_dynamics.hippus",
    "plan.budget_ms",
)
"""What LUI §5.2.4 lets a person tune, and what a session that falls behind needs."""
SLIDERS = {
    "observer.particles": (0.0, 5000.0),
    "observer.particle_mm": (0.005, 0.2),
    "plan.budget_ms": (5.0, 500.0),
    "rod_noise.seed": (0.0, 100.0),
    "tone.white": (0.5, 100.0),
    "display.peak_cd_m2": (50.0, 2000.0),
    "display.surround_cd_m2": (0.0, 500.0),
}
"""Engineering choice: what people try, where all that is allowed is far more."""
_UNITS = {"years": "years", "mm": "mm", "d": "dpt", "deg": "°", "m2": "cd/m²", "ms": "ms", "values": "code values"}
_KINDS: Final = {float: "number", int: "int", bool: "bool", str: "text"}
_SLIDER_STEPS = 200
_LOG_RATIO = 30.0
"""From the lowest value to the highest: beyond it a linear slider has no room for the small ones."""


@functools.cache
def fields() -> tuple[Field, ...]:
    """All settings, those to show first first."""
    found = {leaf.path: _field(leaf, leaf.path, _group(leaf.path)) for leaf in leaves(Settings)}
    first = [found.pop(path) for path in FIRST]
    return (*(msgspec.structs.replace(field, first=True) for field in first), *found.values())


@functools.cache
def session_fields() -> tuple[Field, ...]:
    """What a session is made of beside its settings, by paths in a SessionConfig; those to show first first."""
    found = [
        _field(leaf, f"{part}.{leaf.path}", "More")
        for part, record in (("eyes", EyesConfig), ("view", ViewConfig))
        for leaf in leaves(record)
    ]
    return tuple(sorted(found, key=lambda field: not field.first))


def _group(path: str) -> str:
    title, *inner = path.split(".")[:-1]
    return ": ".join((title.replace("_", " ").capitalize(), *inner))


def _field(leaf: Leaf, path: str, group: str) -> Field:
    if issubclass(leaf.kind, enum.Enum):
        kind, options = "choices" if leaf.many else "choice", options_of(leaf.kind)
    else:
        kind, options = "texts" if leaf.many else _KINDS[leaf.kind], ()
    start, end = SLIDERS.get(path, (leaf.low, leaf.high))
    number = leaf.kind in (int, float)
    return Field(
        path,
        group,
        leaf.title or _label(leaf.name),
        kind,  # type: ignore[arg-type]
        leaf.default,
        leaf.description,
        first=bool(leaf.extra.get("first")),
        low=leaf.low,
        high=leaf.high,
        low_open=leaf.low_open,
        slider=SLIDERS.get(path),
        step=1 if leaf.kind is int else _step(start, end) if number else None,
        log=start is not None and end is not None and start > 0 and end >= _LOG_RATIO * start,
        optional=leaf.optional,
        options=options,
        list=leaf.extra.get("list"),
    )


def _label(name: str) -> str:
    words = name.split("_")
    unit = _UNITS.get(words[-1]) if len(words) > 1 else None
    if unit == "cd/m²" or unit == "code values":
        words = words[:-2]
    elif unit is not None:
        words = words[:-1]
    return " ".join(words).capitalize() + (f", {unit}" if unit else "")


def _step(low: float | None, high: float | None) -> float | None:
    """About 200 steps, each 1, 2 or 5 times a power of ten."""
    if low is None or high is None:
        return None
    raw = (high - low) / _SLIDER_STEPS
    power = 10.0 ** math.floor(math.log10(raw))
    return round(power * max(factor for factor in (1, 2, 5) if factor * power <= raw), 12)
