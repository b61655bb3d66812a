"""Opens the eye data that a command names."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import replace

from entoptic.services.config import EyesConfig, SourceConfig

if TYPE_CHECKING:
    from entoptic.tracker_bridge.source import Source

SIMULATED_SECONDS = 4.8
"""How long a simulated recording is unless told otherwise."""
LONG_SECONDS = 1800.0
"""The same where a simulated USB tracker plays it by the clock: half an hour is drawn in 2 s."""
ROOM_CD_M2 = 10.0
"""Before live simulated eyes until a light is set."""


def open_eyes(
    eyes: SourceConfig,
    seconds: float | None = None,
    luminance: str | None = None,
    *,
    record_raw: str | None = None,
    begun_ns: int | None = None,
) -> Source:
    """The source that `eyes` names; `seconds` and `luminance` are for simulated ones.

    `record_raw`, `begun_ns`: as of BridgeConfig. Raises SourceError.
    """
    from entoptic.tracker_bridge.source import SourceError
    from entoptic.tracker_bridge.sources import SIMULATED, USB_SIMULATED, TrackerSettings, open_source
    from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedSettings

    simulated = SimulatedSettings(seconds=seconds or SIMULATED_SECONDS, seed=eyes.seed)
    if luminance is not None:
        if eyes.source.removeprefix(USB_SIMULATED) != SIMULATED:
            raise SourceError(f"{eyes.source} has pupils that no luminance drives: leave it out, or name {SIMULATED}")
        from entoptic.services import simulated_light

        simulated = replace(simulated, luminance=simulated_light.read(luminance))
    tracker = TrackerSettings(
        remote=eyes.remote,
        usb_id=eyes.usb_id,
        usb_faults=eyes.usb_faults if isinstance(eyes, EyesConfig) else (),
        usb_begun_ns=begun_ns,
        record_raw=None if record_raw is None else Path(record_raw),
    )
    table_map = None if eyes.table_map is None else Path(eyes.table_map)
    return open_source(eyes.source, table_map=table_map, simulated=simulated, tracker=tracker)


def open_live_eyes(
    eyes: SourceConfig, luminance: str | None, *, record_raw: str | None = None, begun_ns: int | None = None
) -> Source:
    """The same as a live source, whatever it is: simulated eyes have no end, a recording is played by the clock.

    `begun_ns`: when it began on the monotonic clock, if it did before. Raises SourceError.
    """
    from entoptic.tracker_bridge.sources import SIMULATED, USB_SIMULATED
    from entoptic.tracker_bridge.sources.played import Played
    from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedSettings
    from entoptic.tracker_bridge.sources.simulated.live import LiveEyes

    if eyes.source == SIMULATED and eyes.table_map is None:
        from entoptic.services import simulated_light

        light = ((0.0, ROOM_CD_M2),) if luminance is None else simulated_light.read(luminance)
        settings = SimulatedSettings(seed=eyes.seed, luminance=light)
        return LiveEyes(settings, time.monotonic_ns() if begun_ns is None else begun_ns)
    seconds = LONG_SECONDS if eyes.source == USB_SIMULATED + SIMULATED else None
    source = open_eyes(eyes, seconds, luminance, record_raw=record_raw, begun_ns=begun_ns)
    return source if source.info.live else Played(source, time.monotonic_ns() if begun_ns is None else begun_ns)
