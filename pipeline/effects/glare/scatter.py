"""One eye's image with glare: pooled, scattered over the plane, and near light laid down where it stands out."""

from __future__ import annotations

import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare import apart, lights, outside, spread, stamps
from entoptic.pipeline.effects.glare.apart import Choice
from entoptic.pipeline.effects.glare.around import Around, at_cells
from entoptic.pipeline.effects.glare.kernel import Mixture, prepared
from entoptic.pipeline.effects.glare.plane import Plane, plane_of
from entoptic.pipeline.effects.glare.settings import GlareLevel
from entoptic.pipeline.frame import Light, View
from entoptic.pipeline.measure import luminance
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics.aperture import Pose

POOLS = {GlareLevel.EIGHTH: 8, GlareLevel.QUARTER: 4, GlareLevel.HALF: 2, GlareLevel.FULL: 1}
FEWEST_CELLS = 48
"""Along the shorter side: of smaller frames fewer pixels are pooled. Engineering choice: a frame of so few pixels costs
nothing to speak of."""
CHOICES = {8: Choice(16, 512), 4: Choice(6, 1024), 2: Choice(6, 1024), 1: Choice(4, 1024)}
"""What stands out where so many pixels are pooled. Engineering choice: the least that keeps a street at night within
1 % of the truth at the median and 3 % at nine pixels of ten; more takes longer than the level itself."""


MIRRORED = 0.25
"""How far a frame is mirrored beyond its edges, as a share of its sides. Engineering choice: 2.25 times the pixels."""
RESTING = Pose(4.0)
DARKNESS = np.zeros(3)


def plane_for(view: View, level: GlareLevel) -> Plane:
    """The plane of a view at a level."""
    pool = POOLS[level]
    while pool > 1 and min(view.width_px, view.height_px) / pool < FEWEST_CELLS:
        pool //= 2
    return plane_of(view, pool)


def glare(
    rgb: Float[Array, "3 y x"],
    view: View,
    mixture: Mixture,
    level: GlareLevel,
    ceiling_cd_m2: float | None = None,
    own_lights: Sequence[Light] = (),
    observer: Observer = Observer(),
    pose: Pose = RESTING,
    beyond_cd_m2: NDArray[np.floating] = DARKNESS,
    around: Around | None = None,
) -> Float[Array, "3 y x"]:
    """An image in cd/m² with the glare of all its light, or of that above a ceiling, and of lights of their own.

    A channel may lie below 0, where a colour is not the display's; Y does not. None is made: what the frame loses
    leaves it at its edges, where it gets as much from beyond as is said to be there.
    """
    rgb = lights.drawn(rgb, own_lights, view)
    plane = plane_for(view, level)
    beyond = jax.device_put(np.float32(beyond_cd_m2))[:, None, None]
    light = rgb
    if ceiling_cd_m2 is not None:
        light, beyond = (_above(each, np.float32(ceiling_cd_m2)) for each in (rgb, beyond))
    rest = -view.height_px % plane.pool, -view.width_px % plane.pool
    light = _more(light, beyond)
    if any(rest):
        light = jnp.pad(light, ((0, 0), (0, rest[0]), (0, rest[1])))
    pooled = spread.pooled(light, plane.pool)
    pixels = apart.standing_out(light, pooled.cells, beyond, plane, CHOICES[plane.pool])
    parts = [(part, made, weight) for (part, _), (made, weight) in zip(mixture, prepared(mixture, plane), strict=True)]
    weights = np.array([weight for *_, weight in parts], np.float32)
    mixed = spread.mixed([made.mixed for _, made, _ in parts], weights)
    without = spread.without(pooled, pixels, plane.pool)
    points = lights.placed(own_lights, view, observer, pose, ceiling_cd_m2)
    low = spread.arrives(
        plane,
        pooled.cells,
        without.cells,
        [made for _, made, _ in parts],
        weights,
        beyond,
        lights.on_plane(points, plane),
    )
    if (far_away := outside.from_outside(points, plane)) is not None:
        low = low + far_away.astype(np.float32)
    if around is not None:
        low = low + at_cells(around, view, plane.pool)
    result = spread.combined(light, without, low, mixed, beyond, view, plane.pool)
    if any(rest):
        result = result[:, : view.height_px, : view.width_px]
    result = stamps.lay_down(result, pixels, plane, parts, mixed)
    result = lights.lay_down(result, points, plane)
    if ceiling_cd_m2 is None:
        return result
    return _with_rest(rgb, _above(rgb, np.float32(ceiling_cd_m2)), result)


def mirrored(rgb: Float[Array, "3 y x"], view: View) -> tuple[Float[Array, "3 y x"], View]:
    """A frame with its mirror image around it, and its view; `cropped` takes it away again."""
    most = math.floor(view.focal_px * math.tan(math.radians(87))) - view.width_px // 2
    down, right = math.ceil(view.height_px * MIRRORED), max(min(math.ceil(view.width_px * MIRRORED), most), 0)
    width = view.width_px + 2 * right
    wide = View(width, view.height_px + 2 * down, math.degrees(2 * math.atan(width / 2 / view.focal_px)))
    return jnp.pad(rgb, ((0, 0), (down, down), (right, right)), mode="symmetric"), wide


def cropped(rgb: Float[Array, "3 y x"], view: View) -> Float[Array, "3 y x"]:
    """The middle of an image, as large as a view."""
    down, right = (rgb.shape[1] - view.height_px) // 2, (rgb.shape[2] - view.width_px) // 2
    return rgb[:, down : down + view.height_px, right : right + view.width_px]


@jax.jit
def _more(rgb: Float[Array, "3 y x"], beyond: Float[Array, "3 1 1"]) -> Float[Array, "3 y x"]:
    """In a pass of its own: XLA would work it out anew for each pixel of each stencil."""
    return rgb - beyond


@jax.jit
def _above(rgb: Float[Array, "3 y x"], ceiling_cd_m2: Array) -> Float[Array, "3 y x"]:
    """All that spreads where the display makes the rest itself."""
    return rgb * (1 - ceiling_cd_m2 / jnp.maximum(luminance(rgb), ceiling_cd_m2))


@jax.jit
def _with_rest(rgb: Float[Array, "3 y x"], light: Float[Array, "3 y x"], glaring: Array) -> Float[Array, "3 y x"]:
    return rgb - light + glaring
