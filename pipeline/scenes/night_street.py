"""The embedded scene: a street at night in real luminances, computed, nothing to download.

The street runs along +z; metres, x to the right, y up, the person's eyes 1.5 m above the road. Each pixel's ray meets
the sky, the ground or a facade; patterns on them are averaged over the pixel's footprint, so that nothing far away
shimmers. Lights are drawn over that as discs that keep their flux however small they are.
Luminances and intensities are typical ones (CIE 115, ECE R112, the moon's own); the layout is an engineering choice.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt32

from pipeline.frame import Frame, View
from pipeline.scenes.discs import add_discs
from pipeline.scenes.scene import Head, count_eyes, headset_view, rays, rotation
from tracker_bridge.wire import Eye

EYE_HEIGHT_M = 1.5
PUPIL_DISTANCE_M = 0.063
ROAD_M, PAVEMENT_M = 4.0, 8.0
"""Half widths: of the road, and of all up to the facades."""
BUILDING_M = 14.0
WINDOW_M, FLOOR_M = 2.6, 3.2
LIT_SHARE = 0.28

ASPHALT, PAVING, PAINT, KERB, WALL = 0.07, 0.16, 0.45, 0.3, 0.22
"""Albedos."""

SODIUM = (1.75, 0.86, 0.17)
LED = (1.16, 0.97, 0.83)
WARM = (1.45, 0.92, 0.45)
XENON = (0.95, 1.0, 1.12)
RED, GREEN = (4.7021, 0.0, 0.0), (0.0160, 1.3701, 0.2326)
"""Linear Rec.709 at luminance 1 (the signals': KRI's chromaticities)."""

LAMP_M, LAMP_CD_M2, LAMP_HEIGHT_M, LAMP_DOWN_CD = 0.1, 1.2e4, 6.5, 900.0
"""Luminaires with cut-off: 900 cd downwards, 0.5 cd/m² on the asphalt below; 400 cd along the street."""
HEADLIGHT_M, DIPPED_CD_M2, FULL_CD_M2, BEAM_CD = 0.09, 4e4, 6e5, 2e4
"""Dipped, 1000 cd each towards an oncoming driver; full beam 1.5e4 cd. On the road before it, 2e4 cd."""
POST_M = 0.16
FLASH_S = (4.0, 4.6)
"""When in each approach the full beam is on."""
MOON_CD_M2, MOON_DEG = 2500.0, 0.26
MOON_LUX = 0.15
PERIOD_S, SPEED_M_S, START_M = 8.0, 13.0, 100.0
"""A car comes every eight seconds, from a hundred metres away."""
AHEAD_M, AHEAD_SPEED_M_S = 14.0, 2.2
"""Another draws away in one's own lane, and is there again after two periods."""


class _Lights(NamedTuple):
    """Discs of light."""

    at_m: Float[Array, "light 3"]
    radius_m: Float[Array, " light"]
    rgb_cd_m2: Float[Array, "light 3"]


def _lamp_places() -> np.ndarray:
    z = np.arange(-1, 8) * 18.0 + 9.0
    x = np.where(np.arange(len(z)) % 2 == 0, -5.3, 5.3)
    return np.stack([x, np.full_like(z, LAMP_HEIGHT_M), z], axis=1).astype(np.float32)


LAMPS_M = _lamp_places()
LAMP_RGB = np.where((np.arange(len(LAMPS_M)) % 2 == 0)[:, None], SODIUM, LED).astype(np.float32)


def _stars() -> tuple[np.ndarray, np.ndarray]:
    """Directions in the upper half of the sky, and illuminances in lux: magnitude 0 (2.5e-6 lx) to 4."""
    random = np.random.default_rng(5)
    up = random.uniform(0.25, 1.0, 90)
    azimuth = random.uniform(0, 2 * np.pi, 90)
    across = np.sqrt(1 - up**2)
    directions = np.stack([across * np.sin(azimuth), up, across * np.cos(azimuth)], axis=1)
    return directions.astype(np.float32), (2.54e-6 * 10 ** (-0.4 * random.uniform(0, 4, 90))).astype(np.float32)


STARS, STARS_LUX = _stars()
MOON = np.array([0.28, 0.62, 0.73], np.float32) / np.float32(np.linalg.norm([0.28, 0.62, 0.73]))


class NightStreet:
    """The scene. Implements Scene; a function of time, head and eye alone."""

    name = "night street"
    notes = ("night street: computed, absolute luminances from 0.003 (sky) to 6e5 cd/m² (headlights).",)

    def view_for(self, width_px: int | None, height_px: int | None, fov_deg: float) -> View:
        """Any view."""
        return headset_view(width_px, height_px, fov_deg)

    def frame(self, t_s: float, view: View, head: Head, eyes: tuple[Eye, ...]) -> Frame:
        """The street at a time, each eye from its own place."""
        count_eyes(eyes)
        axes = rotation(head)
        images = []
        for eye in eyes:
            side = 0.5 if eye is Eye.RIGHT else -0.5
            place = np.array([0.6, EYE_HEIGHT_M, 0.0], np.float32) + np.float32(side * PUPIL_DISTANCE_M) * axes[:, 0]
            images.append(_street(t_s, axes, place, view))
        return Frame(jnp.stack(images), view)


def _street(t_s: float, axes: np.ndarray, eye: np.ndarray, view: View) -> Float[Array, "3 y x"]:
    # Each stage is compiled alone: in one piece, XLA computes shared values again and takes twice as long.
    direction = rays(view, jnp.asarray(axes))
    within_s = np.float32(t_s % PERIOD_S)
    oncoming_m = np.float32(START_M - SPEED_M_S * within_s)
    ahead_m = np.float32(AHEAD_M + AHEAD_SPEED_M_S * (t_s % (2 * PERIOD_S)))
    full_beam = np.bool_(FLASH_S[0] <= within_s < FLASH_S[1])
    image = _surfaces(direction, eye, oncoming_m, view)
    image = _posts(image, direction, eye, view)
    return _objects(image, axes, eye, oncoming_m, ahead_m, full_beam, view)


@functools.partial(jax.jit, static_argnames="view")
def _objects(
    image: Float[Array, "3 y x"],
    axes: Float[Array, "3 3"],
    eye: Float[Array, "3"],
    oncoming_m: Float[Array, ""],
    ahead_m: Float[Array, ""],
    full_beam: Array,
    view: View,
) -> Float[Array, "3 y x"]:
    image = _cars(image, axes, eye, oncoming_m, ahead_m, view)
    image = _sky_lights(image, axes, eye, view)
    return _discs(image, _lights(oncoming_m, ahead_m, full_beam), axes, eye, view)


@functools.partial(jax.jit, static_argnames="view")
def _surfaces(
    direction: Float[Array, "3 y x"], eye: Float[Array, "3"], oncoming_m: Float[Array, ""], view: View
) -> Float[Array, "3 y x"]:
    """Sky, ground and facades, without lights of their own size."""
    x, y, z = direction
    far = np.float32(1e7)  # beyond any wall, or the sky straight ahead would be taken for ground
    to_ground = jnp.where(y < -1e-5, -eye[1] / jnp.minimum(y, -1e-5), far)
    side = jnp.sign(x)
    to_wall = (PAVEMENT_M - side * eye[0]) / jnp.maximum(jnp.abs(x), 1e-5)
    wall_y, wall_z = eye[1] + to_wall * y, eye[2] + to_wall * z
    building = jnp.floor(wall_z / BUILDING_M).astype(jnp.int32)
    roof = 9.0 + 7.0 * _hash(building, (side > 0).astype(jnp.int32), 1)
    pixel = to_wall / np.float32(view.focal_px)
    wall_share = jnp.clip((roof - wall_y) / jnp.maximum(pixel, 1e-4) + 0.5, 0, 1) * (to_wall < 400)
    on_ground, wall_share = jax.lax.optimization_barrier((to_ground < to_wall, wall_share))
    depth = jnp.where(on_ground, to_ground, to_wall)
    # Without barriers XLA computes each of these again for every channel that uses it.
    point, depth = jax.lax.optimization_barrier((eye[:, None, None] + depth * direction, depth))
    light = jax.lax.optimization_barrier(_illuminance(point, on_ground, side, oncoming_m))
    ground = light * jax.lax.optimization_barrier(_ground_albedo(point, depth, view)) / np.float32(np.pi)
    wall = light * WALL / np.float32(np.pi) + _windows(point, depth, x, side, view)
    up = y / jnp.sqrt(x * x + y * y + z * z)
    # Moonlit sky: 0.003 cd/m² overhead, ten times that in the town's haze.
    haze = jax.lax.optimization_barrier(0.003 + 0.03 * jnp.exp(-jnp.clip(up, 0, 1) / 0.13))
    sky = haze * jnp.asarray([0.72, 1.0, 1.5], jnp.float32)[:, None, None]
    return jnp.where(on_ground, ground, wall_share * wall + (1 - wall_share) * sky).astype(jnp.float32)


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
    beam = np.float32(BEAM_CD) * jnp.exp(-away / np.float32(0.22**2)) * (dz > 0) * _arrived(oncoming_m)
    facing = jnp.maximum(jnp.where(on_ground, dy, -side * dx), 0)
    lit = [*by_colour, beam * facing * inverse * inverse * inverse]
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


def _ground_albedo(point: Float[Array, "3 y x"], depth: Float[Array, "y x"], view: View) -> Float[Array, "y x"]:
    x, _, z = point
    across = depth / np.float32(view.focal_px) + 1e-4
    along = across * jnp.maximum(depth / EYE_HEIGHT_M, 1)
    road = _stripe(x, 0.0, 2 * ROAD_M, across)
    albedo = PAVING + (ASPHALT - PAVING) * road
    dash = _stripe(_repeat(z, 8.0), 2.0, 3.0, jnp.minimum(along, 8.0))
    dash = jnp.where(along > 8.0, 3 / 8, dash)
    paint = _stripe(x, 0.0, 0.15, across) * dash
    for edge in (-ROAD_M + 0.35, ROAD_M - 0.35):
        paint += _stripe(x, edge, 0.12, across)
    kerb = _stripe(x, -ROAD_M - 0.1, 0.2, across) + _stripe(x, ROAD_M + 0.1, 0.2, across)
    # A crossing before the signals.
    bars = jnp.where(across > 0.5, 0.5, _stripe(_repeat(x, 1.0), 0.5, 0.5, across))
    paint += _stripe(z, 26.0, 3.0, along) * road * bars
    return albedo * (1 - paint - kerb) + PAINT * paint + KERB * kerb


def _windows(
    point: Float[Array, "3 y x"],
    depth: Float[Array, "y x"],
    x: Float[Array, "y x"],
    side: Float[Array, "y x"],
    view: View,
) -> Float[Array, "3 y x"]:
    """Lit windows in cd/m²; further away than they can be told apart, their mean."""
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
    glow = jax.lax.optimization_barrier(jnp.where(lit, luminance * curtain, 0.02) * pane * bar)
    near = glow[None] * colour
    share = 1.3 / WINDOW_M * 1.6 / FLOOR_M * LIT_SHARE
    mean = share * 14 * (0.5 * jnp.asarray(WARM, jnp.float32) + 0.5 * jnp.asarray(LED, jnp.float32))[:, None, None]
    resolved = jnp.clip(1.6 - wide / 0.9, 0, 1)
    return near * resolved + mean * (1 - resolved)


def _hash(a: Array, b: Array, salt: int) -> Float[Array, "..."]:
    """Uniform in [0, 1) for two integers, the same on every machine."""
    value: UInt32[Array, "..."] = a.astype(jnp.uint32) * np.uint32(0x9E3779B1) ^ b.astype(jnp.uint32) * np.uint32(
        0x85EBCA77
    )
    value = (value ^ np.uint32(salt * 0xC2B2AE3D & 0xFFFFFFFF)) * np.uint32(0x27D4EB2F)
    value = (value ^ (value >> 15)) * np.uint32(0x2C1B3C6D)
    value = value ^ (value >> 12)
    return (value >> 8).astype(jnp.float32) * np.float32(2**-24)


def _project(at: Float[Array, "*n 3"], axes: Float[Array, "3 3"], view: View) -> tuple[Array, Array, Array]:
    """x, y in pixels and depth of vectors from the eye."""
    right, up, depth = (at @ axes[:, k] for k in range(3))
    safe = jnp.where(depth > 0.2, depth, 1.0)
    x_px = view.width_px / 2 + view.focal_px * right / safe
    y_px = view.height_px / 2 - view.focal_px * up / safe
    return x_px.astype(jnp.float32), y_px.astype(jnp.float32), depth


def _pixel_centres(view: View) -> tuple[Float[Array, "y 1"], Float[Array, "1 x"]]:
    return (
        jnp.arange(view.height_px, dtype=jnp.float32)[:, None] + 0.5,
        jnp.arange(view.width_px, dtype=jnp.float32)[None, :] + 0.5,
    )


@functools.partial(jax.jit, static_argnames="view")
def _posts(image: Float[Array, "3 y x"], direction: Float[Array, "3 y x"], eye: Array, view: View) -> Array:
    """Lamp posts as dark verticals."""
    x, y, z = direction
    level = jax.lax.rsqrt(x * x + z * z + np.float32(1e-6))
    x, y, z = jax.lax.optimization_barrier((x * level, y * level, z * level))
    hidden = jnp.zeros_like(x)
    for lamp_x, height, lamp_z in LAMPS_M:
        to_x, to_z = lamp_x - eye[0], lamp_z - eye[2]
        along = x * to_x + z * to_z
        beside = jnp.abs(x * to_z - z * to_x)
        meets_y = eye[1] + y * along
        per_m = np.float32(view.focal_px) / jnp.maximum(along, np.float32(0.5))
        # Products of clipped edges, no booleans: those XLA does not turn into vector code.
        cover = jnp.clip((np.float32(POST_M / 2) - beside) * per_m + np.float32(0.5), 0, 1)
        cover *= jnp.minimum(np.float32(POST_M) * per_m, 1) * jnp.clip(along - np.float32(0.5), 0, 1)
        cover *= jnp.clip(meets_y * per_m + np.float32(0.5), 0, 1)
        hidden = jnp.maximum(hidden, cover * jnp.clip((height - meets_y) * per_m + np.float32(0.5), 0, 1))
    hidden = jax.lax.optimization_barrier(hidden)
    return image * (1 - hidden) + np.float32(0.015) * hidden


def _cars(
    image: Float[Array, "3 y x"], axes: Array, eye: Array, oncoming_m: Array, ahead_m: Array, view: View
) -> Float[Array, "3 y x"]:
    """Two dark bodies: one comes, one drives ahead."""
    for x_m, z_m in ((-2.0, oncoming_m), (2.0, ahead_m)):
        for half_width, low, high in ((0.88, 0.25, 0.95), (0.68, 0.95, 1.45)):
            corner = jnp.stack([jnp.float32(x_m), jnp.float32((low + high) / 2), jnp.float32(z_m + 0.05)]) - eye
            x_px, y_px, depth = _project(corner, axes, view)
            y, x = _pixel_centres(view)
            scale = view.focal_px / jnp.maximum(depth, 0.5)
            cover = jnp.clip(half_width * scale - jnp.abs(x - x_px) + 0.5, 0, 1)
            cover = cover * jnp.clip((high - low) / 2 * scale - jnp.abs(y - y_px) + 0.5, 0, 1) * (depth > 0.5)
            image = image * (1 - cover) + 0.03 * cover
    return image


def _arrived(oncoming_m: Array) -> Array:
    """0 where a car appears, 1 from a second on: otherwise its lights would jump when the next one comes."""
    return jnp.clip((START_M - oncoming_m) / SPEED_M_S, 0, 1)


def _lights(oncoming_m: Array, ahead_m: Array, full_beam: Array) -> _Lights:
    places: list[Array] = [jnp.asarray(place) for place in LAMPS_M]
    radii = [LAMP_M] * len(places)
    colours = [jnp.asarray(rgb * LAMP_CD_M2) for rgb in LAMP_RGB]
    # A headlight shines forwards, so it goes out as it passes; it comes out of the haze in its first second.
    forwards = jnp.maximum(oncoming_m, 0) ** 2 / (oncoming_m**2 + np.float32(2.6**2))
    beam = jnp.where(full_beam, FULL_CD_M2, DIPPED_CD_M2) * forwards * _arrived(oncoming_m)
    for x_m, z_m, radius, colour in (
        (-2.65, oncoming_m, HEADLIGHT_M, jnp.asarray(XENON) * beam),
        (-1.35, oncoming_m, HEADLIGHT_M, jnp.asarray(XENON) * beam),
        (1.35, ahead_m, 0.08, jnp.asarray(RED) * 3e2),
        (2.65, ahead_m, 0.08, jnp.asarray(RED) * 3e2),
    ):
        places.append(jnp.stack([jnp.float32(x_m), jnp.float32(0.68), jnp.float32(z_m)]))
        radii.append(radius)
        colours.append(colour)
    for x_m, colour in ((-5.2, jnp.asarray(RED) * 6e3), (5.2, jnp.asarray(GREEN) * 6e3)):
        places.append(jnp.asarray([x_m, 3.1, 29.0], jnp.float32))
        radii.append(0.1)
        colours.append(colour)
    return _Lights(jnp.stack(places), jnp.asarray(radii, jnp.float32), jnp.stack(colours).astype(jnp.float32))


def _discs(image: Float[Array, "3 y x"], lights: _Lights, axes: Array, eye: Array, view: View) -> Float[Array, "3 y x"]:
    away = lights.at_m - eye
    x_px, y_px, depth = _project(away, axes, view)
    # Off the middle a pixel covers less of the field, so a light that faces the eye covers more pixels.
    stretch = jnp.sqrt(jnp.linalg.norm(away, axis=1) / jnp.maximum(depth, 0.2))
    radius_px = lights.radius_m * np.float32(view.focal_px) / jnp.maximum(depth, 0.2) * stretch
    colour = lights.rgb_cd_m2 * (depth > 0.5)[:, None]
    half = int(0.05 * view.focal_px) + 4
    return add_discs(image, x_px, y_px, jnp.minimum(radius_px, half - 3), colour, half)


def _sky_lights(image: Float[Array, "3 y x"], axes: Array, eye: Array, view: View) -> Float[Array, "3 y x"]:
    """Stars and moon, where no roof hides them."""
    places = jnp.concatenate([jnp.asarray(STARS), jnp.asarray(MOON)[None]])
    x_px, y_px, depth = _project(places, axes, view)
    side = jnp.sign(places[:, 0])
    to_wall = (PAVEMENT_M - side * eye[0]) / jnp.maximum(jnp.abs(places[:, 0]), 1e-5)
    wall_y, wall_z = eye[1] + to_wall * places[:, 1], eye[2] + to_wall * places[:, 2]
    roof = 9.0 + 7.0 * _hash(jnp.floor(wall_z / BUILDING_M).astype(jnp.int32), (side > 0).astype(jnp.int32), 1)
    seen = (depth > 0.2) & ((wall_y > roof) | (to_wall >= 400))
    # A pixel's solid angle falls with the cube of the cosine of its angle from the middle.
    pixels_per_sr = np.float32(view.focal_px**2) / jnp.maximum(depth, 0.2) ** 3
    star = jnp.asarray(STARS_LUX) * pixels_per_sr[:-1]
    small = np.float32(0.2)
    image = add_discs(
        image,
        x_px[:-1],
        y_px[:-1],
        jnp.full(len(STARS), small),
        (star / (np.float32(np.pi) * small**2) * seen[:-1])[:, None] * jnp.ones(3, jnp.float32),
        4,
    )
    moon_px = np.float32(np.radians(MOON_DEG)) * jnp.sqrt(pixels_per_sr[-1:])
    half = int(np.radians(MOON_DEG) * view.focal_px * 5) + 4
    moon = jnp.asarray([1.05, 1.0, 0.88], jnp.float32) * MOON_CD_M2
    return add_discs(image, x_px[-1:], y_px[-1:], jnp.minimum(moon_px, half - 3), moon[None] * seen[-1], half)
