"""The person who looks: what makes their eyes theirs, and which parts of them move."""

from __future__ import annotations

import enum
from typing import Annotated

import msgspec

from entoptic.described import described

Count = Annotated[int, msgspec.Meta(ge=0, le=20000)]
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]


class Iris(enum.StrEnum):
    """Colour of the iris: the less pigment, the more light comes through it and from the fundus."""

    DARK = "dark"
    BROWN = "brown"
    GREEN = "green"
    BLUE = "blue"


class OcularDynamics(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which parts of the eye move (RIT 3). All at rest unless asked for: a kernel then serves for many frames."""

    microfluctuations: Annotated[bool, described("Accommodation wavers, and defocus with it.")] = False
    lens: Annotated[bool, described("The lens deforms with accommodation, and its particles move.")] = False
    vitreous: Annotated[bool, described("The vitreous lags behind saccades and swings back.")] = False
    lids: Annotated[bool, described("Lids cover the pupil as far as the tracker says.", first=True)] = False
    lashes: Annotated[bool, described("Lashes hang before the pupil where the lid is low.", first=True)] = False
    squint: Annotated[bool, described("Lids are held half closed, as before a strong light.", first=True)] = False
    hippus: Annotated[
        bool,
        described("The pupil wavers; never where it is measured, as a measured pupil contains its hippus.", first=True),
    ] = False


class ScatterShares(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How much of the light that an eye scatters each of its parts does (RIT Table 1), in proportion to each other.

    How much light that is in all, age and iris say. Particles too fine to be drawn one by one follow their part: those
    of the cornea stay where they are, those of lens and vitreous move with them. What the retina scatters is smooth,
    what the others do is made of needles.
    """

    cornea: Annotated[Share, described("The cornea's: 25–30 % (RIT Table 1).")] = 0.275
    lens: Annotated[Share, described("The lens': 40 % (RIT Table 1).")] = 0.40
    vitreous: Annotated[Share, described("The vitreous': 10 % (RIT Table 1).")] = 0.10
    retina: Annotated[Share, described("The retina's: 20 % (RIT Table 1).")] = 0.20


class Observer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The optics of one person's eyes."""

    age_years: Annotated[
        float,
        described(
            "The lens yellows, clouds and scatters more with age, and the pupil stays smaller.",
            ge=1.0,
            le=120.0,
            first=True,
        ),
    ] = 30.0
    iris: Annotated[
        Iris, described("Its pigment decides how much light comes through the iris and from the fundus.", first=True)
    ] = Iris.BROWN
    particles: Annotated[
        Count,
        described(
            "Scattering particles of the lens over the pupil plane (LUI 5.2.4; van den Berg 2005).",
            slider=(0.0, 5000.0),
            first=True,
        ),
    ] = 1000
    particle_mm: Annotated[
        float, described("Their median diameter (LUI 5.2.4).", ge=0.005, le=0.5, slider=(0.005, 0.2), first=True)
    ] = 0.042
    particle_spread: Annotated[
        float,
        described("Standard deviation of the logarithm of their diameters; 0: all alike, as in LUI.", ge=0.0, le=1.0),
    ] = 0.0
    gratings: Annotated[
        Count, described("Patches of a few lens fibres each that make the halo, which is as strong as they are many.")
    ] = 9000
    cornea_cells: Annotated[Count, described("Flat cells of 15 µm in the cornea that scatter (RIT 3.1).")] = 5400
    vitreous_particles: Annotated[
        Count,
        described(
            "Scattering particles of the vitreous that lie before the pupil plane, on average (RIT 3.4). With 250, "
            "and 5400 cells of the cornea, cornea, lens and vitreous scatter as 27.6 : 40 : 10.6 (RIT Table 1: "
            "25–30 : 40 : 10)."
        ),
    ] = 250
    lashes: Annotated[
        int,
        described(
            "Lashes of the upper lid; they matter only where `ocular_dynamics.lashes` lets them hang before the pupil.",
            ge=0,
            le=500,
        ),
    ] = 90
    squint_openness: Annotated[
        Share,
        described(
            "How far squinting leaves the lids open. Engineering choice: the upper lid then hangs 0.5 mm above the "
            "pupil's centre."
        ),
    ] = 0.55
    defocus_d: Annotated[
        float, described("Error of accommodation or refraction in dioptres; 0: in focus.", ge=-8.0, le=8.0, first=True)
    ] = 0.0
    seed: Annotated[int, described("Which of all eyes with these statistics.", ge=0)] = 0
    scatter: ScatterShares = ScatterShares()
    ocular_dynamics: OcularDynamics = OcularDynamics()
