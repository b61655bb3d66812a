"""The buildings on both sides of the street: their outlines, their windows and the light in them."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from entoptic.pipeline.frame import View
from entoptic.pipeline.scenes.street_patterns import reciprocal, repeat, stripe, uniform
from entoptic.pipeline.scenes.street_plan import (
    BUILDING_M,
    FLOOR_M,
    LIT_SHARE,
    PARAPET_M,
    PAVEMENT_M,
    ROOF_CLIMB,
    WALLS_END_M,
    WINDOW_M,
)
from entoptic.pipeline.scenes.street_rays import Seen, footprint_m, seen_from, to_wall_m


def sky_share(
    direction: Float[Array, "3 *n"], axes: Float[Array, "3 3"], eye: Float[Array, "3"], view: View
) -> Float[Array, "*n"]:
    """How much of a pixel in a direction above the horizon no building hides."""
    to_wall = to_wall_m(direction[0], eye)
    along_m = to_wall / np.float32(view.focal_px) / jnp.maximum(jnp.abs(direction[0]), np.float32(1e-4))
    wall_share, gable_share = building_shares(direction, axes, to_wall, along_m + np.float32(1e-4), eye, view)
    return 1 - wall_share - gable_share


@functools.partial(jax.jit, static_argnames="view")
def wall_share(
    axes: Float[Array, "3 3"], eye: Float[Array, "3"], along_m: Float[Array, "y x"], view: View
) -> Float[Array, "y x"]:
    """How much of a pixel facades cover."""
    seen = seen_from(axes, eye, view)
    return jnp.where(seen.on_ground, 0, building_shares(seen.direction, axes, seen.to_wall, along_m, eye, view)[0])


@functools.partial(jax.jit, static_argnames="view")
def gable_share(
    axes: Float[Array, "3 3"], eye: Float[Array, "3"], along_m: Float[Array, "y x"], view: View
) -> Float[Array, "y x"]:
    """How much of a pixel gables cover."""
    seen = seen_from(axes, eye, view)
    return jnp.where(seen.on_ground, 0, building_shares(seen.direction, axes, seen.to_wall, along_m, eye, view)[1])


def building_shares(
    direction: Float[Array, "3 *n"],
    axes: Float[Array, "3 3"],
    to_wall: Float[Array, "*n"],
    along_m: Float[Array, "*n"],
    eye: Float[Array, "3"],
    view: View,
) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """Shares of a pixel that facades cover and, above them, the gables of the buildings behind."""
    x, y, z = direction
    right = (x > 0).astype(jnp.int32)
    forwards = (z > 0).astype(jnp.int32)
    # Buildings narrower than a few pixels: their mean, without gables.
    apart = jnp.clip(np.float32(1.6) - along_m / np.float32(4.5), 0, 1)
    # Edges are straight lines in the picture, so what counts is the distance in pixels, across roofs' slanting lines.
    across = jnp.where(
        x > 0,
        1 / jnp.hypot(ROOF_CLIMB * axes[0, 0] - axes[1, 0], ROOF_CLIMB * axes[0, 1] - axes[1, 1]),
        1 / jnp.hypot(ROOF_CLIMB * axes[0, 0] + axes[1, 0], ROOF_CLIMB * axes[0, 1] + axes[1, 1]),
    ).astype(jnp.float32)
    pixel_m = to_wall * np.float32(1 / view.focal_px) + np.float32(1e-4)
    past_m = np.float32(PAVEMENT_M) * (to_wall * np.float32(1 / WALLS_END_M) - 1)
    per_m = reciprocal(pixel_m)
    ends = jnp.clip(np.float32(0.5) - past_m * per_m, 0, 1)

    def seen(building: Array) -> tuple[Array, Array]:
        roof = _roof_m(building, right, apart)
        facade = jnp.clip((roof - eye[1] - to_wall * y) * (across * per_m) + np.float32(0.5), 0, 1) * ends
        border_m = (building + forwards).astype(jnp.float32) * np.float32(BUILDING_M) - eye[2]
        to_gable = jnp.maximum(jnp.abs(border_m) * reciprocal(jnp.maximum(jnp.abs(z), np.float32(1e-4))), to_wall)
        behind = _roof_m(building + 2 * forwards - 1, right, apart)
        gable = jnp.clip((behind - eye[1] - to_gable * y) * per_m + np.float32(0.5), 0, 1)
        return facade, (1 - facade) * gable * apart * ends

    at = (eye[2] + to_wall * z) * np.float32(1 / BUILDING_M)
    building, border = jnp.floor(at), jnp.floor(at + np.float32(0.5))
    # What of the pixel lies beyond the nearest border belongs to the neighbour.
    beyond = jnp.clip(
        np.float32(0.5) - jnp.abs(at - border) * np.float32(BUILDING_M) * reciprocal(along_m), 0, np.float32(0.5)
    )
    own, neighbour = seen(building.astype(jnp.int32)), seen((2 * border - 1 - building).astype(jnp.int32))
    return own[0] + beyond * (neighbour[0] - own[0]), own[1] + beyond * (neighbour[1] - own[1])


def _roof_m(building: Array, right: Array, apart: Array) -> Array:
    own = jnp.floor(3 * uniform(building, right, 1)) - 1
    return np.float32(4 * FLOOR_M + PARAPET_M) + np.float32(FLOOR_M) * own * apart


def panes(seen: Seen, tall: Float[Array, "y x"], wide: Float[Array, "y x"]) -> tuple[Array, float, Array]:
    """Share of glass, its mean over a facade, and how well windows are told apart."""
    _, y, z = seen.place
    pane = stripe(repeat(z, WINDOW_M), WINDOW_M / 2, 1.3, wide) * stripe(repeat(y, FLOOR_M), 1.7, 1.6, tall)
    return pane, 1.3 / WINDOW_M * 1.6 / FLOOR_M, jnp.clip(1.6 - wide * np.float32(1 / 0.9), 0, 1)


def window_key(seen: Seen) -> tuple[Array, Array]:
    """Two integers that only one window has."""
    _, y, z = seen.place
    column, floor = (
        jnp.floor(at * np.float32(1 / side)).astype(jnp.int32) for at, side in ((z, WINDOW_M), (y, FLOOR_M))
    )
    return column * 2 + (seen.direction[0] > 0).astype(jnp.int32), floor


@functools.partial(jax.jit, static_argnames="view")
def window_light(
    axes: Float[Array, "3 3"], eye: Array, along_m: Float[Array, "y x"], walls: Float[Array, "y x"], view: View
) -> Float[Array, "y x"]:
    """Of windows that can be told apart, in cd/m²."""
    seen = seen_from(axes, eye, view)
    tall, _ = footprint_m(seen.direction, axes, seen.depth, seen.on_ground, view)
    pane, _, resolved = panes(seen, tall, along_m)
    _, y, z = seen.place
    bar = 1 - 0.85 * stripe(repeat(z, WINDOW_M), WINDOW_M / 2, 0.07, along_m)
    key = window_key(seen)
    lit = uniform(*key, 3) < LIT_SHARE
    luminance = 4 * jnp.exp(np.float32(np.log(12)) * uniform(*key, 4))
    curtain = 0.6 + 0.4 * jnp.clip((repeat(y, FLOOR_M) - 0.9) * np.float32(1 / 1.6), 0, 1)
    return jnp.where(lit, luminance * curtain, 0.003) * pane * bar * resolved * walls


def far_window_light(wide: Float[Array, "y x"]) -> Float[Array, "y x"]:
    """Mean of lit windows that are too far away to be told apart, in cd/m² of WARM and as much of LED."""
    mean = np.float32(0.5 * 1.3 / WINDOW_M * 1.6 / FLOOR_M * LIT_SHARE * 14)
    return mean * (1 - jnp.clip(1.6 - wide * np.float32(1 / 0.9), 0, 1))
