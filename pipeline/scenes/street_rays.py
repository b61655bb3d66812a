"""What each pixel's ray meets first: the ground, or the plane of the facades."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from entoptic.pipeline.frame import View
from entoptic.pipeline.scenes.scene import rays
from entoptic.pipeline.scenes.street_patterns import reciprocal
from entoptic.pipeline.scenes.street_plan import PAVEMENT_M


class Seen(NamedTuple):
    """What each pixel's ray meets first: the ground, or the plane of the facades, also above their roofs."""

    direction: Float[Array, "3 y x"]
    on_ground: Array
    depth: Float[Array, "y x"]
    to_wall: Float[Array, "y x"]
    place: tuple[Float[Array, "y x"], Float[Array, "y x"], Float[Array, "y x"]]
    """In metres."""


def seen_from(axes: Float[Array, "3 3"], eye: Float[Array, "3"], view: View) -> Seen:
    """For each pixel. To be called within jitted functions, each time anew: cheaper than to read it from memory."""
    direction = rays(view, axes)
    x, y, _ = direction
    far = np.float32(1e7)  # beyond any wall, or the sky straight ahead would be taken for ground
    to_ground = jnp.where(y < -1e-5, eye[1] * reciprocal(jnp.maximum(-y, 1e-5)), far)
    to_wall = to_wall_m(x, eye)
    on_ground = to_ground < to_wall
    depth = jnp.where(on_ground, to_ground, to_wall)
    place = [eye[k] + depth * direction[k] for k in range(3)]
    return Seen(direction, on_ground, depth, to_wall, (place[0], place[1], place[2]))


def to_wall_m(x: Float[Array, "*n"], eye: Float[Array, "3"]) -> Float[Array, "*n"]:
    """How far along rays the plane of the facades lies, x being their parts to the right."""
    return (PAVEMENT_M - jnp.sign(x) * eye[0]) * reciprocal(jnp.maximum(jnp.abs(x), np.float32(1e-5)))


def footprint_m(
    direction: Float[Array, "3 y x"],
    axes: Float[Array, "3 3"],
    depth: Float[Array, "y x"],
    on_ground: Array,
    view: View,
) -> tuple[Float[Array, "y x"], Float[Array, "y x"]]:
    """How many metres of ground or wall a pixel measures: across the street or up the wall, and along the street.

    The lengths of the gradients of the place that the ray meets, so that they hold for a head turned any way.
    """
    x, y, z = direction
    (right_x, up_x, _), (right_y, up_y, _), (right_z, up_z, _) = axes
    inverse = 1 / jnp.where(on_ground, jnp.minimum(y, np.float32(-1e-5)), jnp.where(jnp.abs(x) < 1e-5, 1e-5, x))
    right, up = jnp.where(on_ground, right_y, right_x), jnp.where(on_ground, up_y, up_x)
    pixel_m = depth * np.float32(1 / view.focal_px)
    across, along = jnp.where(on_ground, x, y) * inverse, z * inverse
    across_right, across_up = jnp.where(on_ground, right_x, right_y), jnp.where(on_ground, up_x, up_y)
    across_m = pixel_m * jnp.sqrt((across_right - across * right) ** 2 + (across_up - across * up) ** 2)
    along_m = pixel_m * jnp.sqrt((right_z - along * right) ** 2 + (up_z - along * up) ** 2)
    return (across_m + 1e-4).astype(jnp.float32), (along_m + 1e-4).astype(jnp.float32)
