"""Pictures side by side in which one thing differs: the figures of the papers, made by this eye.

Within a sheet all pictures have the same field, scale and light, so what differs between two is what the caption says.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import msgspec
import numpy as np
from jaxtyping import UInt8

from entoptic.pipeline.effects.glare.models import GlareModel
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics.aperture import BLOCKED_LIMIT, blocked_share
from entoptic.pipeline.optics.pupil import watson_yellott_mm
from entoptic.services.psf.layout import Panel, Sheet
from entoptic.services.psf.picture import SCALE, Scale, displayed, radiance
from entoptic.services.psf.subject import Subject

SIDE_PX, FIELD_DEG = 361, 9.0
"""Of one picture: 40 pixels per degree, and the halo whole."""
BACKGROUND_DEG2 = 900.0
"""The field that a background fills: 30° × 30°, a room or a street. Engineering choice."""


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
        (f"pupil of {subject.pose.pupil_mm:g} mm", clear),
        (f"{eye.particles} lens particles", _observed(clear, particles=eye.particles)),
        (f"{eye.cornea_cells} cornea cells", _observed(clear, cornea_cells=eye.cornea_cells)),
        (f"{eye.vitreous_particles} vitreous particles", _observed(clear, vitreous_particles=eye.vitreous_particles)),
        (f"{eye.gratings} patches of lens fibres", _observed(clear, gratings=eye.gratings)),
        ("lids half closed", lidded),
        (f"lids half closed, {eye.lashes} lashes", _posed(lidded, lashes=True)),
        ("the whole eye, open", _posed(subject, openness=1.0, lashes=False)),
    ]
    note = "each with the smooth light that no structure resolves: a share of CIE 135's, all of it beyond the field"
    return _sheet("What each part of the eye does to the light", [parts[:4], parts[4:]], note)


def pupils(subject: Subject) -> Sheet:
    """LUI Fig 5.6."""
    return _row("Pupil (LUI Fig 5.6)", [(f"{mm} mm", _posed(subject, pupil_mm=float(mm))) for mm in (2, 4, 6, 8)])


def particles(subject: Subject) -> Sheet:
    """LUI Fig 5.7."""
    numbers = (200, 1000, 2000, 4000)
    return _row(
        f"Number of lens particles at a pupil of {subject.pose.pupil_mm:g} mm (LUI Fig 5.7)",
        [(f"{number} particles", _observed(subject, particles=number)) for number in numbers],
    )


def ages(subject: Subject) -> Sheet:
    """LUI 5.2.4: the wave model, whose particles and veil follow age, over the formula for the average eye."""
    years = (20, 40, 60, 80)
    wave, formula = [], []
    for age in years:
        number = particles_at(subject.observer, age)
        aged = _observed(subject, age_years=float(age), particles=number)
        wave.append((f"{age} years, {number} particles", aged))
        formula.append((f"CIE 135, {age} years", dataclasses.replace(aged, model=GlareModel.CIE)))
    return _sheet(
        "Age: this eye, and the average one (CIE 135)",
        [wave, formula],
        "particles in proportion to 1 + (age/70)⁴, as measured straylight (CIE 135)",
    )


def spectra(subject: Subject) -> Sheet:
    """KRI Figs 6.4–6.6: white LEDs, good and poor, and tungsten beside D65; and the halves of D65 and E."""
    # E is redder than the display's white, D65; both stay as they are.
    names = {"D65": "D65", "LED-B3": "white LED of 4100 K (CIE LED-B3)", "LED-KRI": "white LED (KRI 6.1)"}
    names |= {"LED-KRI-3": "poor LED, three peaks (KRI Fig 6.5)", "A": "tungsten (CIE A)"}
    row = _drawn([(caption, dataclasses.replace(subject, spectrum=name)) for name, caption in names.items()])
    left, right = (_image(dataclasses.replace(subject, spectrum=name)) for name in ("D65", "E"))
    halves = np.concatenate([left[:, : SIDE_PX // 2], right[:, SIDE_PX // 2 :]], axis=1)
    row = (*row, Panel("left half D65, right half E (KRI Fig 6.6)", halves))
    return Sheet("Spectrum of the light (KRI Figs 6.4–6.6)", (row[:3], row[3:]), FIELD_DEG)


def samples(subject: Subject) -> Sheet:
    """KRI Fig 6.8."""
    counts = (8, 15, 30, 60)
    return _row(
        "Wavelengths summed (KRI Fig 6.8)",
        [(f"{count} wavelengths", dataclasses.replace(subject, wavelengths=count)) for count in counts],
    )


def particle_sizes(subject: Subject) -> Sheet:
    """KRI Fig 6.9: size of particles over their number."""
    rows = [
        [(f"{number} of {mm * 1e3:.0f} µm", _in_lens(subject, number, mm)) for mm in (0.02, 0.042, 0.1)]
        for number in (300, 1000, 3000)
    ]
    return _sheet("Size and number of particles, in the lens alone (KRI Fig 6.9)", rows)


def large_particles(subject: Subject) -> Sheet:
    """KRI Fig 6.10: few and many large particles, a coarse halo of their own."""
    return _row(
        "Number of large particles, 150 µm across, in the lens alone (KRI Fig 6.10)",
        [(f"{number} particles", _in_lens(subject, number, 0.15)) for number in (0, 50, 200, 800)],
    )


def lashes(subject: Subject) -> Sheet:
    """KRI Fig 6.11: lids and lashes at a wide pupil."""
    at_night = _posed(subject, pupil_mm=max(subject.pose.pupil_mm, 6.0))
    rows = [
        [
            (f"lids {openness:.0%} open, {word}", _posed(at_night, openness=openness, lashes=hang))
            for openness in (1.0, 0.7, 0.5)
        ]
        for hang, word in ((False, "no lashes"), (True, "lashes"))
    ]
    return _sheet(f"Lids and lashes at a pupil of {at_night.pose.pupil_mm:g} mm (KRI Fig 6.11)", rows)


def gratings(subject: Subject) -> Sheet:
    """KRI Fig 6.12."""
    return _row(
        "Patches of lens fibres (KRI Fig 6.12)",
        [(f"{number} gratings", _observed(subject, gratings=number)) for number in (0, 20, 200, 800)],
    )


def backgrounds(subject: Subject) -> Sheet:
    """KRI Fig 6.7: the background sets the pupil, and the pupil whether there is a halo."""
    row = []
    for luminance_cd_m2 in (0.001, 0.1, 10.0, 1000.0):
        mm = watson_yellott_mm(luminance_cd_m2, BACKGROUND_DEG2, subject.observer.age_years)
        row.append((f"{luminance_cd_m2:g} cd/m²: pupil {mm:.1f} mm", _posed(subject, pupil_mm=mm)))
    who = f"{BACKGROUND_DEG2:.0f} deg², both eyes, {subject.observer.age_years:g} years"
    note = f"pupil after Watson & Yellott 2012: {who}"
    return _row("Luminance of the background (KRI Fig 6.7)", row, note)


SHEETS: dict[str, Callable[[Subject], Sheet]] = {
    "anatomy": anatomy,
    "pupils": pupils,
    "particles": particles,
    "ages": ages,
    "spectra": spectra,
    "samples": samples,
    "particle_sizes": particle_sizes,
    "large_particles": large_particles,
    "lashes": lashes,
    "gratings": gratings,
    "backgrounds": backgrounds,
}
"""Each with its name as a file."""

Captioned = tuple[str, Subject]


def _row(title: str, row: Sequence[Captioned], note: str = "") -> Sheet:
    return _sheet(title, [row], note)


def _sheet(title: str, rows: Iterable[Sequence[Captioned]], note: str = "", scale: Scale = SCALE) -> Sheet:
    return Sheet(title, tuple(_drawn(row, scale) for row in rows), FIELD_DEG, note, scale)


def _drawn(row: Iterable[Captioned], scale: Scale = SCALE) -> tuple[Panel, ...]:
    panels = []
    for caption, subject in row:
        # Of an eye with large particles a sheet may show too many: then there is nothing to see.
        blocked = blocked_share(subject.observer) > BLOCKED_LIMIT
        image = np.zeros((SIDE_PX, SIDE_PX, 3), np.uint8) if blocked else _image(subject, scale)
        panels.append(Panel(f"{caption}: too many to see" if blocked else caption, image))
    return tuple(panels)


def _image(subject: Subject, scale: Scale = SCALE) -> UInt8[np.ndarray, "k k 3"]:
    return displayed(radiance(subject, SIDE_PX, FIELD_DEG), scale)


def _observed(subject: Subject, **changes: Any) -> Subject:
    return dataclasses.replace(subject, observer=msgspec.structs.replace(subject.observer, **changes))


def _in_lens(subject: Subject, number: int, mm: float) -> Subject:
    """The vitreous' particles have the same size as the lens', and would be seen beside them."""
    return _observed(subject, particles=number, particle_mm=mm, vitreous_particles=0)


def _posed(subject: Subject, **changes: Any) -> Subject:
    return dataclasses.replace(subject, pose=dataclasses.replace(subject.pose, **changes))
