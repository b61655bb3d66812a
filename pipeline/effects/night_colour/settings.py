"""How colour changes at night."""

from __future__ import annotations

from typing import Annotated

import msgspec

from entoptic.described import DescribedEnum, described


class NightMethod(DescribedEnum):
    """What rods make of colour."""

    LUI = "lui", "Towards a lavender grey (LUI 5.18, after Krawczyk 2005)."
    KRI_XY = "kri-xy", "Chromaticity towards (0.25, 0.25), luminance kept (KRI 4.28)."
    KRI_RGB = "kri-rgb", "Towards a bluish grey (KRI 4.29)."
    BAR = "bar", "Towards a neutral grey: colours pale (BAR 11–12, after Hunt)."
    RODS = (
        "rods",
        (
            "Rods see with their own spectral sensitivity, reds go dark, and their signal enters the opponent "
            "channels of the cones (after Cao 2008 and Kirk & O'Brien 2011)."
        ),
    )


class NightColour(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which method, and what decides the rods' share."""

    method: NightMethod = NightMethod.LUI
    mesopic: Annotated[
        bool,
        described(
            "The rods' share from CIE 191's adaptation coefficient instead of the method's own function: no rods "
            "from 5 cd/m² on, no cones below 0.002 cd/m²."
        ),
    ] = False
    per_pixel: Annotated[
        bool,
        described(
            "The share of each pixel from its own luminance, as KRI and BAR have it, so that a lamp keeps its "
            "colour at night; otherwise that of the luminance to which the eye is adapted (LUI)."
        ),
    ] = False

    def __post_init__(self) -> None:
        if self.mesopic and self.per_pixel:
            raise ValueError("mesopic and per_pixel exclude each other: CIE 191 is a matter of adaptation; choose one")
