"""Detail that an eye loses in the dark: lightness is blurred, each pixel by its own luminance.

settings.py    which width of the blur, and how it is applied
cielab.py      lightness, which alone is blurred
fit.py         LUI's fast fit, on whole frames
tiles.py       the same on the dark parts alone
larson.py      what an eye resolves at a luminance
krawczyk.py    a blur as wide as that asks for
bounds.py      the most that a skip changes, and what a change before acuity becomes
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.acuity import fit
from entoptic.pipeline.effects.acuity.bounds import dark_tiles, limit_cd_m2, propagate, skip_bound
from entoptic.pipeline.effects.acuity.cielab import EPSILON, KAPPA, WHITE_CD_M2, lightness, luminance_of
from entoptic.pipeline.effects.acuity.fit import LIMIT_CD_M2, RADIUS_PX, add_grey, dark_acuity
from entoptic.pipeline.effects.acuity.krawczyk import krawczyk_acuity
from entoptic.pipeline.effects.acuity.settings import Acuity, AcuityMethod
from entoptic.pipeline.effects.acuity.tiles import change_of_luminance
from entoptic.pipeline.effects.effect import Cost, Domain, Effect, Picture, TileChanges, TileRanges
from entoptic.pipeline.effects.pointwise import Pointwise
from entoptic.pipeline.frame import FrameError
from entoptic.pipeline.oracles.acuity import reference_acuity
from entoptic.pipeline.ranges import Change
from entoptic.pipeline.words import darkness

__all__ = [
    "ACUITY",
    "EPSILON",
    "KAPPA",
    "LIMIT_CD_M2",
    "RADIUS_PX",
    "WHITE_CD_M2",
    "Acuity",
    "AcuityEffect",
    "AcuityMethod",
    "dark_acuity",
    "dark_tiles",
    "lightness",
    "limit_cd_m2",
    "luminance_of",
    "propagate",
    "reduce_acuity",
    "skip_bound",
]


def reduce_acuity(
    rgb: Float[Array, "eye 3 y x"],
    pixels_per_deg: float,
    settings: Acuity = Acuity(),
    tiles: NDArray[np.bool_] | None = None,
    tile_px: int = 1,
) -> Float[Array, "eye 3 y x"]:
    """A frame in cd/m² without the detail that an eye loses in its dark parts.

    `tiles` (rows, columns) of `tile_px` are true where any eye's pixel may be below `limit_cd_m2` (`dark_tiles`): with
    them the fit works on those alone, to the same result. Raises FrameError for tiles that are not the frame's, and for
    pixels per degree that are not a positive number.
    """
    if not (math.isfinite(pixels_per_deg) and pixels_per_deg > 0):
        raise FrameError(f"{pixels_per_deg} pixels per degree: acuity needs a positive number")
    if tiles is not None:
        height, width = rgb.shape[2:]
        expected = (-(-height // tile_px), -(-width // tile_px))
        if tiles.shape != expected:
            raise FrameError(
                f"{tiles.shape} tiles for a frame of {width}×{height}: of {tile_px} px it has {expected}, rows first"
            )
        if not tiles.any():
            return rgb
    if settings.reference:
        return jnp.asarray(reference_acuity(np.asarray(rgb), pixels_per_deg, settings), jnp.float32)
    if settings.method is AcuityMethod.KRAWCZYK:
        return krawczyk_acuity(rgb, pixels_per_deg, settings.display_limit)
    return dark_acuity(rgb) if tiles is None else add_grey(rgb, change_of_luminance(rgb, tiles, tile_px))


if TYPE_CHECKING:
    from entoptic.pipeline.eye_context import EyeContext


class AcuityEffect(Effect[Acuity, None]):
    """Detail that an eye loses in the dark."""

    name = "acuity"
    domain = Domain.SCENE
    Settings = Acuity
    needs_picture = True
    costs: Mapping[str, Cost] = {"fit": Cost(0.5, 8.0), "krawczyk": Cost(1.0, 28.0)}

    def full_level(self, settings: Acuity) -> str:
        return settings.method.value

    def affected_tiles(self, ranges: TileRanges, eye: EyeContext, settings: Acuity) -> NDArray[np.bool_]:
        return dark_tiles(ranges.image, eye.view.ppd_centre, settings)

    def apply(
        self,
        picture: Picture,
        eyes: Sequence[EyeContext],
        settings: Acuity,
        level: str,
        tiles: NDArray[np.bool_] | None,
    ) -> Float[Array, "eye 3 y x"]:
        tile_px = eyes[0].measured.range_cd_m2.tile_px
        return reduce_acuity(picture.image, eyes[0].view.ppd_centre, settings, tiles, tile_px)

    def pointwise(
        self,
        picture: Picture,
        eyes: Sequence[EyeContext],
        settings: Acuity,
        level: str,
        tiles: NDArray[np.bool_] | None,
    ) -> Pointwise | None:
        if settings.reference or settings.method is not AcuityMethod.FIT or (tiles is not None and not tiles.any()):
            return None
        rgb, tile_px = picture.image, eyes[0].measured.range_cd_m2.tile_px
        change = fit.change_of_luminance(rgb) if tiles is None else change_of_luminance(rgb, tiles, tile_px)
        return Pointwise(fit.add_grey_to_planes, self.domain, planes=(change,))

    def bound(self, ranges: TileRanges, eye: EyeContext, settings: Acuity, level: str) -> Change:
        return skip_bound(ranges.image, eye.view.ppd_centre, settings)

    def propagate(self, changes: TileChanges, ranges: TileRanges, eye: EyeContext, settings: Acuity) -> Change:
        return propagate(changes.image, ranges.image, eye.view.ppd_centre, settings)

    def reason(self, eye: EyeContext, settings: Acuity) -> str:
        limit = limit_cd_m2(eye.view.ppd_centre, settings)
        sharp = f"; an eye resolves every pixel above {limit:.2g}" if eye.measured.min_cd_m2 >= limit else ""
        return f"{darkness(eye.measured, 0.01)}{sharp}"

    def oracle(self, picture: Picture, eye: EyeContext, settings: Acuity) -> NDArray[np.float64]:
        return reference_acuity(np.asarray(picture.image, np.float64), eye.view.ppd_centre, settings)[0]

    def accuracy(self, settings: Acuity) -> float:
        return 0.01

    def variants(self) -> Mapping[str, Acuity]:
        return {
            "fit": Acuity(),
            "krawczyk": Acuity(method=AcuityMethod.KRAWCZYK),
            "krawczyk, no display limit": Acuity(method=AcuityMethod.KRAWCZYK, display_limit=False),
        }


ACUITY = AcuityEffect()
