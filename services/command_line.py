"""Command lines made of records: names, types, ranges and help are the fields' own.

A parameter of a command whose type is a record (msgspec.Struct) becomes an option for each of the record's fields, and
the command gets the record; one whose type has a msgspec.Meta becomes the same single option as a field of that type.
`extra` of a field's msgspec.Meta may name its `option` (or several), and its `metavar`.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable
from typing import Annotated, Any

import msgspec
import typer
from rich.markup import escape

from entoptic.services.records import Leaf, is_record, leaf_of, leaves, nested

_UNITS = re.compile(r"(?<=.)_(px|deg|s|cd_m2)$")
"""Ends of fields' names that options leave out: their help says the unit."""


def options(command: Callable[..., None]) -> Callable[..., None]:
    """The same command, its records replaced by their fields' options."""
    signature = inspect.signature(command, eval_str=True)
    records: dict[str, type[msgspec.Struct]] = {}
    parameters: list[inspect.Parameter] = []
    for one in signature.parameters.values():
        kind = one.annotation
        if is_record(kind):
            records[one.name] = kind
            parameters += (_parameter(_key(one.name, leaf), leaf) for leaf in leaves(kind))
        elif any(isinstance(meta, msgspec.Meta) for meta in getattr(kind, "__metadata__", ())):
            parameters.append(_parameter(one.name, leaf_of(one.name, kind, one.default)))
        else:
            # By keyword alone, those without a default may come later.
            parameters.append(one.replace(kind=inspect.Parameter.KEYWORD_ONLY))

    @functools.wraps(command)
    def run(**given: Any) -> None:
        built = {name: _build(name, record, given) for name, record in records.items()}
        command(**built, **{name: value for name, value in given.items() if name in signature.parameters})

    run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {one.name: one.annotation for one in parameters}
    return run


def option_names(leaf: Leaf) -> list[str]:
    """How a field is called on the command line."""
    given = leaf.extra.get("option")
    if given is None:
        return ["--" + _UNITS.sub("", leaf.name).replace("_", "-")]
    return [given] if isinstance(given, str) else list(given)


def _parameter(name: str, leaf: Leaf) -> inspect.Parameter:
    kind: Any = list[leaf.kind] if leaf.many else leaf.kind  # type: ignore[name-defined]
    shown = typer.Option(
        *option_names(leaf),
        help=escape(leaf.description),
        metavar=leaf.extra.get("metavar"),
        min=None if leaf.low_open else leaf.low,
        max=leaf.high,
    )
    default = inspect.Parameter.empty if leaf.default is msgspec.NODEFAULT else leaf.default
    return inspect.Parameter(
        name,
        inspect.Parameter.KEYWORD_ONLY,
        default=default,
        annotation=Annotated[kind | None if leaf.optional else kind, shown],
    )


def _key(prefix: str, leaf: Leaf) -> str:
    """Of two records of one command, fields of one name are two parameters."""
    return f"{prefix}__{leaf.path.replace('.', '__')}"


def _build(prefix: str, record: type[msgspec.Struct], given: dict[str, Any]) -> msgspec.Struct:
    """Raises BadParameter that names the option, for a range that typer does not know."""
    values = {leaf.path: given[_key(prefix, leaf)] for leaf in leaves(record)}
    names = {f"$.{leaf.path}": option_names(leaf)[0] for leaf in leaves(record)}
    try:
        return msgspec.convert(nested(values), record)
    except msgspec.ValidationError as error:
        message, _, path = str(error).partition(" - at `")
        raise typer.BadParameter(message, param_hint=names.get(path.rstrip("`").partition("[")[0])) from None
