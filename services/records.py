"""The fields of a record as data: what command lines, the console's forms and the documents are made of."""

from __future__ import annotations

import dataclasses
import enum
import functools
import math
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec
from msgspec import inspect as types

_PYTHON: dict[type, type] = {types.FloatType: float, types.IntType: int, types.BoolType: bool, types.StrType: str}


@dataclasses.dataclass(frozen=True)
class Leaf:
    """One value of a record, or of a record in it."""

    path: str
    """Like `view.fps`."""
    kind: type
    """float, int, bool, str or an enumeration."""
    default: Any
    """As built-in types; msgspec.NODEFAULT where it must be given."""
    many: bool
    """Any number of values."""
    optional: bool
    """None is allowed."""
    low: float | None
    high: float | None
    low_open: bool
    """`low` itself is not allowed."""
    title: str | None
    description: str
    extra: Mapping[str, Any]
    """What msgspec.Meta has as `extra`: how a command line or a form shows it."""

    @property
    def name(self) -> str:
        """Its own name, the last part of its path."""
        return self.path.rpartition(".")[2]


def is_record(kind: object) -> bool:
    """Whether a type is a record."""
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)


@functools.cache
def leaves(record: type[msgspec.Struct]) -> tuple[Leaf, ...]:
    """All values of a record, in order, those of the records in it where they stand."""
    return tuple(_leaves(record, ""))


def _leaves(record: type[msgspec.Struct], prefix: str) -> Iterator[Leaf]:
    described = types.type_info(record)
    assert isinstance(described, types.StructType)
    for field in described.fields:
        path = prefix + field.name
        if isinstance(field.type, types.StructType):
            yield from _leaves(field.type.cls, f"{path}.")
        else:
            default = field.default if field.default_factory is msgspec.NODEFAULT else field.default_factory()
            default = default if default is msgspec.NODEFAULT else msgspec.to_builtins(default, order="deterministic")
            yield _leaf(path, field.type, default)


def leaf_of(name: str, kind: Any, default: Any) -> Leaf:
    """A single value of a type that Annotated and msgspec.Meta describe."""
    return _leaf(name, types.type_info(kind), default)


def _leaf(path: str, kind: types.Type, default: Any) -> Leaf:
    meta: dict[str, Any] = {}
    extra: dict[str, Any] = {}
    optional = many = False
    while True:
        match kind:
            case types.Metadata():
                # What is said outside counts.
                meta = {**(kind.extra_json_schema or {}), **meta}
                extra = {**(kind.extra or {}), **extra}
                kind = kind.type
            case types.UnionType():
                (kind,) = (one for one in kind.types if not isinstance(one, types.NoneType))
                optional = True
            case types.FrozenSetType() | types.VarTupleType() | types.ListType():
                kind, many = kind.item_type, True
            case _:
                break
    low, low_open, high = _range(kind) if isinstance(kind, types.FloatType | types.IntType) else (None, False, None)
    python = _python_type(path, kind)
    # A choice is described by its class.
    description = meta.get("description") or (issubclass(python, enum.Enum) and python.__doc__) or ""
    description = " ".join(description.partition("\n\n")[0].split())
    return Leaf(path, python, default, many, optional, low, high, low_open, meta.get("title"), description, extra)


def _python_type(path: str, kind: types.Type) -> type:
    if isinstance(kind, types.EnumType):
        return kind.cls
    if type(kind) not in _PYTHON:
        raise TypeError(f"{path}: nothing shows a value of {kind}")
    return _PYTHON[type(kind)]


def _range(kind: types.FloatType | types.IntType) -> tuple[float | None, bool, float | None]:
    """The lowest value, whether it is itself too low, and the highest one."""
    whole = isinstance(kind, types.IntType)
    low, high, low_open = kind.ge, kind.le, False
    if low is None and kind.gt is not None:
        low, low_open = (kind.gt + 1, False) if whole else (kind.gt, True)
    if high is None and kind.lt is not None:
        high = kind.lt - 1 if whole else math.nextafter(kind.lt, -math.inf)
    return low, low_open, high


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values by path as tables in tables, as msgspec.convert takes them."""
    tables: dict[str, Any] = {}
    for path, value in values.items():
        *outer, name = path.split(".")
        table = tables
        for each in outer:
            table = table.setdefault(each, {})
        table[name] = value
    return tables


def options_of(kind: type[enum.Enum]) -> tuple[tuple[str, str], ...]:
    """The values of an enumeration, each with a sentence that may be empty."""
    return tuple((str(member.value), getattr(member, "description", "")) for member in kind)
