"""`entoptic psf`: one person's eye as light."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from entoptic.services.command_line import options
from entoptic.services.config import ObserverConfig
from entoptic.services.process import prepare_jax
from entoptic.services.terminal import console


@options
def psf(
    settings: ObserverConfig,
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("psf"),
    pupil_diameter_mm: Annotated[float, typer.Option(min=2, max=8, help="Pupil diameter.")] = 5.0,
    openness: Annotated[float, typer.Option(min=0, max=1, help="How far the lids are open.")] = 1.0,
    spectrum: Annotated[
        str,
        typer.Option(
            metavar="NAME|CSV",
            help="The light: [b]D65[/b], E, A, LED-B3, LED-KRI and the like, or a CSV file nm,value.",
        ),
    ] = "D65",
    wavelengths: Annotated[
        int | None,
        typer.Option(min=4, max=128, help="How many are summed; by default as many as the picture's pixels need."),
    ] = None,
    adaptation: Annotated[
        float, typer.Option(metavar="CD_M2", min=1e-6, max=1e6, help="Luminance the eye is adapted to, for spe.")
    ] = 0.01,
    field_deg: Annotated[float, typer.Option(min=0.5, max=60, help="Width of the picture.")] = 9.0,
    size_px: Annotated[int, typer.Option(min=101, max=2001, help="Its pixels; an even number is taken one up.")] = 721,
    sheets: Annotated[
        bool, typer.Option("--sheets", help="Also pictures side by side: pupils, ages, spectra …; minutes.")
    ] = False,
    film: Annotated[
        float | None, typer.Option(metavar="SECONDS", min=0.05, max=60, help="Also a film of the eye in motion.")
    ] = None,
    save_observer: Annotated[
        Path | None,
        typer.Option(metavar="TOML", help="Write this eye as settings, which every command takes by --settings."),
    ] = None,
) -> None:
    """Show what one person's eye makes of a point of light: pictures, profiles, tables."""
    prepare_jax()
    from entoptic.pipeline.optics.aperture import Pose
    from entoptic.pipeline.optics.light_spectra import wavelengths_for
    from entoptic.services import settings as settings_file
    from entoptic.services.psf import results
    from entoptic.services.psf.subject import Subject

    tuned = settings_file.of(settings)
    if save_observer is not None:
        settings_file.refuse_unwritable(save_observer)
    observer = tuned.observer
    pose = Pose(pupil_diameter_mm, observer.defocus_d, openness, observer.ocular_dynamics.lashes)
    count = wavelengths_for(size_px / field_deg) if wavelengths is None else wavelengths
    subject = Subject(observer, pose, tuned.glare.model, adaptation, spectrum, count)
    results.run(subject, out, console, size_px=size_px, field_deg=field_deg, with_sheets=sheets, film_s=film)
    if save_observer is not None:
        settings_file.write(save_observer, tuned)
        console.print(f"wrote [b]{escape(str(save_observer))}[/b]: use it with --settings", soft_wrap=True)
