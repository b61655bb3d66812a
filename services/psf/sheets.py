"""Pictures side by side in which one thing differs: the figures of the papers, made by this eye.

Within a sheet all pictures have the same field, scale and light, so what differs between two is what the caption says.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import UInt8
from matplotlib.figure import Figure

from entoptic.pipeline.effects.glare.models import GlareModel
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics.aperture import BLOCKED_LIMIT, blocked_share
from entoptic.services.psf.picture import SCALE, displayed, radiance
from entoptic.services.psf.plots import DPI, INK, PAGE, show
from entoptic.services.psf.subject import Subject

SIDE_PX, FIELD_DEG = 361, 9.0
"""Of one picture: 40 pixels per degree, and the halo whole."""
GAP_PX, TITLE_PX, CAPTION_PX, FOOT_PX = 8, 30, 22, 34
JPEG_QUALITY = 88
"""Engineering choice: no blocks are seen around the needles, and a sheet stays below 300 kB."""


@dataclasses.dataclass(frozen=True)
class Sheet:
    """What is drawn: pictures in rows, each with its caption."""

    title: str
    rows: Sequence[Sequence[tuple[str, Subject]]]
    note: str = ""


def particles_at(observer: Observer, age_years: float) -> int:
    """How many particles this lens has at another age.

    Numbers grow with age (LUI 5.2.4, which gives no figure). What independent particles scatter goes as their number,
    and measured straylight goes as 1 + (age/70)⁴ (CIE 135, IJspeert 1993); so does the number here.
    """
    growth = (1 + (age_years / 70) ** 4) / (1 + (observer.age_years / 70) ** 4)
    return min(round(observer.particles * growth), 20000)


def anatomy(subject: Subject) -> Sheet:
    """What each part of the eye does to the light, alone and together."""
    eye = subject.observer
    none = {"particles": 0, "gratings": 0, "cornea_cells": 0, "vitreous_particles": 0}
    clear = _posed(_observed(subject, **none), openness=1.0, lashes=False)
    lidded = _posed(clear, openness=0.5)
    parts = [
        (f"pupil of {subject.pose.pupil_diameter_mm:g} mm", clear),
        (f"{eye.particles} lens particles", _observed(clear, particles=eye.particles)),
        (f"{eye.cornea_cells} cornea cells", _observed(clear, cornea_cells=eye.cornea_cells)),
        (f"{eye.vitreous_particles} vitreous particles", _observed(clear, vitreous_particles=eye.vitreous_particles)),
        (f"{eye.gratings} patches of lens fibres", _observed(clear, gratings=eye.gratings)),
        ("lids half closed", lidded),
        (f"lids half closed, {eye.lashes} lashes", _posed(lidded, lashes=True)),
        ("the whole eye, open", _posed(subject, openness=1.0, lashes=False)),
    ]
    note = "each with the light of finer particles and of the retina: a share of CIE 135's, all of it beyond the field"
    return Sheet("What each part of the eye does to the light", (parts[:4], parts[4:]), note)


def pupils(subject: Subject) -> Sheet:
    """LUI Fig 5.6."""
    return Sheet(
        "Pupil (LUI Fig 5.6)", [[(f"{mm} mm", _posed(subject, pupil_diameter_mm=float(mm))) for mm in (2, 4, 6, 8)]]
    )


def particles(subject: Subject) -> Sheet:
    """LUI Fig 5.7."""
    row = [(f"{number} particles", _observed(subject, particles=number)) for number in (200, 1000, 2000, 4000)]
    return Sheet(f"Number of lens particles at a pupil of {subject.pose.pupil_diameter_mm:g} mm (LUI Fig 5.7)", [row])


def particle_sizes(subject: Subject) -> Sheet:
    """KRI Figs 6.9 and 6.10: size of particles over their number; few large ones make a coarse halo of their own."""
    # The vitreous' particles have the same size as the lens', and would be seen beside them.
    rows = [
        [
            (f"{n} of {mm * 1e3:.0f} µm", _observed(subject, particles=n, particle_mm=mm, vitreous_particles=0))
            for mm in (0.02, 0.042, 0.1)
        ]
        for n in (300, 1000, 3000)
    ]
    return Sheet("Size and number of particles, in the lens alone (KRI Fig 6.9)", rows)


def ages(subject: Subject) -> Sheet:
    """LUI 5.2.4: the wave model, whose particles and veil follow age, over the formula for the average eye."""
    wave, formula = [], []
    for age in (20, 40, 60, 80):
        number = particles_at(subject.observer, age)
        aged = _observed(subject, age_years=float(age), particles=number)
        wave.append((f"{age} years, {number} particles", aged))
        formula.append((f"CIE 135, {age} years", dataclasses.replace(aged, model=GlareModel.CIE)))
    note = "particles in proportion to 1 + (age/70)⁴, as measured straylight (CIE 135)"
    return Sheet("Age: this eye, and the average one (CIE 135)", (wave, formula), note)


def spectra(subject: Subject) -> Sheet:
    """KRI Figs 6.4–6.6: white LEDs, good and poor, tungsten and equal energy beside D65."""
    # E is redder than the display's white, D65; both stay as they are.
    names = {"D65": "D65", "LED-B3": "white LED of 4100 K (CIE LED-B3)", "LED-KRI": "white LED (KRI 6.1)"}
    names |= {"LED-KRI-3": "poor LED, three peaks (KRI Fig 6.5)", "A": "tungsten (CIE A)", "E": "equal energy (CIE E)"}
    row = [(caption, dataclasses.replace(subject, spectrum=name)) for name, caption in names.items()]
    return Sheet("Spectrum of the light (KRI Figs 6.4–6.6)", (row[:3], row[3:]))


SHEETS: dict[str, Callable[[Subject], Sheet]] = {
    make.__name__: make for make in (anatomy, pupils, particles, particle_sizes, ages, spectra)
}
"""Each with its name as a file."""


def write(path: Path, sheet: Sheet) -> None:
    """Draws a sheet, as JPEG or by the path's suffix; every pixel of its pictures is a pixel of the file."""
    rows, columns = len(sheet.rows), max(map(len, sheet.rows))
    width = columns * SIDE_PX + (columns + 1) * GAP_PX
    height = TITLE_PX + rows * (SIDE_PX + CAPTION_PX) + FOOT_PX
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor=PAGE)
    words: dict[str, Any] = {"color": INK, "va": "center"}
    left = GAP_PX / width
    figure.text(left, 1 - TITLE_PX / 2 / height, sheet.title, size=10, **words)
    for j, row in enumerate(sheet.rows):
        bottom = FOOT_PX + (rows - 1 - j) * (SIDE_PX + CAPTION_PX) + CAPTION_PX
        for i, (caption, subject) in enumerate(row):
            # Too many large particles leave nothing to see.
            blocked = blocked_share(subject.observer) > BLOCKED_LIMIT
            at_px = GAP_PX + i * (SIDE_PX + GAP_PX)
            axes = figure.add_axes((at_px / width, bottom / height, SIDE_PX / width, SIDE_PX / height))
            show(axes, np.zeros((SIDE_PX, SIDE_PX, 3), np.uint8) if blocked else _image(subject), FIELD_DEG)
            axes.set_xlabel(f"{caption}: too many to see" if blocked else caption, color=INK, size=8)
    foot = f"{FIELD_DEG:g}° wide · lightness: {SCALE}\n{sheet.note}".strip()
    figure.text(left, FOOT_PX / 2 / height, foot, size=7, linespacing=1.3, **words)
    quality = {"quality": JPEG_QUALITY, "optimize": True} if path.suffix == ".jpg" else None
    figure.savefig(path, pil_kwargs=quality)


def _image(subject: Subject) -> UInt8[np.ndarray, "k k 3"]:
    return displayed(radiance(subject, SIDE_PX, FIELD_DEG))


def _observed(subject: Subject, **changes: Any) -> Subject:
    return dataclasses.replace(subject, observer=msgspec.structs.replace(subject.observer, **changes))


def _posed(subject: Subject, **changes: Any) -> Subject:
    return dataclasses.replace(subject, pose=dataclasses.replace(subject.pose, **changes))
