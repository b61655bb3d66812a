"""What is explained: a frame, the eyes before it and the settings, from an image file or a session's key frame."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Array, Float

from entoptic.pipeline import (
    EyePose,
    Frame,
    FrameError,
    Light,
    Perceived,
    Plan,
    Planning,
    RenderState,
    View,
    light_after,
    perceive,
)
from entoptic.pipeline.budget import CostModel
from entoptic.pipeline.scenes import Head, image_file, open_scene
from entoptic.services.config import StillConfig
from entoptic.services.results.appended import columns
from entoptic.services.settings import Settings
from entoptic.tracker_bridge.wire import Eye

PLAN, KEY_FRAMES = "plan.csv", "key_frames/key_frames.json"
ADAPTED = "_adapted_cd_m2"
"""End of plan.csv's columns of what each eye is adapted to, behind its name."""


@dataclasses.dataclass(frozen=True, eq=False)
class Subject:
    """A frame and all that decides how it is perceived."""

    title: str
    frame: Frame
    poses: tuple[EyePose, ...]
    """Of each eye."""
    settings: Settings
    adapted_cd_m2: tuple[float, ...] | None = None
    """Of each eye; None: to this frame."""
    t_s: float | None = None
    """Of a session's frame: when it was."""
    notes: tuple[str, ...] = ()

    def perceived(self, costs: CostModel, planning: Planning | None = None) -> Perceived:
        """As a person perceives it; planned as the settings say unless given otherwise."""
        return perceive(
            self.frame,
            self.poses,
            observer=self.settings.observer,
            display=self.settings.display,
            state=None if self.adapted_cd_m2 is None else RenderState(self.adapted_cd_m2),
            effects=self.settings,
            planning=planning or self.settings.plan,
            costs=costs,
        )

    def light_after(self, effect: str, costs: CostModel) -> tuple[Float[Array, "eye 3 y x"], Plan]:
        """Its light in cd/m² as one effect leaves it; see `light_after`."""
        return light_after(
            effect,
            self.frame,
            self.poses,
            observer=self.settings.observer,
            display=self.settings.display,
            state=None if self.adapted_cd_m2 is None else RenderState(self.adapted_cd_m2),
            effects=self.settings,
            planning=self.settings.plan,
            costs=costs,
        )


def refuse_unwritable(path: Path, suffix: str = ".png") -> None:
    """Raises FrameError for a path that no such picture can be written to, before any work is done."""
    if path.suffix.lower() != suffix:
        raise FrameError(f"output {path}: the picture is written as {suffix}; name it {path.with_suffix(suffix)}")
    if path.is_dir():
        raise FrameError(f"output {path}: that is a folder; name a file in it")
    if not path.parent.is_dir():
        raise FrameError(f"output {path}: there is no folder {path.parent}; make it first")


def from_image(image: str, still: StillConfig, settings: Settings) -> Subject:
    """An image, or the first frame of a scene, before one eye. Raises FrameError for what cannot be seen or read."""
    lights = tuple(_light(text) for text in still.lights)
    pose = EyePose(*_direction(still.gaze), still.pupil_diameter_mm)
    scene = open_scene(image, mean_luminance_cd_m2=still.mean_luminance_cd_m2)
    frame = scene.frame(0.0, scene.view_for(still.width_px, still.height_px, still.fov_deg), Head(), (Eye.LEFT,))
    return Subject(
        scene.name,
        dataclasses.replace(frame, lights=lights),
        (pose,),
        settings,
        None if still.adaptation is None else (still.adaptation,),
        notes=tuple(scene.notes),
    )


def _light(text: str) -> Light:
    parts = text.split(",")
    given = [*parts, *["D65", "0"][max(len(parts) - 3, 0) :]]
    try:
        azimuth, elevation, illuminance, spectrum, radius = given
        azimuth_deg, elevation_deg, illuminance_lx, radius_deg = map(float, (azimuth, elevation, illuminance, radius))
    except ValueError:
        raise FrameError(
            f"--light {text!r} is no light: give direction, illuminance, spectrum and radius, like 5,-2,0.3,LED-B3,0.1"
        ) from None
    return Light(azimuth_deg, elevation_deg, illuminance_lx, radius_deg, spectrum)


def _direction(text: str) -> tuple[float, float]:
    """Azimuth and elevation in degrees."""
    try:
        azimuth_deg, elevation_deg = (float(part) for part in text.split(","))
    except ValueError:
        raise FrameError(f"--gaze {text!r} is no direction: give two angles in degrees, like 5,-2") from None
    return azimuth_deg, elevation_deg


def is_session(target: str) -> bool:
    """Whether that is a folder that a session left."""
    return (Path(target) / PLAN).is_file()


def from_session(folder: Path, frame_number: int | None, settings: Settings | None) -> Subject:
    """A key frame of a session: the one nearest to `frame_number`, the middle one unless given.

    Adapted luminance, pupils and gaze are those of that frame; settings those of the session unless given. Raises
    FrameError where the folder lacks something.
    """
    number = _key_frame(folder, frame_number)
    summary = _json(folder / "summary.json")
    row = _row(folder / PLAN, number)
    # In the order of the columns: as the eyes' images lie side by side.
    eyes = tuple(name.removesuffix(ADAPTED) for name in row if name.endswith(ADAPTED))
    path = folder / "key_frames" / f"{number:06d}_scene.exr"
    if not path.is_file():
        raise FrameError(f"{path}: the session kept no scene of this frame; render it again: entoptic session")
    fov_deg = float(summary["config"]["view"]["fov_deg"])
    # Both eyes' images lie side by side.
    images = np.stack(np.split(image_file.read(path).rgb, len(eyes), axis=2))
    frame = Frame.from_rgb(images, fov_deg)
    try:
        used = settings or msgspec.convert(summary["config"]["settings"], Settings)
    except msgspec.ValidationError as error:
        raise FrameError(f"{folder / 'summary.json'}: {error}; give --settings") from None
    return Subject(
        f"{folder.name}, frame {number} at {float(row['t_s']):.2f} s",
        frame,
        tuple(_pose(row, eye, frame.view) for eye in eyes),
        used,
        tuple(float(row[eye + ADAPTED]) for eye in eyes),
        float(row["t_s"]),
    )


def _key_frame(folder: Path, wanted: int | None) -> int:
    kept = [int(each["frame"]) for each in _json(folder / KEY_FRAMES)]
    if not kept:
        raise FrameError(f"{folder / KEY_FRAMES} names no frame; render the session again: entoptic session")
    return kept[len(kept) // 2] if wanted is None else min(kept, key=lambda number: abs(number - wanted))


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise FrameError(f"{path} cannot be read ({error}); is this a folder of entoptic session?") from None


def _row(path: Path, number: int) -> Mapping[str, str]:
    table = columns(path)
    if str(number) in table.get("frame", ()):
        at = table["frame"].index(str(number))
        return {name: cells[at] for name, cells in table.items()}
    raise FrameError(f"{path} has no frame {number}; is the session whole?")


def _pose(row: Mapping[str, str], name: str, view: View) -> EyePose:
    right = (float(row[f"{name}_gaze_x_px"]) - view.width_px / 2) / view.focal_px
    up = (view.height_px / 2 - float(row[f"{name}_gaze_y_px"])) / view.focal_px
    azimuth = math.atan(right)
    elevation = math.atan(up * math.cos(azimuth))
    return EyePose(math.degrees(azimuth), math.degrees(elevation), float(row[f"{name}_pupil_diameter_mm"]))
