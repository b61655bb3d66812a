"""What a settings file may hold: the observer, the display, the effects and what may be left out, as TOML."""

from __future__ import annotations

import enum
import re
from collections.abc import Sequence
from pathlib import Path

import msgspec

from entoptic.errors import EntopticError
from entoptic.pipeline import Display, Effects, Observer, Planning
from entoptic.pipeline.plan import LEAVABLE

_PLACE = re.compile(r"`\$\.([\w.]+)")
"""How msgspec says where in a file it is."""


class SettingsError(EntopticError):
    """A settings file cannot be used: the message names the file, the key and the remedy."""


class Settings(Effects, frozen=True, forbid_unknown_fields=True):
    """All of it, one table for each: those of the effects and these; what a file leaves out has its default."""

    observer: Observer = Observer()
    display: Display = Display()
    plan: Planning = Planning()


def load(path: Path | None) -> Settings:
    """The settings in a TOML file, or the defaults. Raises SettingsError."""
    if path is None:
        return Settings()
    try:
        return msgspec.toml.decode(path.read_bytes(), type=Settings)
    except OSError as error:
        raise SettingsError(f"settings file {path}: {error.strerror}; give the path of a TOML file") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"settings file {path}: {error}. {_may_hold(str(error))}") from None


def _may_hold(error: str) -> str:
    """What is allowed where the error lies: values of a choice, keys of a table, or the tables."""
    found = _PLACE.search(error)
    table: type[msgspec.Struct] = Settings
    names: list[str] = []
    for name in found[1].split(".") if found else []:
        inner = {field.name: field.type for field in msgspec.structs.fields(table)}.get(name)
        if isinstance(inner, type) and issubclass(inner, enum.Enum):
            return f"{name} may be {', '.join(str(each.value) for each in inner)}"
        if not (isinstance(inner, type) and issubclass(inner, msgspec.Struct)):
            break
        table = inner
        names.append(name)
    keys = ", ".join(table.__struct_fields__)
    return f"[{'.'.join(names)}] may hold {keys}" if names else f"Its tables may be {keys}"


def planned(settings: Settings, budget_ms: float | None, everything: bool, without: Sequence[str]) -> Settings:
    """The settings with what the command line says of planning. Raises SettingsError for an effect that is none."""
    given = {
        # Of what excludes each other, the command line's counts; unless it says both.
        **({} if budget_ms is None else {"budget_ms": budget_ms, "everything": everything}),
        **({"everything": True, "budget_ms": budget_ms} if everything else {}),
        **({"leave_out": list(without)} if without else {}),
    }
    try:
        plan = msgspec.convert({**msgspec.to_builtins(settings.plan), **given}, Planning)
    except msgspec.ValidationError as error:
        raise SettingsError(
            f"--budget-ms, --everything, --without: {error}; effects are {', '.join(LEAVABLE)}"
        ) from None
    return msgspec.structs.replace(settings, plan=plan)
