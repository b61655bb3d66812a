"""What a bright light leaves in the eye: its cones are bleached where it fell, and see less, or light of their own.

settings.py  whether, and how fine
retina.py    what is bleached: the record, and its step from frame to frame
geometry.py  where a direction falls on the retina of an eye that looks elsewhere
seen.py      what a bleached retina makes of what is seen, and what it shows by itself
show.py      a displayed frame with its afterimages
bounds.py    how much they may change

The light that bleaches is the scene's, in cd/m²; what is seen of it is laid over the displayed frame. So an afterimage
moves with the measured gaze, lasts through a blink, and shows on whatever is looked at next.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.adaptation import exposure
from entoptic.pipeline.effects.afterimage.bounds import propagate, skip_bound
from entoptic.pipeline.effects.afterimage.retina import HALF_TD, TAU_S, Retina, rested, step
from entoptic.pipeline.effects.afterimage.settings import Afterimage
from entoptic.pipeline.effects.afterimage.show import show
from entoptic.pipeline.effects.effect import Cost, Domain, Effect, Picture, TileChanges, TileRanges
from entoptic.pipeline.ranges import Change

__all__ = [
    "AFTERIMAGE",
    "HALF_TD",
    "TAU_S",
    "Afterimage",
    "AfterimageEffect",
    "Retina",
    "propagate",
    "rested",
    "show",
    "skipped",
    "step",
]


if TYPE_CHECKING:
    from entoptic.pipeline.eye_context import EyeContext


class AfterimageEffect(Effect[Afterimage, Retina]):
    """What a bright light leaves in the eye."""

    name = "afterimage"
    domain = Domain.DISPLAY
    Settings = Afterimage
    Memory = Retina
    costs: Mapping[str, Cost] = {"on": Cost(1.0, 4.0)}

    def is_on(self, settings: Afterimage) -> bool:
        return settings.on

    def full_level(self, settings: Afterimage) -> str:
        return "on"

    def remember(self, memory: Retina | None, eye: EyeContext, settings: Afterimage, dt_s: float) -> Retina:
        return step(
            memory or rested(settings),
            eye.frame.rgb_cd_m2,
            eye.view,
            eye.gaze_px,
            image=eye.image,
            pupil_diameter_mm=eye.pupil_diameter_mm,
            openness=eye.pose.openness,
            dt_s=dt_s,
            exposure=exposure(eye.adapted_cd_m2),
        )

    def apply(
        self,
        picture: Picture,
        eyes: Sequence[EyeContext],
        settings: Afterimage,
        level: str,
        tiles: NDArray[np.bool_] | None,
    ) -> Float[Array, "eye 3 y x"]:
        return show(picture.image, [eye.memory[self.name] for eye in eyes], eyes[0].view, [eye.gaze_px for eye in eyes])

    def bound(self, ranges: TileRanges, eye: EyeContext, settings: Afterimage, level: str) -> Change:
        return skip_bound(ranges.image, eye.memory[self.name], eye.view, eye.gaze_px)

    def propagate(self, changes: TileChanges, ranges: TileRanges, eye: EyeContext, settings: Afterimage) -> Change:
        return propagate(changes.image, ranges.image, eye.memory[self.name], eye.view, eye.gaze_px)

    def reason(self, eye: EyeContext, settings: Afterimage) -> str:
        return "what the retina keeps of what was seen before"

    def oracle(self, picture: Picture, eye: EyeContext, settings: Afterimage) -> NDArray[np.float64]:
        from entoptic.pipeline.oracles.afterimage import shown

        retina = eye.memory[self.name]
        displayed, bleached = (np.asarray(one, np.float64) for one in (picture.image[0], retina.bleached))
        return shown(displayed, bleached, retina.exposure, eye.view, eye.gaze_px)

    def variants(self) -> Mapping[str, Afterimage]:
        return {f"{cell_deg:g}° cells": Afterimage(on=True, cell_deg=cell_deg) for cell_deg in (0.75, 1.5, 3.0)}


AFTERIMAGE = AfterimageEffect()
