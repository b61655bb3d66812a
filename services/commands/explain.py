"""`entoptic explain`: what the planner saw, decided and why, as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.markup import escape
from rich.progress import Progress

from services.commands.render import _direction, _light
from services.options import Fov, Height, MeanLuminance, SettingsFile, Width
from services.process import prepare_jax
from services.terminal import console


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
    pupil_mm: Annotated[
        float | None,
        typer.Option(min=0.5, max=12, help="Pupil diameter; computed from the light and the age unless given."),
    ] = None,
    gaze: Annotated[str, typer.Option(metavar="X,Y", help="Direction of gaze in degrees, right and up.")] = "0,0",
    adaptation: Annotated[
        float | None,
        typer.Option(
            metavar="CD_M2", min=1e-6, max=1e9, help="Luminance the eye is adapted to; the image's unless given."
        ),
    ] = None,
    age: Annotated[float | None, typer.Option(min=1, max=120, help="Years; overrides the settings file.")] = None,
    fov: Fov = 104.0,
    mean_luminance: MeanLuminance = None,
    width: Width = None,
    height: Height = None,
    settings: SettingsFile = None,
    light: Annotated[
        list[str],
        typer.Option(metavar="X,Y,LUX[,SPECTRUM[,RADIUS]]", help="A light of its own, as of [b]entoptic render[/b]."),
    ] = [],  # noqa: B006 - typer copies it
) -> None:
    """Show what the planner saw in a frame, what it decided and why, and what that changed.

    Of a session, gaze, pupils and adaptation are those of its frame.
    """
    prepare_jax()
    from pipeline import FrameError, Looking
    from services.explain import page, subject, timeline, variants
    from services.settings import load

    page.refuse_unwritable(output)
    session = subject.is_session(target)
    if frame is not None and not session:
        raise FrameError(f"--frame {frame}: {target} is no session; leave --frame out, or name a session's folder")
    loaded = None if session and settings is None and age is None else load(settings)
    if loaded is not None and age is not None:
        loaded = msgspec.structs.replace(loaded, observer=msgspec.structs.replace(loaded.observer, age_years=age))
    course = None
    if session:
        subject_ = subject.from_session(Path(target), frame, loaded)
        course = timeline.read(Path(target) / subject.PLAN)
    else:
        subject_ = subject.from_image(
            target,
            load(settings) if loaded is None else loaded,
            Looking(*_direction(gaze), pupil_mm),
            adaptation,
            fov,
            mean_luminance,
            (width, height),
            tuple(_light(text) for text in light),
        )
    for note in subject_.notes:
        console.print(f"• {escape(note)}")
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task("perceiving", total=variants.variants())
        explained = variants.explain(subject_, lambda: progress.update(bar, advance=1))
    page.write(output, subject_, explained, course)
    console.print(f"wrote [b]{escape(str(output))}[/b]", soft_wrap=True)
