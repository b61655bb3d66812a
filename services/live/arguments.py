"""The command lines of a live session's bridge and worker."""

from __future__ import annotations

from pathlib import Path

from services.live.addresses import Addresses
from services.live.choice import SessionChoice
from tracker_bridge.sources import SIMULATED, USB_SIMULATED


def bridge_arguments(
    choice: SessionChoice, addresses: Addresses, *, begun_ns: int | None, pupil_map: str | None
) -> list[str]:
    """Of `entoptic bridge`; `begun_ns` is when the source began, if it did before."""
    arguments = ["bridge", "--live", "--source", choice.source, "--seed", str(choice.seed), "--lane", choice.lane]
    arguments += ["--states", addresses.states, "--events", addresses.events, "--replay", addresses.replay]
    arguments += ["--control", addresses.bridge, "--screens", addresses.screens, "--answers", addresses.answers]
    if choice.source.removeprefix(USB_SIMULATED) == SIMULATED:
        arguments += ["--sees", addresses.frames]
    arguments += _given("--begun-ns", begun_ns)
    arguments += _given("--map", choice.table_map)
    arguments += _given("--remote", choice.remote)
    arguments += _given("--usb-id", choice.usb_id)
    for fault in choice.usb_fault:
        arguments += ["--usb-fault", fault]
    return [*arguments, *_given("--pupil-map", pupil_map)]


def worker_arguments(choice: SessionChoice, addresses: Addresses, *, settings: Path, checkpoint: Path) -> list[str]:
    """Of `entoptic worker`; `settings` are what it begins with, `checkpoint` what it goes on from."""
    arguments = ["worker", "--live", "--states", addresses.states, "--events", addresses.events]
    arguments += ["--frames", addresses.frames, "--control", addresses.worker, "--resume", str(checkpoint)]
    arguments += ["--settings", str(settings), "--scene", choice.scene, "--fps", str(choice.fps)]
    arguments += ["--fov", str(choice.fov), "--eyes", choice.eyes.value, "--head", choice.head]
    for form in choice.save:
        arguments += ["--save", form.value]
    arguments += _given("--width", choice.width)
    arguments += _given("--height", choice.height)
    return [*arguments, *_given("--mean-luminance", choice.mean_luminance)]


def _given(option: str, value: object) -> list[str]:
    return [] if value is None else [option, str(value)]
