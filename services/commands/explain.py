"""`entoptic explain`: what the planner saw, decided and why, as a picture."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer
from msgspec.structs import replace
from rich.markup import escape
from rich.progress import Progress

from entoptic.services.commands.render import direction_of, light_of
from entoptic.services.options import (
    AdaptedTo,
    Age,
    BudgetMs,
    Fov,
    Gaze,
    Height,
    MeanLuminance,
    OwnLights,
    PupilMm,
    SettingsFile,
    Width,
)
from entoptic.services.process import cache_folder, prepare_jax
from entoptic.services.terminal import console


def explain(
    target: Annotated[
        str,
        typer.Argument(
            help="HDR picture or panorama (.hdr, .exr), [b]night-street[/b], or the folder of a session.",
            metavar="IMAGE|SESSION",
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="PNG file to write.")] = Path("explain.png"),
    frame: Annotated[
        int | None,
        typer.Option(min=0, help="Of a session: the key frame next to this frame; the middle one unless given."),
    ] = None,
    pupil_mm: PupilMm = None,
    gaze: Gaze = "0,0",
    adaptation: AdaptedTo = None,
    age: Age = None,
    fov: Fov = 104.0,
    mean_luminance: MeanLuminance = None,
    width: Width = None,
    height: Height = None,
    settings: SettingsFile = None,
    budget_ms: BudgetMs = None,
    light: OwnLights = [],  # noqa: B006 - typer copies it
) -> None:
    """Show what the planner saw in a frame, what it decided and why, and what that changed.

    Of a session, gaze, pupils and adaptation are those of its frame.
    """
    prepare_jax()
    from entoptic.pipeline import EyePose, FrameError
    from entoptic.pipeline.budget import SHIPPED
    from entoptic.pipeline.budget import load as load_costs
    from entoptic.services.explain import page, subject, timeline, variants
    from entoptic.services.settings import load

    page.refuse_unwritable(output)
    session = subject.is_session(target)
    if frame is not None and not session:
        raise FrameError(f"--frame {frame}: {target} is no session; leave --frame out, or name a session's folder")
    course = None
    if session:
        given = {
            "--pupil-mm": pupil_mm,
            "--adaptation": adaptation,
            "--mean-luminance": mean_luminance,
            "--width": width,
            "--height": height,
            "--light": light or None,
            "--gaze": None if gaze == "0,0" else gaze,
        }
        if ignored := [name for name, value in given.items() if value is not None]:
            raise FrameError(f"{', '.join(ignored)}: of a session they are those of its frame; leave them out")
        seen = subject.from_session(Path(target), frame, None if settings is None else load(settings))
        course = timeline.read(Path(target) / subject.PLAN)
    else:
        seen = subject.from_image(
            target,
            load(settings),
            EyePose(*direction_of(gaze), pupil_mm),
            adaptation,
            fov,
            mean_luminance,
            (width, height),
            tuple(light_of(text) for text in light),
        )
    used = seen.settings
    if age is not None:
        used = replace(used, observer=replace(used.observer, age_years=age))
    if budget_ms is not None:
        used = replace(used, plan=replace(used.plan, budget_ms=budget_ms))
    seen = dataclasses.replace(seen, settings=used)
    for note in seen.notes:
        console.print(f"• {escape(note)}")
    # An offline session was planned with the shipped costs.
    costs = SHIPPED if session and budget_ms is None else load_costs(cache_folder())
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task("perceiving", total=variants.variants())
        explained = variants.explain(seen, lambda: progress.update(bar, advance=1), costs)
    page.write(output, seen, explained, course)
    console.print(f"wrote [b]{escape(str(output))}[/b]", soft_wrap=True)
