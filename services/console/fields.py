"""Settings as things to move: sliders, switches and choices, read from the records' own ranges and docstrings."""

from __future__ import annotations

import ast
import enum
import functools
import inspect
import itertools
import math
import textwrap
from collections.abc import Iterator
from typing import Any

import msgspec
from msgspec import inspect as types

from entoptic.pipeline.plan import LEAVABLE
from entoptic.services.console.protocol import Field
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
_SLIDER_STEPS = 200
_LOG_RATIO = 30.0
"""From the lowest value to the highest: beyond it a linear slider has no room for the small ones."""


@functools.cache
def fields() -> tuple[Field, ...]:
    """All settings, those to show first first."""
    found = {field.path: field for field in _of(Settings, "", "")}
    first = [found.pop(path) for path in FIRST]
    return (*(msgspec.structs.replace(field, first=True) for field in first), *found.values())


def changed(settings: Settings, changes: dict[str, Any], *, from_defaults: bool = False) -> Settings:
    """Settings with some changed, by their fields' paths. Raises ValueError that names the field and its range."""
    values: dict[str, Any] = {} if from_defaults else msgspec.to_builtins(settings)
    known = {field.path for field in fields()}
    for path, value in changes.items():
        if path not in known:
            raise ValueError(f"there is no setting {path!r}")
        *tables, name = path.split(".")
        table = values
        for each in tables:
            table = table.setdefault(each, {})
        table[name] = value
    try:
        return msgspec.convert(values, Settings)
    except msgspec.ValidationError as error:
        raise ValueError(str(error).replace("`$.", "`")) from None


def _of(record: type[msgspec.Struct], path: str, group: str) -> Iterator[Field]:
    sentences = _sentences(record)
    described = types.type_info(record)
    assert isinstance(described, types.StructType)
    values = record()
    for field in described.fields:
        where = f"{path}.{field.name}" if path else field.name
        if isinstance(field.type, types.StructType):
            title = field.name.replace("_", " ").capitalize()
            yield from _of(field.type.cls, where, f"{group}: {field.name}" if group else title)
        else:
            default = msgspec.to_builtins(getattr(values, field.name))
            yield _field(where, group, field.type, default, sentences.get(field.name, ""))


def _field(path: str, group: str, kind: types.Type, default: Any, sentence: str) -> Field:
    label = _label(path.rpartition(".")[2])
    optional = False
    if isinstance(kind, types.UnionType):
        (kind,) = (one for one in kind.types if not isinstance(one, types.NoneType))
        optional = True
    match kind:
        case types.FloatType() | types.IntType():
            whole = isinstance(kind, types.IntType)
            low, low_open, high = _range(kind, whole)
            start, end = SLIDERS.get(path, (low, high))
            return Field(
                path,
                group,
                label,
                "int" if whole else "number",
                default,
                sentence,
                low=low,
                high=high,
                low_open=low_open,
                slider=SLIDERS.get(path),
                step=1 if whole else _step(start, end),
                log=start is not None and end is not None and start > 0 and end >= _LOG_RATIO * start,
                optional=optional,
            )
        case types.BoolType():
            return Field(path, group, label, "bool", default, sentence)
        case types.EnumType():
            return Field(path, group, label, "choice", default, sentence, options=_options(kind.cls))
        case types.FrozenSetType():
            options = tuple((effect.value, "") for effect in LEAVABLE)
            return Field(path, group, label, "choices", sorted(default), sentence, options=options)
        case types.StrType():
            return Field(path, group, label, "text", default, sentence)
    raise TypeError(f"{path}: nothing to move for {kind}")


def _range(kind: types.FloatType | types.IntType, whole: bool) -> tuple[float | None, bool, float | None]:
    """The lowest value, whether it is itself too low, and the highest one."""
    low, high, low_open = kind.ge, kind.le, False
    if low is None and kind.gt is not None:
        low, low_open = (kind.gt + 1, False) if whole else (kind.gt, True)
    if high is None and kind.lt is not None:
        high = kind.lt - 1 if whole else math.nextafter(kind.lt, -math.inf)
    return low, low_open, high


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


def _options(kind: type[enum.Enum]) -> tuple[tuple[str, str], ...]:
    sentences = _sentences(kind)
    return tuple((str(member.value), sentences.get(member.name, "")) for member in kind)


@functools.cache
def _sentences(record: type) -> dict[str, str]:
    """The string under each field or member, as this project writes them; Python itself does not keep those."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(record)))
    except (OSError, SyntaxError):
        return {}
    (body,) = (node.body for node in tree.body if isinstance(node, ast.ClassDef))
    sentences = {}
    for field, below in itertools.pairwise(body):
        name = _name_of(field)
        if name and isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            sentences[name] = " ".join(str(below.value.value).split())
    return sentences


def _name_of(statement: ast.stmt) -> str | None:
    target: ast.expr | None = None
    if isinstance(statement, ast.AnnAssign):
        target = statement.target
    elif isinstance(statement, ast.Assign) and len(statement.targets) == 1:
        target = statement.targets[0]
    return target.id if isinstance(target, ast.Name) else None
