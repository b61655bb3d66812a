"""What a worker leaves behind: frames, plan.csv, picture pairs for the report, and a summary of it all."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

import msgspec
import numpy as np

from pipeline import Display, Encoding, Frame, Looking, Perceived, View, as_displayed
from pipeline.effects.encode import encode
from pipeline.plan import Effect
from pipeline.sinks.images import still_path, write_exr, write_png, write_still
from pipeline.sinks.video import Video
from services.options import Save
from tracker_bridge.wire import Eye, EyeState

KEY_FRAMES = 6
"""How many frames of a session are kept as picture pairs."""


@dataclasses.dataclass(frozen=True)
class Rendered:
    """One frame and all that made it."""

    frame_number: int
    t_s: float
    state: EyeState | None
    looking: tuple[Looking, ...]
    frame: Frame
    perceived: Perceived
    scene_ms: float


class Heard(msgspec.Struct, frozen=True):
    """How well a worker heard its bridge."""

    states_received: int
    states_skipped: int
    """Published but not read: by intent in live rendering, lost otherwise."""
    event_gaps: int
    """How often events were missing at first."""
    events_lost: int
    """Events that could not be had again."""
    messages_refused: dict[str, int]
    """By the error's name."""


class WorkerSummary(msgspec.Struct, frozen=True):
    """What a worker did."""

    frames: int
    dropped_frames: int
    """Frames that live rendering left out rather than fall behind."""
    heard: Heard
    perceived_sha256: str
    """Of all perceived frames' code values, in order."""
    median_ms: dict[str, float]
    """Of each part, over the frames in which it ran."""
    share_of_frames: dict[str, float]
    """In which each effect ran."""
    warm_up_s: float
    """Compiling, before the first frame."""


def plan_columns(eyes: Sequence[Eye]) -> list[str]:
    """The header of plan.csv."""
    columns = ["frame", "t_s"]
    for eye in eyes:
        name = eye.name.lower()
        columns += [f"{name}_{quantity}" for quantity in ("phase", "pupil_mm", "gaze_x_px", "gaze_y_px")]
        columns += [f"{name}_{quantity}_cd_m2" for quantity in ("adapted", "mean", "max")]
    for effect in Effect:
        columns += [f"{effect.value}_{quantity}" for quantity in ("level", "reason", "ms")]
    return [*columns, "bound_code_values", "scene_ms", "measure_ms", "kernel_ms", "plan_ms", "encode_ms", "total_ms"]


class Results:
    """Everything a session's frames leave in its folder; a context, whole files only if it is left in peace."""

    def __init__(
        self,
        folder: Path,
        view: View,
        fps: float,
        eyes: tuple[Eye, ...],
        save: frozenset[Save],
        frames: int | None,
        display: Display,
    ) -> None:
        self._display = display
        self._folder, self._view, self._fps, self._eyes, self._save = folder, view, fps, eyes, save
        # A stream of unknown length keeps one picture pair every five seconds.
        self._key_every = max(round(5 * fps) if frames is None else frames // KEY_FRAMES, 1)
        self._hash = hashlib.sha256()
        self._milliseconds: dict[str, list[float]] = {}
        self._runs = dict.fromkeys(Effect, 0)
        self._count = 0
        self._key_frames: list[dict[str, object]] = []
        self._files = contextlib.ExitStack()
        self._video: Video | None = None
        self.dropped = 0

    def __enter__(self) -> Results:
        plan = self._files.enter_context((self._folder / "plan.csv").open("w", newline="", encoding="utf-8"))
        self._plan = csv.writer(plan)
        self._plan.writerow(plan_columns(self._eyes))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._files.__exit__(kind, error, trace)

    def add(self, rendered: Rendered) -> None:
        """Keeps one more frame."""
        image = side_by_side(rendered.perceived.image)
        self._hash.update(rendered.perceived.image.tobytes())
        self._plan.writerow(self._row(rendered))
        name = f"{rendered.frame_number:06d}"
        if Save.VIDEO in self._save:
            if self._video is None:
                height, width = image.shape[:2]
                self._video = self._files.enter_context(
                    Video(self._folder / "perceived.mp4", width, height, self._fps, self._display)
                )
            self._video.write(image)
        if Save.PNG in self._save:
            _folder(self._folder / "frames")
            still = still_path(self._folder / "frames" / name, self._display)
            write_still(still, image, self._display)
        if Save.EXR in self._save:
            _folder(self._folder / "frames")
            linear = side_by_side(np.asarray(rendered.perceived.linear).transpose(0, 2, 3, 1))
            write_exr(self._folder / "frames" / f"{name}.exr", linear)
        if self._count % self._key_every == self._key_every // 2:
            self._keep_pair(rendered, name)
        self._count += 1
        for step in rendered.perceived.plan:
            self._runs[step.effect] += step.runs
        for part, milliseconds in {"scene": rendered.scene_ms, **rendered.perceived.milliseconds}.items():
            self._milliseconds.setdefault(str(part), []).append(milliseconds)

    def _keep_pair(self, rendered: Rendered, name: str) -> None:
        _folder(self._folder / "key_frames")
        # For a web page, whatever the display.
        page = msgspec.structs.replace(self._display, encoding=Encoding.SRGB)
        displayed, perceived = as_displayed(rendered.frame, page), encode(rendered.perceived.linear, page)
        write_png(self._folder / "key_frames" / f"{name}_displayed.png", side_by_side(displayed))
        write_png(self._folder / "key_frames" / f"{name}_perceived.png", side_by_side(perceived))
        scene = side_by_side(np.asarray(rendered.frame.rgb_cd_m2).transpose(0, 2, 3, 1))
        write_exr(self._folder / "key_frames" / f"{name}_scene.exr", scene)
        self._key_frames.append({"frame": rendered.frame_number, "t_s": rendered.t_s})
        (self._folder / "key_frames" / "key_frames.json").write_text(json.dumps(self._key_frames), encoding="utf-8")

    def _row(self, rendered: Rendered) -> list[object]:
        row: list[object] = [rendered.frame_number, f"{rendered.t_s:.6f}"]
        perceived = rendered.perceived
        for k, (eye, looking, measured) in enumerate(
            zip(self._eyes, rendered.looking, perceived.measured, strict=True)
        ):
            x_px, y_px = self._view.pixel_of(looking.azimuth_deg, looking.elevation_deg)
            phase = "none" if rendered.state is None else rendered.state.of(eye).phase.value
            row += [phase, f"{perceived.pupil_mm[k]:.3f}", f"{x_px:.1f}", f"{y_px:.1f}"]
            row += [
                f"{value:.4g}" for value in (perceived.state.adapted_cd_m2[k], measured.mean_cd_m2, measured.max_cd_m2)
            ]
        milliseconds = perceived.milliseconds
        for step in perceived.plan:
            row += [step.level, step.reason, f"{milliseconds.get(step.effect, 0.0):.2f}"]
        total = rendered.scene_ms + sum(milliseconds.values())
        others = (rendered.scene_ms, *(milliseconds[part] for part in ("measure", "kernel", "plan", "encode")), total)
        return [*row, f"{perceived.plan.bound_code_values:.3g}", *(f"{value:.2f}" for value in others)]

    def summary(self, heard: Heard, warm_up_s: float) -> WorkerSummary:
        """All of it in figures."""
        return WorkerSummary(
            frames=self._count,
            dropped_frames=self.dropped,
            heard=heard,
            perceived_sha256=self._hash.hexdigest(),
            median_ms={part: round(float(np.median(times)), 2) for part, times in self._milliseconds.items()},
            share_of_frames={effect.value: runs / max(self._count, 1) for effect, runs in self._runs.items()},
            warm_up_s=round(warm_up_s, 2),
        )


def side_by_side(images: np.ndarray) -> np.ndarray:
    """Images of shape (eye, y, x, 3) beside each other: (y, eye·x, 3)."""
    return np.concatenate(list(images), axis=1)


def _folder(path: Path) -> None:
    path.mkdir(exist_ok=True)
