"""The command lines of a session's bridge and worker, live or not."""

from __future__ import annotations

from pathlib import Path

from entoptic.services.live.addresses import Addresses
from entoptic.services.live.choice import SessionChoice
from entoptic.services.options import Pace
from entoptic.tracker_bridge.sources import SIMULATED


def bridge_arguments(
    choice: SessionChoice, addresses: Addresses, *, begun_ns: int | None, pupil_map: str | None
) -> list[str]:
    """Of a live one; `begun_ns` is when the source began, if it did before, `pupil_map` the newest."""
    arguments = ["bridge", "--live", *_source(choice)]
    arguments += ["--states", addresses.states, "--events", addresses.events, "--replay", addresses.replay]
    arguments += ["--control", addresses.bridge, "--screens", addresses.screens, "--answers", addresses.answers]
    if choice.source == SIMULATED:
        arguments += ["--sees", addresses.frames]
    arguments += _given("--begun-ns", begun_ns)
    arguments += _given("--remote", choice.remote)
    arguments += _given("--usb-id", choice.usb_id)
    for fault in choice.usb_fault:
        arguments += ["--usb-fault", fault]
    return [*arguments, *_given("--pupil-map", pupil_map)]


def recorded_bridge_arguments(choice: SessionChoice, tables: Path, light: Path | None) -> list[str]:
    """Of one that waits for its worker; `light` falls into simulated eyes."""
    arguments = ["bridge", *_source(choice), "--wait", "--pace", Pace.READER.value, "--tables", str(tables)]
    arguments += _given("--pupil-map", choice.pupil_map)
    arguments += _given("--seconds", choice.seconds)
    return [*arguments, *_given("--luminance", light)]


def _source(choice: SessionChoice) -> list[str]:
    arguments = ["--source", choice.source, "--seed", str(choice.seed), "--lane", choice.lane]
    return [*arguments, *_given("--map", choice.table_map)]


def worker_arguments(choice: SessionChoice, addresses: Addresses, *, settings: Path, checkpoint: Path) -> list[str]:
    """Of a live one; `settings` are what it begins with, `checkpoint` what it goes on from."""
    arguments = ["worker", "--live", *_rendering(choice, settings)]
    arguments += ["--states", addresses.states, "--events", addresses.events]
    return [*arguments, "--frames", addresses.frames, "--control", addresses.worker, "--resume", str(checkpoint)]


def recorded_worker_arguments(choice: SessionChoice, out: Path, settings: Path) -> list[str]:
    """Of one that renders every frame into a folder; where it hears its bridge is still to be added."""
    arguments = ["worker", "--offline", *_rendering(choice, settings), "--out", str(out)]
    return [*arguments, *_given("--seconds", choice.seconds)]


def _rendering(choice: SessionChoice, settings: Path) -> list[str]:
    arguments = ["--settings", str(settings), "--scene", choice.scene, "--fps", str(choice.fps)]
    arguments += ["--fov", str(choice.fov), "--eyes", choice.eyes.value, "--head", choice.head]
    for form in choice.save:
        arguments += ["--save", form.value]
    arguments += _given("--width", choice.width)
    arguments += _given("--height", choice.height)
    return [*arguments, *_given("--mean-luminance", choice.mean_luminance)]


def _given(option: str, value: object) -> list[str]:
    return [] if value is None else [option, str(value)]
