"""How glare is simulated where it runs."""

from __future__ import annotations

from typing import Annotated

import msgspec

from entoptic.described import DescribedEnum, described
from entoptic.pipeline.effects.glare.lights import Falloff
from entoptic.pipeline.effects.glare.models import GlareModel


class GlareLevel(DescribedEnum):
    """How much of the point-spread function is applied to how much of the frame, cheapest first."""

    VEIL = "veil", "Light scattered beyond 4.5° alone, at low resolution."
    SOURCES = "sources", "The veil, and the kernel around the few brightest pixels."
    WINDOW = "window", "The veil, and the kernel of all light in a window around the gaze (LUI 5.2.3)."
    FRAME = "frame", "The veil, and the kernel of all light of the frame."
    REFERENCE = (
        "reference",
        (
            "The same in float64 with an FFT of the pupil plane for each wavelength: the truth for the others, in "
            "minutes."
        ),
    )


class Glare(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which point-spread function, and how it is applied."""

    model: GlareModel = GlareModel.WAVE
    level: GlareLevel = GlareLevel.WINDOW
    above_display: Annotated[
        bool,
        described(
            "Only light above the display's peak scatters, since below it the display itself makes the eye glare "
            "(SPE 4)."
        ),
    ] = False
    falloff: Annotated[
        Falloff, described("How the glare of lights of their own fades towards the kernel's edge (KRI 4.2.5).")
    ] = Falloff.NONE
