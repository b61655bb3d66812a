"""One HDR image, perceived."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pipeline import FrameError, Light, Looking, Perceived, RenderState, perceive
from pipeline.budget import load as load_costs
from pipeline.scenes import Head, open_scene
from pipeline.sinks.images import still_path, write_still
from services.process import cache_folder
from services.settings import Settings
from tracker_bridge.wire import Eye


def run(
    image: Path,
    output: Path,
    settings: Settings,
    looking: Looking,
    adapted_cd_m2: float | None,
    fov_deg: float,
    mean_luminance_cd_m2: float | None,
    size_px: tuple[int | None, int | None],
    lights: tuple[Light, ...],
    console: Console,
) -> None:
    """Perceives the image, writes the PNG and prints the plan. Raises FrameError."""
    if output != (named := still_path(output, settings.display)):
        raise FrameError(f"output {output}: for this display images are written as {named.suffix}; name it {named}")
    if not output.parent.is_dir():
        raise FrameError(f"output {output}: there is no folder {output.parent}; make it first")
    scene = open_scene(str(image), mean_luminance_cd_m2=mean_luminance_cd_m2)
    for note in scene.notes:
        console.print(f"• {escape(note)}")
    frame = scene.frame(0.0, scene.view_for(*size_px, fov_deg), Head(), (Eye.LEFT,))
    frame = dataclasses.replace(frame, lights=lights)
    perceived = perceive(
        frame,
        looking,
        observer=settings.observer,
        display=settings.display,
        state=None if adapted_cd_m2 is None else RenderState((adapted_cd_m2,)),
        effects=settings,
        planning=settings.plan,
        costs=load_costs(cache_folder()),
    )
    write_still(output, perceived.image[0], settings.display)
    console.print(_plan_table(perceived))
    console.print(f"pupil {perceived.pupil_mm[0]:.2f} mm, wrote [b]{escape(str(output))}[/b]", soft_wrap=True)


def _plan_table(perceived: Perceived) -> Table:
    table = Table("effect", "level", "why", "hides at most", "ms")
    for step in perceived.plan:
        milliseconds = perceived.milliseconds.get(step.effect)
        hides = f"{step.bound_code_values:.2g}" if step.bound_code_values else ""
        table.add_row(
            step.effect.value, step.level, step.reason, hides, "" if milliseconds is None else f"{milliseconds:.0f}"
        )
    return table
