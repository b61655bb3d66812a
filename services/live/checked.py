"""Looks at all that a session is to be made of before anything is started."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import msgspec

from entoptic.pipeline import View
from entoptic.pipeline.effects.tone.own_curve import read_curve
from entoptic.pipeline.scenes import Scene, open_scene
from entoptic.pipeline.scenes.head_path import open_head_path
from entoptic.services.eye_data import open_eyes
from entoptic.services.live.choice import SessionChoice
from entoptic.services.settings import Settings, SettingsError
from entoptic.tracker_bridge import pupil_map
from entoptic.tracker_bridge.chain import Lane
from entoptic.tracker_bridge.source import Source, SourceError
from entoptic.tracker_bridge.sources import TrackerSettings
from entoptic.tracker_bridge.sources.pupil_remote import DEFAULT_REMOTE


@dataclasses.dataclass(frozen=True)
class Checked:
    """A choice that can be started, and what it names, opened."""

    choice: SessionChoice
    source: Source
    scene: Scene
    view: View
    settings: Settings

    @property
    def notes(self) -> tuple[str, ...]:
        """What source and scene have to say."""
        return (*self.source.info.notes, *self.scene.notes)


def check(choice: SessionChoice) -> Checked:
    """Opens all that a choice names.

    Raises SourceError, FrameError, SettingsError or PupilMapError, each one line that names the thing and the remedy.
    """
    try:
        settings = msgspec.convert(choice.settings, Settings)
    except msgspec.ValidationError as error:
        raise SettingsError(f"settings: {error}") from None
    if settings.tone.curve:
        read_curve(settings.tone.curve)
    scene = open_scene(choice.scene, mean_luminance_cd_m2=choice.mean_luminance)
    view = scene.view_for(choice.width, choice.height, choice.fov)
    open_head_path(choice.head)
    if choice.lane not in tuple(Lane):
        raise SourceError(f"there is no lane {choice.lane!r}: it is one of {', '.join(Lane)}")
    if choice.pupil_map is not None:
        pupil_map.read(Path(choice.pupil_map))
    tracker = TrackerSettings(remote=choice.remote or DEFAULT_REMOTE, usb_id=choice.usb_id, usb_faults=choice.usb_fault)
    table_map = None if choice.table_map is None else Path(choice.table_map)
    source = open_eyes(choice.source, table_map, choice.seconds, choice.seed, None, tracker)
    return Checked(choice, source, scene, view, settings)
