"""`entoptic explain`: what the planner saw, decided and why, as a picture."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from entoptic.services.command_line import options
from entoptic.services.config import SettingsConfig, StillConfig
from entoptic.services.process import cache_folder, prepare_jax
from entoptic.services.terminal import console


@options
def explain(
    target: Annotated[
        str,
        typer.Argument(
            help="HDR picture or panorama (.hdr, .exr), [b]night-street[/b], or the folder of a session.",
            metavar="IMAGE|SESSION",
        ),
    ],
    still: StillConfig,
    settings: SettingsConfig,
    output: Annotated[Path, typer.Option("--output", "-o", help="PNG file to write.")] = Path("explain.png"),
    frame: Annotated[
        int | None,
        typer.Option(min=0, help="Of a session: the key frame next to this frame; the middle one unless given."),
    ] = None,
) -> None:
    """Show what the planner saw in a frame, what it decided and why, and what that changed.

    Of a session, gaze, pupils and adaptation are those of its frame.
    """
    prepare_jax()
    from entoptic.pipeline import FrameError
    from entoptic.pipeline.budget import SHIPPED
    from entoptic.pipeline.budget import load as load_costs
    from entoptic.services import settings as all_settings
    from entoptic.services.explain import page, subject, timeline, variants

    subject.refuse_unwritable(output)
    session = subject.is_session(target)
    if frame is not None and not session:
        raise FrameError(f"--frame {frame}: {target} is no session; leave --frame out, or name a session's folder")
    course = None
    if session:
        if still != StillConfig():
            raise FrameError("gaze, pupil, light and size of a session are those of its frame: leave their options out")
        folder = Path(target)
        seen = subject.from_session(folder, frame, None if settings.file is None else all_settings.load(settings.file))
        seen = dataclasses.replace(seen, settings=all_settings.of(settings, seen.settings))
        course = timeline.read(folder / subject.PLAN)
    else:
        seen = subject.from_image(target, still, all_settings.of(settings))
    for note in seen.notes:
        console.print(f"• {escape(note)}")
    # An offline session was planned with the shipped costs.
    costs = SHIPPED if session and settings.budget_ms is None else load_costs(cache_folder())
    with console.status("perceiving the frame with and without each effect"):
        explained = variants.explain(seen, costs)
    page.write(output, seen, explained, course)
    console.print(f"wrote [b]{escape(str(output))}[/b]", soft_wrap=True)
