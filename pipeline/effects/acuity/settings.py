"""How the loss of detail in the dark is simulated where it runs."""

from __future__ import annotations

from typing import Annotated

import msgspec

from entoptic.described import DescribedEnum, described


class AcuityMethod(DescribedEnum):
    """Which width of the blur belongs to a luminance."""

    FIT = "fit", "σ = max(1 − L*, 0) px whatever the display (LUI 5.16)."
    KRAWCZYK = (
        "krawczyk",
        (
            "σ = ppd/(1.86·R(Y)) px, R the highest frequency that an eye resolves (Krawczyk 2005, Larson 1997; LUI "
            "5.14)."
        ),
    )


class Acuity(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which width, and how it is applied."""

    method: AcuityMethod = AcuityMethod.FIT
    display_limit: Annotated[
        bool,
        described(
            "Of Krawczyk's blur, only what the display's pixels do not already do: none where the eye resolves more "
            "than ppd/2 cycles per degree, the display's Nyquist frequency. The fit is at most 1 px wide, which no "
            "such limit leaves."
        ),
    ] = True
    reference: Annotated[
        bool,
        described("The true two-dimensional filter in float64 with the same σ: the truth for the others, in minutes."),
    ] = False
