"""A tuned observer as a settings file, which every command reads by --settings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import msgspec

from entoptic.atomic_file import output_errors, write_bytes
from entoptic.pipeline.effects.glare.models import GlareModel
from entoptic.pipeline.observer import Iris
from entoptic.services.settings import Settings, SettingsError


def tuned(settings: Settings, observer: Mapping[str, object], *, lashes: bool | None, model: str | None) -> Settings:
    """Settings with some of the observer's changed; None leaves one as it is.

    Raises SettingsError for an unknown or an illegal value, by its name.
    """
    values = msgspec.to_builtins(settings)
    values["observer"] |= {name: value for name, value in observer.items() if value is not None}
    if lashes is not None:
        values["observer"]["ocular_dynamics"]["lashes"] = lashes
    if model is not None:
        values["glare"]["model"] = model
    try:
        return msgspec.convert(values, Settings)
    except msgspec.ValidationError as error:
        irises, models = (", ".join(kind) for kind in (Iris, GlareModel))
        raise SettingsError(f"{error}; --iris is one of {irises}, --model one of {models}") from None


def refuse_unwritable(path: Path) -> None:
    """Raises SettingsError if no settings could be written there, before the work is done."""
    if path.suffix.lower() != ".toml":
        raise SettingsError(f"--save-observer {path}: settings are a TOML file; name it like my_eye.toml")
    if path.is_dir() or not path.parent.is_dir():
        reason = "is a folder" if path.is_dir() else f"lies in {path.parent}, which is no folder"
        raise SettingsError(f"--save-observer {path} {reason}; name a file in a folder that is there")


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
