"""What a live session is made of: eyes, scene, view, settings."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec

from entoptic.services.options import Eyes, Save

DEFAULT_FPS = 24.0


class SessionChoice(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that starts a live session, and that starts it again; ranges as of the command line's options."""

    source: str = "simulated"
    """Eye data: simulated, capture, usb, usb-simulated:RECORDING, or a recording, played by the clock."""
    table_map: str | None = None
    remote: str | None = None
    """Where Pupil Remote listens; its usual place unless given."""
    usb_id: str | None = None
    usb_fault: tuple[str, ...] = ()
    pupil_map: str | None = None
    lane: str = "live"
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0
    seconds: Annotated[float, msgspec.Meta(ge=0.001)] | None = None
    scene: str = "night-street"
    mean_luminance: Annotated[float, msgspec.Meta(ge=1e-9, le=1e9)] | None = None
    fps: Annotated[float, msgspec.Meta(ge=0.1, le=1000.0)] = DEFAULT_FPS
    width: Annotated[int, msgspec.Meta(ge=1, le=16384)] | None = None
    height: Annotated[int, msgspec.Meta(ge=1, le=16384)] | None = None
    fov: Annotated[float, msgspec.Meta(ge=1.0, le=175.0)] = 104.0
    eyes: Eyes = Eyes.LEFT
    head: str = "look-around"
    save: tuple[Save, ...] = (Save.VIDEO,)
    """How a take's frames are kept."""
    settings: dict[str, Any] = {}
    """Of services.settings.Settings, as built-in types; what is left out has its default."""
