"""The costs of each device that was calibrated, one JSON file a device."""

from __future__ import annotations

import os
import platform
import re
from pathlib import Path

import jax
import msgspec

from entoptic.atomic_file import output_errors, write_json
from entoptic.pipeline.budget.costs import SHIPPED, CostModel, over_shipped
from entoptic.pipeline.effects.effect import Cost
from entoptic.pipeline.frame import FrameError

VERSION = 1
"""Of the file's form."""


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a file holds."""

    version: int
    device: str
    costs: dict[str, dict[str, Cost]]
    """By effect, then by level."""


def device_name() -> str:
    """What computes here: the graphics card, or the processor and how many of its cores this process may use."""
    device = jax.devices()[0]
    if device.platform != "cpu":
        return str(device.device_kind)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return f"{processor_name()}, {cores} cores"


def costs_file(folder: Path, device: str | None = None) -> Path:
    """Where the costs of a device, this one unless given, are kept in a folder."""
    plain = re.sub(r"[^a-z0-9]+", "-", (device_name() if device is None else device).lower()).strip("-")
    return folder / f"costs-{plain}.json"


def load(folder: Path, device: str | None = None) -> CostModel:
    """The model of a device, this one unless given: calibrated if it was, shipped if not.

    A level that is newer than the calibration has its shipped figure. Raises FrameError for a file that cannot be
    read.
    """
    path = costs_file(folder, device)
    try:
        kept = msgspec.json.decode(path.read_bytes(), type=_File)
    except FileNotFoundError:
        return SHIPPED
    except OSError as error:
        raise FrameError(f"costs of this device, {path}: {error.strerror}; make it readable or delete it") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise FrameError(
            f"costs of this device, {path}: {error}; delete it, or run: entoptic cost --calibrate"
        ) from None
    if kept.version != VERSION:
        raise FrameError(
            f"costs of this device, {path}: of form {kept.version}, this program writes {VERSION}; run: entoptic cost "
            "--calibrate"
        )
    return CostModel(over_shipped(kept.costs))


def save(model: CostModel, folder: Path, device: str | None = None) -> Path:
    """Keeps what was calibrated on a device, this one unless given, and says where. Raises OutputError."""
    name = device_name() if device is None else device
    path = costs_file(folder, name)
    with output_errors(path):
        folder.mkdir(parents=True, exist_ok=True)
        write_json(path, _File(VERSION, name, {effect: dict(levels) for effect, levels in model.costs.items()}))
    return path


def processor_name() -> str:
    """As the system gives it."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    found = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return found[1].strip() if found else platform.processor() or platform.machine()
