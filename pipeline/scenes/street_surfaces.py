"""What the embedded street is built of: sky, ground and facades, and the light that falls on them.

Each pixel's ray meets one of them; patterns, lamplight and the edges of buildings are averaged over the pixel's
footprint, so that nothing far away shimmers: beyond 40 m, seen through a Gaussian of two pixels, the light in 95 of 100
directions changes by less than 8 % as the head moves by parts of a pixel.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt32

from entoptic.pipeline.frame import View

EYE_HEIGHT_M = 1.5
ROAD_M, PAVEMENT_M = 4.0, 8.0
"""Half widths: of the road, and of all up to the facades."""
WINDOW_M, FLOOR_M = 2.6, 3.2
BUILDING_M, PARAPET_M = 5 * WINDOW_M, 0.5
"""Five windows wide and three to five floors high, so that neither neighbour nor roof cuts a window."""
ROOF_CLIMB = np.float32(1.5)
"""A roof is about 12 m above the eye and 8 m beside it: the slope of its line in a picture straight ahead."""
WALLS_END_M = 400.0
LIT_SHARE = 0.28

ASPHALT, PAVING, PAINT, KERB, WALL, GLASS = 0.07, 0.16, 0.45, 0.3, 0.22, 0.07
"""Albedos."""

SODIUM = (1.75, 0.86, 0.17)
LED = (1.16, 0.97, 0.83)
WARM = (1.45, 0.92, 0.45)
XENON = (0.95, 1.0, 1.12)
"""Linear Rec.709 at luminance 1."""

LAMP_HEIGHT_M, LAMP_DOWN_CD = 6.5, 900.0
"""Luminaires with cut-off: 900 cd downwards, 0.5 cd/m² on the asphalt below."""
LAMPS_END_M, BEYOND_LUX = 81.0, 8.2
"""How far from the middle of the row lamps light the street, and the mean that stands for those after the last."""
BEAM_CD = 2e4
"""Of headlights on the road before them."""
START_M, SPEED_M_S = 100.0, 13.0
"""From where and how fast a car comes."""
MOON_LUX = 0.15
"""On what faces the moon; on all else in the street 0.4 of it, from the sky around."""
GABLE_CD_M2 = 0.4 * MOON_LUX * WALL / np.pi


def _lamp_places() -> np.ndarray:
    z = np.arange(-1, 8) * 18.0 + 9.0
    x = np.where(np.arange(len(z)) % 2 == 0, -5.3, 5.3)
    return np.stack([x, np.full_like(z, LAMP_HEIGHT_M), z], axis=1).astype(np.float32)


LAMPS_M = _lamp_places()
LAMP_RGB = np.where((np.arange(len(LAMPS_M)) % 2 == 0)[:, None], SODIUM, LED).astype(np.float32)


def arrived(oncoming_m: Array) -> Array:
    """0 where a car appears, 1 from a second on: otherwise its lights would jump when the next one comes."""
    return jnp.clip((START_M - oncoming_m) / SPEED_M_S, 0, 1)


@functools.partial(jax.jit, static_argnames="view")
def surfaces(
    direction: Float[Array, "3 y x"],
    axes: Float[Array, "3 3"],
    eye: Float[Array, "3"],
    oncoming_m: Float[Array, ""],
    view: View,
) -> Float[Array, "3 y x"]:
    """Sky, ground and facades, without lights of their own size."""
    x, y, z = direction
    far = np.float32(1e7)  # beyond any wall, or the sky straight ahead would be taken for ground
    to_ground = jnp.where(y < -1e-5, -eye[1] / jnp.minimum(y, -1e-5), far)
    side = jnp.sign(x)
    to_wall = _to_wall(x, eye)
    on_ground = jax.lax.optimization_barrier(to_ground < to_wall)
    depth = jnp.where(on_ground, to_ground, to_wall)
    across_m, along_m = jax.lax.optimization_barrier(_footprint(direction, axes, depth, on_ground, view))
    shares = _buildings(direction, axes, to_wall, along_m, eye, view)
    wall_share, gable_share = jax.lax.optimization_barrier(shares)
    # Without barriers XLA computes each of these again for every channel that uses it.
    point, depth = jax.lax.optimization_barrier((eye[:, None, None] + depth * direction, depth))
    light = jax.lax.optimization_barrier(_illuminance(point, along_m, on_ground, side, oncoming_m))
    ground = light * jax.lax.optimization_barrier(_ground_albedo(point, across_m, along_m)) / np.float32(np.pi)
    glass, glow = _windows(point, across_m, along_m, side)
    wall = light * ((WALL + (GLASS - WALL) * glass) / np.float32(np.pi)) + glow
    up = y / jnp.sqrt(x * x + y * y + z * z)
    # Moonlit sky: 0.003 cd/m² overhead, ten times that in the town's haze.
    haze = jax.lax.optimization_barrier(0.003 + 0.03 * jnp.exp(-jnp.clip(up, 0, 1) / 0.13))
    sky = haze * jnp.asarray([0.72, 1.0, 1.5], jnp.float32)[:, None, None]
    above = sky + wall_share * (wall - sky) + gable_share * (GABLE_CD_M2 - sky)
    return jnp.where(on_ground, ground, above).astype(jnp.float32)


def _footprint(
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
    pixel_m = depth / np.float32(view.focal_px)
    across, along = jnp.where(on_ground, x, y) * inverse, z * inverse
    across_right, across_up = jnp.where(on_ground, right_x, right_y), jnp.where(on_ground, up_x, up_y)
    across_m = pixel_m * jnp.sqrt((across_right - across * right) ** 2 + (across_up - across * up) ** 2)
    along_m = pixel_m * jnp.sqrt((right_z - along * right) ** 2 + (up_z - along * up) ** 2)
    return (across_m + 1e-4).astype(jnp.float32), (along_m + 1e-4).astype(jnp.float32)


def sky_share(
    direction: Float[Array, "3 *n"], axes: Float[Array, "3 3"], eye: Float[Array, "3"], view: View
) -> Float[Array, "*n"]:
    """How much of a pixel in a direction above the horizon no building hides."""
    to_wall = _to_wall(direction[0], eye)
    along_m = to_wall / np.float32(view.focal_px) / jnp.maximum(jnp.abs(direction[0]), np.float32(1e-4))
    wall_share, gable_share = _buildings(direction, axes, to_wall, along_m + np.float32(1e-4), eye, view)
    return 1 - wall_share - gable_share


def _to_wall(x: Float[Array, "*n"], eye: Float[Array, "3"]) -> Float[Array, "*n"]:
    return (PAVEMENT_M - jnp.sign(x) * eye[0]) / jnp.maximum(jnp.abs(x), np.float32(1e-5))


def _buildings(
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
    steep = jnp.where(
        x > 0,
        jnp.hypot(ROOF_CLIMB * axes[0, 0] - axes[1, 0], ROOF_CLIMB * axes[0, 1] - axes[1, 1]),
        jnp.hypot(ROOF_CLIMB * axes[0, 0] + axes[1, 0], ROOF_CLIMB * axes[0, 1] + axes[1, 1]),
    ).astype(jnp.float32)
    pixel_m = to_wall * np.float32(1 / view.focal_px) + np.float32(1e-4)
    past_m = np.float32(PAVEMENT_M) * (to_wall * np.float32(1 / WALLS_END_M) - 1)
    ends = jnp.clip(np.float32(0.5) - past_m / pixel_m, 0, 1)

    def seen(building: Array) -> tuple[Array, Array]:
        roof = _roof_m(building, right, apart)
        facade = jnp.clip((roof - eye[1] - to_wall * y) / (steep * pixel_m) + np.float32(0.5), 0, 1) * ends
        border_m = (building + forwards).astype(jnp.float32) * np.float32(BUILDING_M) - eye[2]
        to_gable = jnp.maximum(jnp.abs(border_m) / jnp.maximum(jnp.abs(z), np.float32(1e-4)), to_wall)
        behind = _roof_m(building + 2 * forwards - 1, right, apart)
        gable = jnp.clip((behind - eye[1] - to_gable * y) / pixel_m + np.float32(0.5), 0, 1)
        return facade, (1 - facade) * gable * apart * ends

    at = (eye[2] + to_wall * z) * np.float32(1 / BUILDING_M)
    building, border = jnp.floor(at), jnp.floor(at + np.float32(0.5))
    # What of the pixel lies beyond the nearest border belongs to the neighbour.
    beyond = jnp.clip(np.float32(0.5) - jnp.abs(at - border) * np.float32(BUILDING_M) / along_m, 0, np.float32(0.5))
    own, neighbour = seen(building.astype(jnp.int32)), seen((2 * border - 1 - building).astype(jnp.int32))
    return own[0] + beyond * (neighbour[0] - own[0]), own[1] + beyond * (neighbour[1] - own[1])


def _roof_m(building: Array, right: Array, apart: Array) -> Array:
    own = jnp.floor(3 * _hash(building, right, 1)) - 1
    return np.float32(4 * FLOOR_M + PARAPET_M) + np.float32(FLOOR_M) * own * apart


def _illuminance(
    point: Float[Array, "3 y x"],
    along_m: Float[Array, "y x"],
    on_ground: Array,
    side: Float[Array, "y x"],
    oncoming_m: Float[Array, ""],
) -> Float[Array, "3 y x"]:
    """Lux on a surface from moon, lamps and headlights, coloured; that of lamps over `along_m` of the street."""
    # Component by component and colour by colour: as 3-vectors, XLA makes ten times as many passes over memory.
    x, y, z = point
    by_colour = [jnp.zeros_like(x), jnp.zeros_like(x)]
    # h/(h² + z²)^1.5, the light of a lamp along the street, is half its peak over 1.53 h. A longer footprint widens it
    # by as much, and the factor in front keeps its integral.
    widening = along_m * along_m * np.float32(1 / 1.53**2)
    for k, (lamp_x, lamp_y, lamp_z) in enumerate(LAMPS_M):
        dx, dy, dz = lamp_x - x, lamp_y - y, lamp_z - z
        beside = dx * dx + dy * dy + np.float32(0.05)
        inverse = jax.lax.rsqrt(beside + widening + dz * dz)
        # A luminaire shines down and sideways, little upwards.
        down = jnp.clip(np.float32(0.25) + dy * inverse, 0, 1)
        facing = jnp.maximum(jnp.where(on_ground, dy, -side * dx), 0)
        widened = 1 + widening / beside
        by_colour[k % 2] += np.float32(LAMP_DOWN_CD) * facing * down * widened * inverse * inverse * inverse
    dx, dy, dz = np.float32(-2.0) - x, np.float32(0.65) - y, oncoming_m - z
    inverse = jax.lax.rsqrt(dx * dx + dy * dy + dz * dz + np.float32(0.1))
    ahead = jnp.maximum(dz, np.float32(0.1))
    away = (dx * dx + (dy - np.float32(0.03) * dz) ** 2) / (ahead * ahead)
    beam = np.float32(BEAM_CD) * jnp.exp(-away / np.float32(0.22**2)) * (dz > 0) * arrived(oncoming_m)
    facing = jnp.maximum(jnp.where(on_ground, dy, -side * dx), 0)
    beyond = jnp.clip((jnp.abs(z - LAMPS_M[:, 2].mean()) - np.float32(LAMPS_END_M)) / 10, 0, 1)
    beyond = np.float32(BEYOND_LUX / 2) * beyond * jnp.clip(np.float32(1.8) - y / 5, 0, 1)
    lit = [by_colour[0] + beyond, by_colour[1] + beyond, beam * facing * inverse * inverse * inverse]
    channels = [
        sum((np.float32(rgb[c]) * lux for rgb, lux in zip((SODIUM, LED, XENON), lit, strict=True)), MOON_LUX * 0.4)
        for c in range(3)
    ]
    return jnp.stack([jnp.asarray(channel, jnp.float32) for channel in channels])


def _repeat(at: Array, period: float) -> Array:
    """Modulo; XLA's own calls the C library for each pixel."""
    return at - np.float32(period) * jnp.floor(at * np.float32(1 / period))


def _stripe(at: Array, centre: float, width: float, footprint: Array) -> Array:
    """Share of a footprint that a stripe covers."""
    low = jnp.maximum(at - footprint / 2, centre - width / 2)
    high = jnp.minimum(at + footprint / 2, centre + width / 2)
    return jnp.clip((high - low) / footprint, 0, 1)


def _stripes(at: Array, period: float, start: float, width: float, footprint: Array) -> Array:
    """Share of a footprint of any size that stripes cover."""

    def covered_up_to(place: Array) -> Array:
        whole = jnp.floor(place * np.float32(1 / period))
        return whole * np.float32(width) + jnp.clip(place - np.float32(period) * whole - np.float32(start), 0, width)

    return (covered_up_to(at + footprint / 2) - covered_up_to(at - footprint / 2)) / footprint


def _ground_albedo(
    point: Float[Array, "3 y x"], across: Float[Array, "y x"], along: Float[Array, "y x"]
) -> Float[Array, "y x"]:
    x, _, z = point
    road = _stripe(x, 0.0, 2 * ROAD_M, across)
    albedo = PAVING + (ASPHALT - PAVING) * road
    paint = _stripe(x, 0.0, 0.15, across) * _stripes(z, 8.0, 0.5, 3.0, along)
    paint += _stripe(jnp.abs(x), ROAD_M - 0.35, 0.12, across)
    # A crossing before the signals.
    paint = jnp.maximum(paint, _stripe(z, 26.0, 3.0, along) * road * _stripes(x, 1.0, 0.25, 0.5, across))
    kerb = _stripe(jnp.abs(x), ROAD_M + 0.1, 0.2, across)
    return albedo * (1 - paint - kerb) + PAINT * paint + KERB * kerb


def _windows(
    point: Float[Array, "3 y x"], tall: Float[Array, "y x"], wide: Float[Array, "y x"], side: Float[Array, "y x"]
) -> tuple[Float[Array, "y x"], Float[Array, "3 y x"]]:
    """Share of glass, and lit windows in cd/m²; further away than they can be told apart, their mean."""
    _, y, z = point
    column, floor = jnp.floor(z / WINDOW_M).astype(jnp.int32), jnp.floor(y / FLOOR_M).astype(jnp.int32)
    pane = _stripe(_repeat(z, WINDOW_M), WINDOW_M / 2, 1.3, wide) * _stripe(_repeat(y, FLOOR_M), 1.7, 1.6, tall)
    bar = 1 - 0.85 * _stripe(_repeat(z, WINDOW_M), WINDOW_M / 2, 0.07, wide)
    key = column * 2 + (side > 0).astype(jnp.int32)
    lit = _hash(key, floor, 3) < LIT_SHARE
    luminance = 4 * jnp.exp(np.float32(np.log(12)) * _hash(key, floor, 4))
    warmth = _hash(key, floor, 5)[None]
    colour = (
        warmth * jnp.asarray(WARM, jnp.float32)[:, None, None]
        + (1 - warmth) * jnp.asarray(LED, jnp.float32)[:, None, None]
    )
    curtain = 0.6 + 0.4 * jnp.clip((_repeat(y, FLOOR_M) - 0.9) / 1.6, 0, 1)
    glow = jax.lax.optimization_barrier(jnp.where(lit, luminance * curtain, 0.003) * pane * bar)
    near = glow[None] * colour
    share = 1.3 / WINDOW_M * 1.6 / FLOOR_M
    mean = jnp.asarray(np.multiply(0.5 * share * LIT_SHARE * 14, np.add(WARM, LED)), jnp.float32)[:, None, None]
    resolved = jnp.clip(1.6 - wide / 0.9, 0, 1)
    return share + (pane - share) * resolved, mean + (near - mean) * resolved


def _hash(a: Array, b: Array, salt: int) -> Float[Array, "..."]:
    """Uniform in [0, 1) for two integers, the same on every machine."""
    value: UInt32[Array, "..."] = a.astype(jnp.uint32) * np.uint32(0x9E3779B1) ^ b.astype(jnp.uint32) * np.uint32(
        0x85EBCA77
    )
    value = (value ^ np.uint32(salt * 0xC2B2AE3D & 0xFFFFFFFF)) * np.uint32(0x27D4EB2F)
    value = (value ^ (value >> 15)) * np.uint32(0x2C1B3C6D)
    value = value ^ (value >> 12)
    return (value >> 8).astype(jnp.float32) * np.float32(2**-24)
