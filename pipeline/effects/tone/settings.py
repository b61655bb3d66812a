"""Which tone mapping, and what becomes of colours that the display cannot show."""

from __future__ import annotations

from typing import Annotated

import msgspec

from entoptic.described import DescribedEnum, described


class Operator(DescribedEnum):
    """From the scene's luminance to the display's."""

    ACES = "aces", "Filmic curve of luminance, exposed by the key (LUI); with hue `clip` of each component."
    REINHARD = "reinhard", "Photographic curve of luminance, exposed by the key (KRI 4.18–4.20)."
    WARD = (
        "ward",
        "What is just seen in the scene is just seen on the display (BAR 8–10, after Ward and Ferwerda): linear.",
    )
    DURAND = "durand", "The same for cones and rods apart (KRI 4.21–4.26)."
    CURVE = "curve", "A person's own curve of luminance, from a file."


class Hue(DescribedEnum):
    """What becomes of a colour beyond the display's."""

    OKLAB = (
        "oklab",
        (
            "Hue is kept, and luminance and chroma are lost until the display has the colour: bright lamps go to "
            "white without a change of hue (Ottosson's Oklab; CIE 156)."
        ),
    )
    CLIP = (
        "clip",
        (
            "Each component ends at the display's peak, `aces` curves each for itself (LUI): the hues of bright "
            "colours turn to the nearest of red, yellow, green, cyan, blue and magenta before they are white."
        ),
    )
    RGB = "rgb", "All three components are divided by the largest where that is above the peak (KRI 4.30)."
    XYY = (
        "xyy",
        ("Luminance ends at the peak's and chromaticity is kept (KRI 4.28, E5); a saturated colour is then clipped."),
    )


class Tone(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Tone mapping."""

    operator: Operator = Operator.ACES
    hue: Hue = Hue.OKLAB
    white: Annotated[
        float,
        described(
            "L_white of `reinhard`, the smallest exposed luminance that is shown at the display's peak (KRI 4.20).",
            ge=0.5,
            le=1e6,
            slider=(0.5, 100.0),
        ),
    ] = 2.0
    curve: Annotated[
        str,
        described(
            "File of `curve`: CSV whose header is `log10_cd_m2,share` or `log10_of_adapted,share`.", file="tone curve"
        ),
    ] = ""

    def __post_init__(self) -> None:
        if (self.operator is Operator.CURVE) != bool(self.curve):
            raise ValueError('`curve` names a file when, and only when, `operator` is "curve"')
