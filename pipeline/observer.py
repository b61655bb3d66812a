"""The person who looks: what makes their eyes theirs, and which parts of them move."""

from __future__ import annotations

import enum
from typing import Annotated

import msgspec

Count = Annotated[int, msgspec.Meta(ge=0, le=20000)]
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]


class Iris(enum.StrEnum):
    """Colour of the iris: the less pigment, the more light comes through it and from the fundus."""

    DARK = "dark"
    BROWN = "brown"
    GREEN = "green"
    BLUE = "blue"


class OcularDynamics(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which parts of the eye move (RIT §3). All at rest unless asked for: a kernel then serves for many frames."""

    microfluctuations: bool = False
    """Accommodation wavers, and defocus with it."""
    lens: bool = False
    """The lens deforms with accommodation, and its particles move."""
    vitreous: bool = False
    """The vitreous lags behind saccades and swings back."""
    lids: bool = False
    """Lids cover the pupil as far as the tracker says."""
    lashes: bool = False
    """Lashes hang before the pupil where the lid is low."""
    squint: bool = False
    """Lids are held half closed, as before a strong light."""
    hippus: bool = False
    """The pupil wavers; never where it is measured, as a measured pupil contains its hippus."""


class Observer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The optics of one person's eyes."""

    age_years: Annotated[float, msgspec.Meta(ge=1.0, le=120.0)] = 30.0
    """The lens yellows, clouds and scatters more with age, and the pupil stays smaller."""
    iris: Iris = Iris.BROWN
    """Its pigment decides how much light comes through the iris and from the fundus."""
    particles: Count = 1000
    """Scattering particles of the lens over the pupil plane (LUI §5.2.4; van den Berg 2005)."""
    particle_mm: Annotated[float, msgspec.Meta(ge=0.005, le=0.5)] = 0.042
    """Their median diameter (LUI §5.2.4)."""
    particle_spread: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.0
    """Standard deviation of the logarithm of their diameters; 0: all alike, as in LUI."""
    gratings: Annotated[int, msgspec.Meta(ge=0, le=2000)] = 200
    """Patches of lens fibres that make the halo (RIT §3.3)."""
    cornea_cells: Count = 5400
    """Flat cells of 15 µm in the cornea that scatter (RIT §3.1)."""
    vitreous_particles: Count = 250
    """Scattering particles of the vitreous that lie before the pupil plane, on average (RIT §3.4). With 250, and 5400
    cells of the cornea, cornea, lens and vitreous scatter as 27.6 : 40 : 10.6 (RIT Table 1: 25–30 : 40 : 10)."""
    lashes: Annotated[int, msgspec.Meta(ge=0, le=500)] = 90
    """Lashes of the upper lid; they matter only where `ocular_dynamics.lashes` lets them hang before the pupil."""
    squint_openness: Share = 0.55
    """How far squinting leaves the lids open. Engineering choice: the upper lid then hangs 0.5 mm above the pupil's
    centre."""
    defocus_d: Annotated[float, msgspec.Meta(ge=-8.0, le=8.0)] = 0.0
    """Error of accommodation or refraction in dioptres; 0: in focus."""
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0
    """Which of all eyes with these statistics."""
    ocular_dynamics: OcularDynamics = OcularDynamics()
