"""Glare of one eye as the direct sum over the sphere, with the function that its settings name.

Formulas are written anew from their papers. Wave optics' function, and SPE's flare lines, are taken as they are sampled
at pixels' size and finer: what is judged here is where light goes, not whose function it is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, View
from entoptic.pipeline.observer import Iris
from entoptic.pipeline.oracles import point_spread, sphere
from entoptic.pipeline.oracles.sphere import Function

if TYPE_CHECKING:
    from collections.abc import Callable

    from entoptic.pipeline.effects.glare.kernel import Mixture
    from entoptic.pipeline.eye_context import EyeContext

Reals = NDArray[np.float64]

PIGMENTATION = {Iris.DARK: 0.0, Iris.BROWN: 0.5, Iris.GREEN: 1.0, Iris.BLUE: 1.2}
"""Vos 2003."""
STRAYLIGHT = {Iris.DARK: 0.056, Iris.BROWN: 0.106, Iris.GREEN: 0.142, Iris.BLUE: 0.16}
"""IJspeert 1993; the population's mean for green."""
CELLS_PER_PX, CORE_PER_PX, CORE_PX = 3, 12, 5
"""Samples of a function along a pixel of the view's middle, and within CORE_PX of its axis."""
LARGEST_PX = 260
"""How far samples reach at most: a view of so many pixels per degree that 9° are more has pixels finer than any lamp's
glare beyond."""


def of_eye(
    light: ArrayLike,
    eye: EyeContext,
    mixture: Mixture,
    model: str,
    is_mirrored: bool,
    beyond_cd_m2: Reals,
    ceiling_cd_m2: float | None = None,
) -> Reals:
    """One eye's image (3, y, x) in cd/m² with glare of its pixels. `mixture` is what its function is sampled of.

    Beyond the image, or its mirror image around it, is light of `beyond_cd_m2` all over, which scatters into itself.
    """
    values, view, beyond = np.asarray(light, np.float64), eye.view, np.asarray(beyond_cd_m2, np.float64)[:, None, None]
    down, right = (-(-size // 4) if is_mirrored else 0 for size in values.shape[1:])
    values = np.pad(values, ((0, 0), (down, down), (right, right)), mode="symmetric")
    width = view.width_px + 2 * right
    fov_deg = 2 * np.degrees(np.arctan(width / 2 / view.focal_px))
    view = View(width, view.height_px + 2 * down, float(fov_deg))
    function = function_of(eye, mixture, model)
    spreads = values
    if ceiling_cd_m2 is not None:
        spreads, beyond = (
            each * (1 - ceiling_cd_m2 / np.maximum(np.einsum("c,cyx->yx", LUMINANCE_WEIGHTS, each), ceiling_cd_m2))
            for each in (values, beyond)
        )
    seen = values - spreads + beyond + sphere.glare(spreads - beyond, view, function)
    return np.asarray(seen[:, down : down + eye.view.height_px, right : right + eye.view.width_px])


def function_of(eye: EyeContext, mixture: Mixture, model: str) -> Function:
    """The function of an eye as it stands."""
    age, iris = eye.observer.age_years, eye.observer.iris
    match model:
        case "cie":
            return point_spread.alike(point_spread.cie135(age, PIGMENTATION[iris]))
        case "ijspeert":
            return point_spread.alike(point_spread.ijspeert(eye.aperture.pupil_diameter_mm, age, STRAYLIGHT[iris]))
    per_deg = eye.view.ppd_centre
    fine, core = (
        _sampled(mixture, per_deg * count, reach)
        for count, reach in (
            (CELLS_PER_PX, min(int(np.ceil(sphere.SPLIT_DEG * per_deg)) + 1, LARGEST_PX) * CELLS_PER_PX),
            (CORE_PER_PX, CORE_PX * CORE_PER_PX),
        )
    )
    return point_spread.sampled(
        fine, 1 / (per_deg * CELLS_PER_PX), core, 1 / (per_deg * CORE_PER_PX), _wide(eye, mixture, model)
    )


def _sampled(mixture: Mixture, per_deg: float, reach: int) -> Reals:
    """The light in cells; twice as far out as else, the veil leaves all of it to them."""
    parts = [weight * part.cells(per_deg, reach, 2.0) for part, weight in mixture]
    if len({len(part) for part in parts}) > 1:
        parts = [np.eye(3)[:, :, None, None] * part for part in parts]
    return np.asarray(sum(parts))


def _wide(eye: EyeContext, mixture: Mixture, model: str) -> Callable[[Reals], Reals]:
    if model == "wave":
        printed = point_spread.cie135(eye.observer.age_years, PIGMENTATION[eye.observer.iris])
        return point_spread.alike(printed).far
    veils = [(weight, part.veil) for part, weight in mixture if part.veil is not None]

    def wide(deg: Reals) -> Reals:
        return np.sum([weight * veil.function(deg, *veil.parameters) for weight, veil in veils], axis=0)

    return wide
