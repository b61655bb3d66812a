"""From scene luminance to the display's.

settings.py  which operator, and what becomes of colours beyond the display's
show.py      the one entry: a frame in cd/m² as the display shows it
filmic.py  reinhard.py  ward.py  durand.py  own_curve.py   the operators: what they make of an eye's adaptation, of a
             pixel, and of an interval
gamut.py     colours beyond the display's go to white at their hue
oklab.py     which colour of the display has a hue: its table
hue.py       the other ways with them, and what all ways make of ranges and changes
bounds.py    what tone mapping makes of a range of values and of a change
code_values.py  what that is in code values
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.effect import Cost, Domain, Effect, Picture, TileChanges, TileRanges
from entoptic.pipeline.effects.pointwise import Pointwise, image_after
from entoptic.pipeline.effects.tone.bounds import propagate, shown
from entoptic.pipeline.effects.tone.code_values import code_values
from entoptic.pipeline.effects.tone.filmic import (
    MIDDLE_GREY,
    REFERENCE_PEAK_CD_M2,
    aces,
    ceiling_cd_m2,
    display_scale,
)
from entoptic.pipeline.effects.tone.own_curve import read_curve
from entoptic.pipeline.effects.tone.settings import Hue, Operator, Tone
from entoptic.pipeline.effects.tone.show import full_cd_m2, of_pixels, show
from entoptic.pipeline.oracles import operators
from entoptic.pipeline.ranges import Change, Range

__all__ = [
    "MIDDLE_GREY",
    "REFERENCE_PEAK_CD_M2",
    "TONE",
    "Hue",
    "Operator",
    "Tone",
    "ToneEffect",
    "aces",
    "ceiling_cd_m2",
    "code_values",
    "display_scale",
    "full_cd_m2",
    "propagate",
    "show",
    "shown",
]


if TYPE_CHECKING:
    from entoptic.pipeline.eye_context import EyeContext


class ToneEffect(Effect[Tone, None]):
    """From the luminance of the scene to that of the display."""

    name = "tone"
    domain = Domain.DISPLAY
    Settings = Tone
    optional = False
    costs: Mapping[str, Cost] = {
        "aces": Cost(0.5, 4.3),
        "reinhard": Cost(0.5, 5.5),
        "ward": Cost(0.5, 4.0),
        "durand": Cost(0.5, 11.5),
        "curve": Cost(0.5, 11.5),
    }

    def check(self, settings: Tone) -> None:
        if settings.curve:
            read_curve(settings.curve)

    def full_level(self, settings: Tone) -> str:
        return settings.operator.value

    def required(self, eyes: Sequence[EyeContext], settings: Tone) -> str:
        return "every display needs it"

    def ranges_after(self, ranges: TileRanges, hidden: Change, eye: EyeContext, settings: Tone) -> Range:
        return shown(ranges.image, eye.adapted_cd_m2, eye.target_cd_m2, settings, eye.display)

    def apply(
        self,
        picture: Picture,
        eyes: Sequence[EyeContext],
        settings: Tone,
        level: str,
        tiles: NDArray[np.bool_] | None,
    ) -> Float[Array, "eye 3 y x"]:
        return image_after(picture, [self.pointwise(picture, eyes, settings, level, tiles)])

    def pointwise(
        self,
        picture: Picture,
        eyes: Sequence[EyeContext],
        settings: Tone,
        level: str,
        tiles: NDArray[np.bool_] | None,
    ) -> Pointwise:
        adapted_cd_m2, target_cd_m2 = [eye.adapted_cd_m2 for eye in eyes], [eye.target_cd_m2 for eye in eyes]
        return of_pixels(adapted_cd_m2, target_cd_m2, settings, eyes[0].display)

    def bound(self, ranges: TileRanges, eye: EyeContext, settings: Tone, level: str) -> Change:
        return np.zeros_like(ranges.image.low)

    def propagate(self, changes: TileChanges, ranges: TileRanges, eye: EyeContext, settings: Tone) -> Change:
        return propagate(changes.image, ranges.image, eye.adapted_cd_m2, eye.target_cd_m2, settings, eye.display)

    def reason(self, eye: EyeContext, settings: Tone) -> str:
        return self.required([eye], settings)

    def oracle(self, picture: Picture, eye: EyeContext, settings: Tone) -> NDArray[np.float64]:
        rgb = np.asarray(picture.image[0], np.float64)
        return operators.shown(rgb, eye.adapted_cd_m2, settings, eye.display)

    def variants(self) -> Mapping[str, Tone]:
        return {
            operator.value if hue is Hue.OKLAB else f"{operator.value}, {hue.value}": Tone(operator=operator, hue=hue)
            for operator in Operator
            if operator is not Operator.CURVE
            for hue in Hue
        }


TONE = ToneEffect()
