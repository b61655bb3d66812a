"""One record that describes a session: what starts it, what session.json keeps of it, what starts it again."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Final

import msgspec
from msgspec.structs import replace

from entoptic.pipeline import View
from entoptic.pipeline.scenes import Scene, open_scene
from entoptic.pipeline.scenes.head_path import open_head_path
from entoptic.services.config import Eyes, EyesConfig, ViewConfig
from entoptic.services.eye_data import open_eyes
from entoptic.services.process_config import WorkerLinks
from entoptic.services.settings import Settings, check
from entoptic.tracker_bridge import pupil_map
from entoptic.tracker_bridge.source import Source
from entoptic.tracker_bridge.wire import Eye

EYES: Final = {Eyes.LEFT: (Eye.LEFT,), Eyes.RIGHT: (Eye.RIGHT,), Eyes.BOTH: (Eye.LEFT, Eye.RIGHT)}
"""From left to right, as they stand side by side in the output."""


class SessionConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that starts a session, live or not, and that starts it again."""

    eyes: EyesConfig = EyesConfig()
    view: ViewConfig = ViewConfig()
    settings: Settings = Settings()


class WorkerConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How a worker renders what a bridge publishes."""

    links: WorkerLinks
    view: ViewConfig = ViewConfig()
    settings: Settings = Settings()


@dataclasses.dataclass(frozen=True)
class OpenedSession:
    """A session that can be started, and what it names, opened."""

    config: SessionConfig
    """With the size of the view as it is."""
    source: Source
    scene: Scene

    @property
    def view(self) -> View:
        """Of one eye."""
        return view_of(self.config.view)

    @property
    def notes(self) -> tuple[str, ...]:
        """What source and scene have to say."""
        return (*self.source.info.notes, *self.scene.notes)


def open_session(config: SessionConfig) -> OpenedSession:
    """Opens all that a session names, before anything is started.

    Raises SourceError, FrameError, SettingsError or PupilMapError, each one line that names the thing and the remedy.
    """
    check(config.settings)
    scene, view = open_view(config.view)
    open_head_path(view.head)
    if config.eyes.pupil_map is not None:
        pupil_map.read(Path(config.eyes.pupil_map))
    source = open_eyes(config.eyes, view.seconds)
    return OpenedSession(replace(config, view=view), source, scene)


def open_view(view: ViewConfig) -> tuple[Scene, ViewConfig]:
    """The scene, and the view with its size as it is. Raises FrameError."""
    scene = open_scene(view.scene, mean_luminance_cd_m2=view.mean_luminance_cd_m2)
    seen = scene.view_for(view.width_px, view.height_px, view.fov_deg)
    return scene, replace(view, width_px=seen.width_px, height_px=seen.height_px, fov_deg=seen.fov_deg)


def view_of(view: ViewConfig) -> View:
    """The image of one eye, of a view whose size is known."""
    assert view.width_px is not None
    assert view.height_px is not None
    return View(view.width_px, view.height_px, view.fov_deg)
