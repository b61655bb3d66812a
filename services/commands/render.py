"""`entoptic render`: one HDR picture as a person perceives it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
import typer

from services.options import Fov, Height, MeanLuminance, SettingsFile, Width
from services.process import prepare_jax
from services.terminal import console


def render(
    image: Annotated[Path, typer.Argument(help="HDR picture or panorama: .hdr or .exr.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="PNG file to write.")] = Path("perceived.png"),
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
    display_peak: Annotated[
        float | None, typer.Option(metavar="CD_M2", min=1, max=20000, help="Peak luminance of the display.")
    ] = None,
    mean_luminance: MeanLuminance = None,
    width: Width = None,
    height: Height = None,
    settings: SettingsFile = None,
) -> None:
    """Perceive one HDR image."""
    prepare_jax()
    from pipeline import Looking
    from services import render as renders
    from services.settings import load

    loaded = load(settings)
    changes = {} if age is None else {"age_years": age}
    loaded = msgspec.structs.replace(loaded, observer=msgspec.structs.replace(loaded.observer, **changes))
    if display_peak is not None:
        display = msgspec.structs.replace(loaded.display, peak_cd_m2=display_peak)
        loaded = msgspec.structs.replace(loaded, display=display)
    renders.run(
        image,
        output,
        loaded,
        Looking(*_direction(gaze), pupil_mm),
        adaptation,
        fov,
        mean_luminance,
        (width, height),
        console,
    )


def _direction(text: str) -> tuple[float, float]:
    try:
        azimuth_deg, elevation_deg = (float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is no direction: give two angles in degrees, like 5,-2", param_hint="--gaze"
        ) from None
    return azimuth_deg, elevation_deg
