"""The console's forms: what settings and a session's parts are to move, made of their records."""

from __future__ import annotations

import enum
import functools
import math
from collections.abc import Iterable
from typing import Final

from entoptic.services.config import EyesConfig, ViewConfig
from entoptic.services.console.protocol import Field
from entoptic.services.records import Leaf, leaves, options_of
from entoptic.services.settings import Settings

_UNITS = {"years": "years", "mm": "mm", "d": "dpt", "deg": "°", "m2": "cd/m²", "ms": "ms", "values": "code values"}
_KINDS: Final = {float: "number", int: "int", bool: "bool", str: "text"}
_SLIDER_STEPS = 200
_LOG_RATIO = 30.0
"""From the lowest value to the highest: beyond it a linear slider has no room for the small ones."""


@functools.cache
def fields() -> tuple[Field, ...]:
    """All settings; first what LUI 5.2.4 lets a person tune, and what a session that falls behind needs."""
    return _first_first(_field(leaf, leaf.path, _group(leaf.path)) for leaf in leaves(Settings))


@functools.cache
def session_fields() -> tuple[Field, ...]:
    """What a session is made of beside its settings, by paths in a SessionConfig; those to show first first."""
    parts = (("eyes", EyesConfig), ("view", ViewConfig))
    return _first_first(_field(leaf, f"{part}.{leaf.path}", "More") for part, kind in parts for leaf in leaves(kind))


def _first_first(found: Iterable[Field]) -> tuple[Field, ...]:
    return tuple(sorted(found, key=lambda field: not field.first))


def _group(path: str) -> str:
    title, *inner = path.split(".")[:-1]
    return ": ".join((title.replace("_", " ").capitalize(), *inner))


def _field(leaf: Leaf, path: str, group: str) -> Field:
    if issubclass(leaf.kind, enum.Enum):
        kind, options = "choices" if leaf.many else "choice", options_of(leaf.kind)
    else:
        kind, options = "texts" if leaf.many else _KINDS[leaf.kind], ()
    # What people try, where all that is allowed is far more.
    slider = leaf.extra.get("slider")
    start, end = slider or (leaf.low, leaf.high)
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
        slider=slider,
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
