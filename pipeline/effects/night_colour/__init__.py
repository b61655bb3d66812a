"""Colour where rods see: it pales, shifts towards blue, and reds go dark.

settings.py   which method, and what decides the rods' share
share.py      the rods' share of vision: by adaptation, by CIE 191, or pixel by pixel
tints.py      what grey looks like to rods, and which light they see
shift.py      the effect
bounds.py     how much it may change at most, for the planner
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.effect import Cost, Domain, Effect, Picture, TileChanges, TileRanges
from entoptic.pipeline.effects.night_colour.bounds import propagate, skip_bound
from entoptic.pipeline.effects.night_colour.settings import NightColour, NightMethod
from entoptic.pipeline.effects.night_colour.share import adapted_share
from entoptic.pipeline.effects.night_colour.shift import night_tint, of_pixels, shift
from entoptic.pipeline.effects.night_colour.tints import TINT
from entoptic.pipeline.effects.pointwise import Pointwise, image_after
from entoptic.pipeline.oracles import night_colour as oracle
from entoptic.pipeline.ranges import Change
from entoptic.pipeline.words import darkness

__all__ = [
    "NIGHT_COLOUR",
    "TINT",
    "NightColour",
    "NightColourEffect",
    "NightMethod",
    "night_tint",
    "shift",
]


if TYPE_CHECKING:
    from entoptic.pipeline.eye_context import EyeContext


class NightColourEffect(Effect[NightColour, None]):
    """Colour where rods see."""

    name = "night_colour"
    domain = Domain.DISPLAY
    Settings = NightColour
    costs: Mapping[str, Cost] = {
        "lui": Cost(0.3, 5.3),
        "kri-xy": Cost(0.3, 7.1),
        "kri-rgb": Cost(0.3, 4.9),
        "bar": Cost(0.3, 3.3),
        "rods": Cost(0.3, 5.1),
    }

    def full_level(self, settings: NightColour) -> str:
        return settings.method.value

    def apply(
        self,
        picture: Picture,
        eyes: Sequence[EyeContext],
        settings: NightColour,
        level: str,
        tiles: NDArray[np.bool_] | None,
    ) -> Float[Array, "eye 3 y x"]:
        return image_after(picture, [self.pointwise(picture, eyes, settings, level, tiles)])

    def pointwise(
        self,
        picture: Picture,
        eyes: Sequence[EyeContext],
        settings: NightColour,
        level: str,
        tiles: NDArray[np.bool_] | None,
    ) -> Pointwise:
        return of_pixels([eye.adapted_cd_m2 for eye in eyes], settings)

    def bound(self, ranges: TileRanges, eye: EyeContext, settings: NightColour, level: str) -> Change:
        return skip_bound(ranges.image, eye.adapted_cd_m2, settings, ranges.scene)

    def propagate(self, changes: TileChanges, ranges: TileRanges, eye: EyeContext, settings: NightColour) -> Change:
        return propagate(changes.image, ranges.image, eye.adapted_cd_m2, settings, ranges.scene, changes.scene)

    def reason(self, eye: EyeContext, settings: NightColour) -> str:
        if settings.per_pixel:
            return f"{darkness(eye.measured, 3.0)}, and each has its own share of rods"
        (rods,) = adapted_share(np.array([eye.adapted_cd_m2]), settings)
        return f"adapted to {eye.adapted_cd_m2:.3g} cd/m², rods carry {rods:.2g} of vision"

    def oracle(self, picture: Picture, eye: EyeContext, settings: NightColour) -> NDArray[np.float64]:
        displayed, scene = (np.asarray(one[0], np.float64) for one in (picture.image, picture.scene))
        return oracle.shifted(displayed, scene, eye.adapted_cd_m2, settings)

    def variants(self) -> Mapping[str, NightColour]:
        return {method.value: NightColour(method=method) for method in NightMethod} | {
            "lui, mesopic": NightColour(mesopic=True),
            "lui, per pixel": NightColour(per_pixel=True),
        }


NIGHT_COLOUR = NightColourEffect()
