"""What a settings file may hold: the observer, the display, the effects and what may be left out, as TOML."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from pipeline import Display, Effects, Observer, Planning
from pipeline.plan import LEAVABLE


class SettingsError(Exception):
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
        known = "; ".join(
            f"[{field.name}] {', '.join(field.type.__struct_fields__)}" for field in msgspec.structs.fields(Settings)
        )
        raise SettingsError(f"settings file {path}: {error}. It may hold {known}") from None


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
