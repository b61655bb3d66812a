"""`entoptic render`: one HDR picture as a person perceives it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from entoptic.services.options import (
    AdaptedTo,
    Age,
    BudgetMs,
    Everything,
    Fov,
    Gaze,
    Height,
    MeanLuminance,
    OwnLights,
    PupilMm,
    SettingsFile,
    Width,
    Without,
)
from entoptic.services.process import prepare_jax
from entoptic.services.terminal import console

if TYPE_CHECKING:
    from entoptic.pipeline import Light


def render(
    image: Annotated[Path, typer.Argument(help="HDR picture or panorama: .hdr or .exr.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="PNG file to write.")] = Path("perceived.png"),
    pupil_mm: PupilMm = None,
    gaze: Gaze = "0,0",
    adaptation: AdaptedTo = None,
    age: Age = None,
    fov: Fov = 104.0,
    display_peak: Annotated[
        float | None, typer.Option(metavar="CD_M2", min=1, max=20000, help="Peak luminance of the display.")
    ] = None,
    mean_luminance: MeanLuminance = None,
    width: Width = None,
    height: Height = None,
    settings: SettingsFile = None,
    budget_ms: BudgetMs = None,
    everything: Everything = False,
    without: Without = [],  # noqa: B006 - typer copies it
    glare: Annotated[
        str | None, typer.Option(help="Point-spread function: wave, spe, cie or ijspeert; overrides the settings file.")
    ] = None,
    level: Annotated[
        str | None,
        typer.Option(
            help="How much of it is applied: veil, sources, window, frame or reference, cheapest first; overrides the "
            "settings file."
        ),
    ] = None,
    light: OwnLights = [],  # noqa: B006 - typer copies it
) -> None:
    """Perceive one HDR image."""
    prepare_jax()
    from entoptic.pipeline import EyePose, Glare
    from entoptic.services import render as renders
    from entoptic.services.explain.subject import from_image
    from entoptic.services.settings import load, planned

    loaded = planned(load(settings), budget_ms, everything, without)
    replace = msgspec.structs.replace
    observer = loaded.observer if age is None else replace(loaded.observer, age_years=age)
    display = loaded.display if display_peak is None else replace(loaded.display, peak_cd_m2=display_peak)
    try:
        chosen = msgspec.convert(
            {
                **msgspec.to_builtins(loaded.glare),
                **({} if glare is None else {"model": glare}),
                **({} if level is None else {"level": level}),
            },
            Glare,
        )
    except msgspec.ValidationError as error:
        raise typer.BadParameter(f"{error}; see --help", param_hint="--glare and --level") from None
    seen = from_image(
        str(image),
        replace(loaded, observer=observer, display=display, glare=chosen),
        EyePose(*direction_of(gaze), pupil_mm),
        adaptation,
        fov,
        mean_luminance,
        (width, height),
        tuple(light_of(text) for text in light),
    )
    renders.run(seen, output, console)


def light_of(text: str) -> Light:
    """The light that `--light` names. Raises BadParameter."""
    from entoptic.pipeline import Light

    parts = text.split(",")
    given = [*parts, *["D65", "0"][max(len(parts) - 3, 0) :]]
    try:
        azimuth, elevation, illuminance, spectrum, radius = given
        azimuth_deg, elevation_deg, illuminance_lx, radius_deg = map(float, (azimuth, elevation, illuminance, radius))
        return Light(azimuth_deg, elevation_deg, illuminance_lx, radius_deg, spectrum)
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is no light: give direction, illuminance, spectrum and radius, like 5,-2,0.3,LED-B3,0.1",
            param_hint="--light",
        ) from None


def direction_of(text: str) -> tuple[float, float]:
    """The direction that `--gaze` names, azimuth and elevation in degrees. Raises BadParameter."""
    try:
        azimuth_deg, elevation_deg = (float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is no direction: give two angles in degrees, like 5,-2", param_hint="--gaze"
        ) from None
    return azimuth_deg, elevation_deg
