"""Whether afterimages are simulated, and how finely."""

from __future__ import annotations

from typing import Annotated

import msgspec

from entoptic.described import described


class Afterimage(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a bright light leaves where it fell on the retina."""

    on: Annotated[bool, described("Off, as in LUI: the eye remembers only the luminance that it is adapted to.")] = (
        False
    )
    cell_deg: Annotated[
        float,
        described(
            "Side of a cell of the retina's map. A lamp smaller than a cell bleaches it as if its light filled the "
            "cell.",
            ge=0.2,
            le=5.0,
        ),
    ] = 0.75
