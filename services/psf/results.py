"""All that `entoptic psf` writes and prints."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress, track
from rich.table import Table

from entoptic.pipeline.effects.glare.models import GRID, GlareModel
from entoptic.pipeline.optics.aperture import pupil_plane
from entoptic.services.psf import film, plots, profile, sheets
from entoptic.services.psf.picture import SCALE, Scale, displayed, radiance
from entoptic.services.psf.subject import Subject
from entoptic.services.results.folder import results_folder

_NAMES = {
    GlareModel.WAVE: "wave optics, CIE 135 beyond",
    GlareModel.SPE: "Spencer 1995",
    GlareModel.CIE: "CIE 135",
    GlareModel.IJSPEERT: "IJspeert 1993",
}


def run(
    subject: Subject,
    out: Path,
    console: Console,
    *,
    size_px: int,
    field_deg: float,
    with_sheets: bool = False,
    film_s: float | None = None,
) -> None:
    """Writes everything into a folder, whole or not at all, and prints what was measured.

    Raises ResultsFolderError if the folder cannot be written, OpticsError for an eye or a light that cannot be shown.
    """
    # Refused before anything is computed or written.
    subject.light()
    with results_folder(out) as folder:
        _write_eye(subject, size_px | 1, field_deg, folder, console)
        waves = dataclasses.replace(subject, model=GlareModel.WAVE)
        if with_sheets:
            for name, make in track(sheets.SHEETS.items(), "sheets", console=console):
                sheets.write(folder / f"sheet_{name}.jpg", make(waves))
        if film_s is not None:
            with Progress(console=console) as progress:
                task = progress.add_task("film")
                film.write(folder, waves, film_s, lambda done, of: progress.update(task, completed=done, total=of))
        names = sorted(path.name for path in folder.iterdir())
    console.print(f"wrote [b]{escape(str(out))}[/b]: {', '.join(names)}", soft_wrap=True)


def _write_eye(subject: Subject, size_px: int, field_deg: float, folder: Path, console: Console) -> None:
    words = captions(subject)
    scale = scale_for(subject, field_deg)
    image = displayed(radiance(subject, size_px, field_deg), scale)
    ruler = f"{field_deg:g}° wide · lightness: {scale}, rings: degrees from the light"
    plots.write_psf(folder / "psf.png", image, field_deg, scale, [*words, ruler])
    plane = pupil_plane(subject.observer, subject.pose, GRID)
    plots.write_pupil_plane(folder / "pupil_plane.png", plane, words)
    profile.write_tables(subject, folder)
    models = dict.fromkeys((subject.model, GlareModel.CIE, GlareModel.IJSPEERT))
    functions = {_NAMES[one]: profile.luminous(dataclasses.replace(subject, model=one)) for one in models}
    plots.write_profiles(folder / "profiles.png", functions, " · ".join(words))
    ratios = profile.ratios(subject, dataclasses.replace(subject, model=GlareModel.CIE))
    table = Table("angle", *(f"{deg:g}°" for deg in profile.RATIOS_DEG))
    table.add_row(f"{subject.model.value}/CIE 135, luminous, ring ± 5 %", *(f"{ratio:.2f}" for ratio in ratios))
    console.print(table)


def scale_for(subject: Subject, field_deg: float) -> Scale:
    """As many decades as SCALE, black at or below what the middle of the field's edges gets: SCALE itself at 9°.

    In steps of half a decade, so that eyes which differ a little are shown alike.
    """
    edge = np.array(field_deg / 2)
    light = profile.density(profile.luminous(subject), edge / profile.RATIO_RING, edge * profile.RATIO_RING)
    low = math.floor(2 * math.log10(float(light))) / 2
    return Scale(low, low + SCALE.high - SCALE.low)


def captions(subject: Subject) -> list[str]:
    """What was shown, in two lines."""
    eye, pose = subject.observer, subject.pose
    first = f"pupil {pose.pupil_diameter_mm:g} mm · {eye.age_years:g} years, {eye.iris.value} iris"
    first += f" · light {Path(subject.spectrum).stem} at {subject.wavelengths} wavelengths"
    if pose.defocus_d:
        first += f" · defocus {pose.defocus_d:+g} D"
    if pose.openness < 1 or pose.lashes:
        first += f" · lids {pose.openness:.0%} open{', lashes' if pose.lashes else ''}"
    if subject.model is not GlareModel.WAVE:
        adapted = f", adapted to {subject.adapted_cd_m2:g} cd/m²" if subject.model is GlareModel.SPE else ""
        return [first, _NAMES[subject.model] + adapted]
    second = f"{eye.particles} particles of {eye.particle_mm * 1e3:g} µm · {eye.gratings} gratings"
    second += f" · {eye.cornea_cells} cornea cells · {eye.vitreous_particles} vitreous particles · seed {eye.seed}"
    return [first, second]
