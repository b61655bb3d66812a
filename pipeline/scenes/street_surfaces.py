"""What the embedded street is built of: sky, ground and facades, and the light that falls on them.

Each pixel's ray meets one of them; patterns are averaged over the pixel's footprint, so that nothing far away shimmers.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt32

from pipeline.frame import View

EYE_HEIGHT_M = 1.5
ROAD_M, PAVEMENT_M = 4.0, 8.0
"""Half widths: of the road, and of all up to the facades."""
WINDOW_M, FLOOR_M = 2.6, 3.2
BUILDING_M, PARAPET_M = 5 * WINDOW_M, 0.5
"""Five windows wide and three to five floors high, so that neither neighbour nor roof cuts a window."""
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
LAMPS_END_M, BEYOND_LUX = 81.0, 8.0
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
    direction: Float[Array, "3 y x"], eye: Float[Array, "3"], oncoming_m: Float[Array, ""], view: View
) -> Float[Array, "3 y x"]:
    """Sky, ground and facades, without lights of their own size."""
    x, y, z = direction
    far = np.float32(1e7)  # beyond any wall, or the sky straight ahead would be taken for ground
    to_ground = jnp.where(y < -1e-5, -eye[1] / jnp.minimum(y, -1e-5), far)
    side = jnp.sign(x)
    to_wall = _to_wall(x, eye)
    wall_share, gable_share = _buildings(direction, to_wall, eye, view)
    on_ground, wall_share, gable_share = jax.lax.optimization_barrier((to_ground < to_wall, wall_share, gable_share))
    depth = jnp.where(on_ground, to_ground, to_wall)
    # Without barriers XLA computes each of these again for every channel that uses it.
    point, depth = jax.lax.optimization_barrier((eye[:, None, None] + depth * direction, depth))
    light = jax.lax.optimization_barrier(_illuminance(point, on_ground, side, oncoming_m))
    ground = light * jax.lax.optimization_barrier(_ground_albedo(point, depth, view)) / np.float32(np.pi)
    glass, glow = _windows(point, depth, x, side, view)
    wall = light * ((WALL + (GLASS - WALL) * glass) / np.float32(np.pi)) + glow
    up = y / jnp.sqrt(x * x + y * y + z * z)
    # Moonlit sky: 0.003 cd/m² overhead, ten times that in the town's haze.
    haze = jax.lax.optimization_barrier(0.003 + 0.03 * jnp.exp(-jnp.clip(up, 0, 1) / 0.13))
    sky = haze * jnp.asarray([0.72, 1.0, 1.5], jnp.float32)[:, None, None]
    above = sky + gable_share * (GABLE_CD_M2 - sky)
    return jnp.where(on_ground, ground, above + wall_share * (wall - above)).astype(jnp.float32)


def sky_share(direction: Float[Array, "3 *n"], eye: Float[Array, "3"], view: View) -> Float[Array, "*n"]:
    """How much of a pixel in a direction above the horizon no building hides."""
    wall_share, gable_share = _buildings(direction, _to_wall(direction[0], eye), eye, view)
    return (1 - wall_share) * (1 - gable_share)


def _to_wall(x: Float[Array, "*n"], eye: Float[Array, "3"]) -> Float[Array, "*n"]:
    return (PAVEMENT_M - jnp.sign(x) * eye[0]) / jnp.maximum(jnp.abs(x), np.float32(1e-5))


def _buildings(
    direction: Float[Array, "3 *n"], to_wall: Float[Array, "*n"], eye: Float[Array, "3"], view: View
) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """Shares of a pixel that a facade covers and, of what is left above it, the gable of the building behind."""
    x, y, z = direction
    right = (x > 0).astype(jnp.int32)
    pixel_m = jnp.maximum(to_wall / np.float32(view.focal_px), np.float32(1e-4))
    building = jnp.floor((eye[2] + to_wall * z) * np.float32(1 / BUILDING_M)).astype(jnp.int32)
    # Buildings narrower than a few pixels: their mean, without gables.
    apart = jnp.clip(np.float32(1.6) - pixel_m / jnp.maximum(jnp.abs(x), np.float32(0.02)) / np.float32(4.5), 0, 1)
    roof = _roof_m(building, right, apart)
    facade = jnp.clip((roof - eye[1] - to_wall * y) / pixel_m + np.float32(0.5), 0, 1) * (to_wall < WALLS_END_M)
    forwards = (z > 0).astype(jnp.int32)
    border_m = (building + forwards).astype(jnp.float32) * np.float32(BUILDING_M) - eye[2]
    to_gable = border_m / jnp.where(jnp.abs(z) > 1e-4, z, np.float32(1e-4))
    behind = _roof_m(building + 2 * forwards - 1, right, apart)
    gable = jnp.clip((behind - eye[1] - to_gable * y) / pixel_m + np.float32(0.5), 0, 1) * (to_gable < WALLS_END_M)
    return facade, gable * apart


def _roof_m(building: Array, right: Array, apart: Array) -> Array:
    own = jnp.floor(3 * _hash(building, right, 1)) - 1
    return np.float32(4 * FLOOR_M + PARAPET_M) + np.float32(FLOOR_M) * own * apart


def _illuminance(
    point: Float[Array, "3 y x"], on_ground: Array, side: Float[Array, "y x"], oncoming_m: Float[Array, ""]
) -> Float[Array, "3 y x"]:
    """Lux on a surface from moon, lamps and headlights, coloured."""
    # Component by component and colour by colour: as 3-vectors, XLA makes ten times as many passes over memory.
    x, y, z = point
    by_colour = [jnp.zeros_like(x), jnp.zeros_like(x)]
    for k, (lamp_x, lamp_y, lamp_z) in enumerate(LAMPS_M):
        dx, dy, dz = lamp_x - x, lamp_y - y, lamp_z - z
        inverse = jax.lax.rsqrt(dx * dx + dy * dy + dz * dz + np.float32(0.05))
        # A luminaire shines down and sideways, little upwards.
        down = jnp.clip(np.float32(0.25) + dy * inverse, 0, 1)
        facing = jnp.maximum(jnp.where(on_ground, dy, -side * dx), 0)
        by_colour[k % 2] += np.float32(LAMP_DOWN_CD) * facing * down * inverse * inverse * inverse
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


def _ground_albedo(point: Float[Array, "3 y x"], depth: Float[Array, "y x"], view: View) -> Float[Array, "y x"]:
    x, _, z = point
    across = depth / np.float32(view.focal_px) + 1e-4
    along = across * jnp.maximum(depth / EYE_HEIGHT_M, 1)
    road = _stripe(x, 0.0, 2 * ROAD_M, across)
    albedo = PAVING + (ASPHALT - PAVING) * road
    paint = _stripe(x, 0.0, 0.15, across) * _stripes(z, 8.0, 0.5, 3.0, along)
    for edge in (-ROAD_M + 0.35, ROAD_M - 0.35):
        paint += _stripe(x, edge, 0.12, across)
    # A crossing before the signals.
    paint = jnp.maximum(paint, _stripe(z, 26.0, 3.0, along) * road * _stripes(x, 1.0, 0.25, 0.5, across))
    kerb = _stripe(x, -ROAD_M - 0.1, 0.2, across) + _stripe(x, ROAD_M + 0.1, 0.2, across)
    return albedo * (1 - paint - kerb) + PAINT * paint + KERB * kerb


def _windows(
    point: Float[Array, "3 y x"],
    depth: Float[Array, "y x"],
    x: Float[Array, "y x"],
    side: Float[Array, "y x"],
    view: View,
) -> tuple[Float[Array, "y x"], Float[Array, "3 y x"]]:
    """Share of glass, and lit windows in cd/m²; further away than they can be told apart, their mean."""
    _, y, z = point
    tall = depth / np.float32(view.focal_px) + 1e-4
    wide = tall / jnp.maximum(jnp.abs(x), 0.02)
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
    mean = share * LIT_SHARE * 14 * (0.5 * jnp.asarray(WARM, jnp.float32) + 0.5 * jnp.asarray(LED, jnp.float32))[:, None, None]
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
