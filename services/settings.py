"""Settings of the observer, the display, the effects and of planning: as records, as TOML files, on command lines."""

from __future__ import annotations

import difflib
import enum
import operator
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from entoptic.atomic_file import output_errors, write_bytes
from entoptic.errors import EntopticError
from entoptic.pipeline import EFFECTS, OPTIONAL, Display, Effects, Observer, Planning
from entoptic.services.config import ObserverConfig, SettingsConfig
from entoptic.services.records import leaves

_PLACE = re.compile(r"`\$\.([\w.]+)")
"""How msgspec says where in a file it is."""


class SettingsError(EntopticError):
    """A settings file cannot be used: the message names the file, the key and the remedy."""


class Settings(Effects, frozen=True, forbid_unknown_fields=True):
    """All of it, one table for each: those of the effects and these; what a file leaves out has its default."""

    observer: Observer = Observer()
    display: Display = Display()
    plan: Planning = Planning()


def load(path: str | Path | None) -> Settings:
    """The settings in a TOML file, or the defaults. Raises SettingsError."""
    if path is None:
        return Settings()
    try:
        return msgspec.toml.decode(Path(path).read_bytes(), type=Settings)
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


def write(path: Path, settings: Settings) -> None:
    """Writes all settings as TOML: reading the file gives the same ones. Raises OutputError if it cannot."""
    lines = ["# Settings of one person; every command takes them by --settings."]
    _table(lines, msgspec.to_builtins(settings), "")
    with output_errors(path):
        write_bytes(path, "\n".join([*lines, ""]).encode())


def _table(lines: list[str], values: dict[str, object], name: str) -> None:
    if name:
        lines += ["", f"[{name}]"]
    for key, value in values.items():
        # TOML has no null: what is not there has its default.
        if value is not None and not isinstance(value, dict):
            # Numbers, truth values and strings of JSON are TOML's too, but for DEL, which JSON leaves as it is.
            text = msgspec.json.encode(value).decode().replace("\x7f", "\\u007f")
            lines.append(f"{key} = {text}")
    for key, value in values.items():
        if isinstance(value, dict):
            _table(lines, value, f"{name}.{key}" if name else key)


def refuse_unwritable(path: Path) -> None:
    """Raises SettingsError if no settings could be written there, before the work is done."""
    if path.suffix.lower() != ".toml":
        raise SettingsError(f"--save-observer {path}: settings are a TOML file; name it like my_eye.toml")
    if path.is_dir() or not path.parent.is_dir():
        reason = "is a folder" if path.is_dir() else f"lies in {path.parent}, which is no folder"
        raise SettingsError(f"--save-observer {path} {reason}; name a file in a folder that is there")


def of(config: ObserverConfig, own: Settings | None = None) -> Settings:
    """The settings of a command line: its file's, or its subject's `own`, with what it says beside.

    Raises SettingsError.
    """
    settings = own if own is not None and config.file is None else load(config.file)
    try:
        settings = changed(settings, dict(_change(text) for text in config.changes))
    except ValueError as error:
        raise SettingsError(f"--set: {error}") from None
    if not isinstance(config, SettingsConfig):
        return settings
    given: dict[str, Any] = {
        # Of what excludes each other, the command line's counts; unless it says both.
        **({} if config.budget_ms is None else {"budget_ms": config.budget_ms, "everything": config.everything}),
        **({"everything": True, "budget_ms": config.budget_ms} if config.everything else {}),
        **({"leave_out": config.without} if config.without else {}),
    }
    try:
        return changed(settings, {f"plan.{name}": value for name, value in given.items()})
    except ValueError as error:
        raise SettingsError(
            f"--budget-ms, --everything, --without: {error}; effects are {', '.join(OPTIONAL)}"
        ) from None


def check(settings: Settings) -> None:
    """Raises FrameError where a file that the settings name cannot be used."""
    for effect in EFFECTS:
        effect.check(effect.settings_of(settings))


def files_of(settings: Settings) -> dict[str, tuple[str, str]]:
    """The files that settings name, by what they are: each with the setting's path, and its own."""
    named = {leaf.extra["file"]: leaf.path for leaf in leaves(Settings) if "file" in leaf.extra}
    found = {what: (path, operator.attrgetter(path)(settings)) for what, path in named.items()}
    return {what: (path, file) for what, (path, file) in found.items() if file}


def changed(settings: Settings, changes: Mapping[str, Any], *, from_defaults: bool = False) -> Settings:
    """Settings with some changed, by their paths. Raises ValueError that names the field and its range."""
    values = {} if from_defaults else msgspec.to_builtins(settings)
    known = {leaf.path: leaf for leaf in leaves(Settings)}
    for path, value in changes.items():
        if path not in known:
            near = [name for name in known if name.startswith(path)] or difflib.get_close_matches(path, known, 1)
            raise ValueError(f"there is no setting {path!r}" + (f"; is it {near[0]}?" if near else ""))
        *tables, name = path.split(".")
        table = values
        for each in tables:
            table = table.setdefault(each, {})
        table[name] = value
    try:
        return msgspec.convert(values, Settings)
    except msgspec.ValidationError as error:
        found = _PLACE.search(str(error))
        leaf = known.get(found[1]) if found else None
        choices = leaf is not None and issubclass(leaf.kind, enum.Enum) and ", ".join(map(str, leaf.kind))
        remedy = f"; it may be {choices}" if choices else ""
        raise ValueError(str(error).replace("`$.", "`") + remedy) from None


def _change(text: str) -> tuple[str, Any]:
    """A setting by its path, or by its own name where no other has that. Raises ValueError."""
    path, equals, value = (part.strip() for part in text.partition("="))
    if not equals:
        raise ValueError(f"{text!r} is no setting: give it like observer.age_years=60")
    named = [leaf.path for leaf in leaves(Settings) if leaf.name == path]
    if len(named) > 1:
        raise ValueError(f"{path} is more than one setting: give one of {', '.join(named)}")
    try:
        return (named or [path])[0], msgspec.toml.decode(f"value = {value}")["value"]
    except (msgspec.DecodeError, UnicodeDecodeError):
        return (named or [path])[0], value  # a word, which TOML would have in quotes
