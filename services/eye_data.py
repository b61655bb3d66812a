"""Opens the eye data that a command names."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

if TYPE_CHECKING:
    from entoptic.tracker_bridge.source import Source
    from entoptic.tracker_bridge.sources import TrackerSettings

SIMULATED_SECONDS = 4.8
"""How long a simulated recording is unless told otherwise."""
LONG_SECONDS = 1800.0
"""The same where a simulated USB tracker plays it by the clock: half an hour is drawn in 2 s."""
ROOM_CD_M2 = 10.0
"""Before live simulated eyes until a light is set."""


def open_eyes(
    spec: str,
    table_map: Path | None,
    seconds: float | None,
    seed: int,
    luminance: str | None,
    tracker: TrackerSettings | None = None,
) -> Source:
    """The source that `spec` names; `seconds`, `seed` and `luminance` are for simulated eyes. Raises SourceError."""
    from entoptic.tracker_bridge.source import SourceError
    from entoptic.tracker_bridge.sources import SIMULATED, USB_SIMULATED, open_source
    from entoptic.tracker_bridge.sources.simulated import SimulatedSettings

    simulated = SimulatedSettings(seconds=seconds or SIMULATED_SECONDS, seed=seed)
    if luminance is not None:
        if spec.removeprefix(USB_SIMULATED) != SIMULATED:
            raise SourceError(f"{spec} has pupils that no luminance drives: leave it out, or name {SIMULATED}")
        from entoptic.services import simulated_light

        simulated = msgspec.structs.replace(simulated, luminance=simulated_light.read(luminance))
    return open_source(spec, table_map=table_map, simulated=simulated, tracker=tracker)


def open_live_eyes(
    spec: str,
    table_map: Path | None,
    seed: int,
    luminance: str | None,
    tracker: TrackerSettings,
    begun_ns: int | None,
) -> Source:
    """The same as a live source, whatever it is: simulated eyes have no end, a recording is played by the clock.

    `begun_ns`: when it began on the monotonic clock, if it did before. Raises SourceError.
    """
    from entoptic.tracker_bridge.sources import SIMULATED, USB_SIMULATED
    from entoptic.tracker_bridge.sources.played import Played
    from entoptic.tracker_bridge.sources.simulated import SimulatedSettings
    from entoptic.tracker_bridge.sources.simulated_endless import EndlessEyes

    if spec == SIMULATED and table_map is None:
        from entoptic.services import simulated_light

        light = ((0.0, ROOM_CD_M2),) if luminance is None else simulated_light.read(luminance)
        return EndlessEyes(
            SimulatedSettings(seed=seed, luminance=light), time.monotonic_ns() if begun_ns is None else begun_ns
        )
    seconds = LONG_SECONDS if spec == USB_SIMULATED + SIMULATED else None
    tracker = msgspec.structs.replace(tracker, usb_begun_ns=begun_ns)
    source = open_eyes(spec, table_map, seconds, seed, luminance, tracker)
    return source if source.info.live else Played(source, time.monotonic_ns() if begun_ns is None else begun_ns)
