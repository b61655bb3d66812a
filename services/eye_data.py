"""Opens the eye data that a command names."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

if TYPE_CHECKING:
    from tracker_bridge.source import Source
    from tracker_bridge.sources import TrackerSettings

SIMULATED_SECONDS = 4.8
"""How long a simulated recording is unless told otherwise."""


def open_eyes(
    spec: str,
    table_map: Path | None,
    seconds: float | None,
    seed: int,
    luminance: str | None,
    tracker: TrackerSettings | None = None,
) -> Source:
    """The source that `spec` names; `seconds`, `seed` and `luminance` are for simulated eyes. Raises SourceError."""
    from tracker_bridge.source import SourceError
    from tracker_bridge.sources import SIMULATED, USB_SIMULATED, open_source
    from tracker_bridge.sources.simulated import SimulatedSettings

    simulated = SimulatedSettings(seconds=seconds or SIMULATED_SECONDS, seed=seed)
    if luminance is not None:
        if spec.removeprefix(USB_SIMULATED) != SIMULATED:
            raise SourceError(f"{spec} has pupils that no luminance drives: leave it out, or name {SIMULATED}")
        from services import simulated_light

        simulated = msgspec.structs.replace(simulated, luminance=simulated_light.read(luminance))
    return open_source(spec, table_map=table_map, simulated=simulated, tracker=tracker)
