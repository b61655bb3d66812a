"""How glare is simulated where it runs."""

from __future__ import annotations

from typing import Annotated

import msgspec

from entoptic.described import DescribedEnum, described
from entoptic.pipeline.effects.glare.models import GlareModel


class GlareLevel(DescribedEnum):
    """How finely light is pooled before it is scattered, cheapest first."""

    EIGHTH = "eighth", "Cells of 8 × 8 pixels, and only the very brightest pixels laid down one by one."
    QUARTER = "quarter", "Cells of 4 × 4 pixels; pixels that stand out are laid down one by one."
    HALF = "half", "Cells of 2 × 2 pixels."
    FULL = "full", "Every pixel by itself."


class Edge(DescribedEnum):
    """What stands beyond a frame's edges and scatters into it, where the scene does not say."""

    AVERAGE = "average", "Light everywhere as bright as the frame is on average, of its logarithm: no lamp counts much."
    MIRRORED = (
        "mirrored",
        "The frame's mirror image, a quarter of its size, and the average beyond: 2.25 times as many pixels.",
    )
    DARK = "dark", "Nothing, as around a display in a dark room."


class Glare(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which point-spread function, and how it is applied."""

    model: GlareModel = GlareModel.WAVE
    level: GlareLevel = GlareLevel.QUARTER
    edge: Edge = Edge.AVERAGE
    above_display: Annotated[
        bool,
        described(
            "Only light above the display's peak scatters, since below it the display itself makes the eye glare "
            "(SPE 4)."
        ),
    ] = False
