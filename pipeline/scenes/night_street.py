"""The embedded scene: a street at night in real luminances, computed, nothing to download.

The street runs along +z; metres, x to the right, y up, the person's eyes 1.5 m above the road. Sky, ground and facades
come first, then what stands before them, then lights as discs that keep their flux however small they are.
Luminances and intensities are typical ones (CIE 115, ECE R112, the moon's own); the layout is an engineering choice.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from entoptic.pipeline.effects.effect import Cost
from entoptic.pipeline.frame import Frame, View
from entoptic.pipeline.scenes.discs import add_discs
from entoptic.pipeline.scenes.scene import Head, count_eyes, headset_view, rays, rotation
from entoptic.pipeline.scenes.street_facades import sky_share
from entoptic.pipeline.scenes.street_patterns import reciprocal
from entoptic.pipeline.scenes.street_plan import EYE_HEIGHT_M, LAMP_RGB, LAMPS_M, SPEED_M_S, START_M, XENON, arrived
from entoptic.pipeline.scenes.street_surfaces import surfaces
from entoptic.tracker_bridge.wire import Eye

PUPIL_DISTANCE_M = 0.063
RED, GREEN = (4.7021, 0.0, 0.0), (0.0160, 1.3701, 0.2326)
"""Linear Rec.709 at luminance 1: the signals' chromaticities (KRI)."""

LAMP_M, LAMP_CD_M2 = 0.1, 1.2e4
"""400 cd along the street."""
HEADLIGHT_M, DIPPED_CD_M2, FULL_CD_M2 = 0.09, 4e4, 6e5
"""Dipped, 1000 cd each towards an oncoming driver; full beam 1.5e4 cd."""
POST_M = 0.16
"""Lamp posts' width."""
FLASH_S = (4.0, 4.6)
"""When in each approach the full beam is on."""
MOON_CD_M2, MOON_DEG = 2500.0, 0.26
PERIOD_S = 8.0
"""A car comes every eight seconds."""
AHEAD_M, AHEAD_SPEED_M_S = 14.0, 2.2
"""Another draws away in one's own lane, and is there again after two periods."""
SIGNALS_X_M, SIGNALS_Z_M, SIGNALS_HEIGHT_M, SIGNALS_CD_M2 = 5.2, 29.0, 3.1, 6e3
"""A red one on the left, a green one on the right, 190 cd each."""
LARGEST_PX = 400
"""Half the window in which a light is drawn, at most: its arithmetic grows with the square. Only views of a few degrees
have larger discs, and cut them to this."""


class _Lights(NamedTuple):
    """Discs of light."""

    at_m: Float[Array, "light 3"]
    radius_m: Float[Array, " light"]
    rgb_cd_m2: Float[Array, "light 3"]


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

    cost = Cost(0.5, 24.0)

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
        return Frame(images[0] if len(images) == 1 else jnp.concatenate(images), view)


def _street(t_s: float, axes: np.ndarray, eye: np.ndarray, view: View) -> Float[Array, "1 3 y x"]:
    within_s = np.float32(t_s % PERIOD_S)
    oncoming_m = np.float32(START_M - SPEED_M_S * within_s)
    ahead_m = np.float32(AHEAD_M + AHEAD_SPEED_M_S * (t_s % (2 * PERIOD_S)))
    full_beam = np.bool_(FLASH_S[0] <= within_s < FLASH_S[1])
    hidden = _silhouettes(axes, eye, oncoming_m, ahead_m, view)
    image = surfaces(axes, eye, oncoming_m, hidden, view)
    return _lit(image, axes, eye, oncoming_m, ahead_m, full_beam, view)


@functools.partial(jax.jit, static_argnames="view", donate_argnames="image")
def _lit(
    image: Float[Array, "3 y x"],
    axes: Float[Array, "3 3"],
    eye: Float[Array, "3"],
    oncoming_m: Float[Array, ""],
    ahead_m: Float[Array, ""],
    full_beam: Array,
    view: View,
) -> Float[Array, "1 3 y x"]:
    image = _sky_lights(image, axes, eye, view)
    return _discs(image, _lights(oncoming_m, ahead_m, full_beam), axes, eye, view)[None]


def _project(at: Float[Array, "*n 3"], axes: Float[Array, "3 3"], view: View) -> tuple[Array, Array, Array]:
    """x, y in pixels and depth of vectors from the eye."""
    right, up, depth = (at @ axes[:, k] for k in range(3))
    safe = jnp.where(depth > 0.2, depth, 1.0)
    x_px = view.width_px / 2 + view.focal_px * right / safe
    y_px = view.height_px / 2 - view.focal_px * up / safe
    return x_px.astype(jnp.float32), y_px.astype(jnp.float32), depth


@functools.partial(jax.jit, static_argnames="view")
def _silhouettes(
    axes: Float[Array, "3 3"], eye: Array, oncoming_m: Array, ahead_m: Array, view: View
) -> Float[Array, "y x"]:
    """What the dark things that stand in the street cover of each pixel."""
    direction = rays(view, axes)
    return jnp.maximum(_posts(direction, axes, eye, view), _boxes(direction, axes, eye, oncoming_m, ahead_m, view))


def _posts(direction: Float[Array, "3 y x"], axes: Float[Array, "3 3"], eye: Array, view: View) -> Float[Array, "y x"]:
    """Lamp posts."""
    x, y, z = direction
    level = jax.lax.rsqrt(x * x + z * z + np.float32(1e-6))
    x, y, z, spread = x * level, y * level, z * level, np.float32(view.focal_px) / level
    hidden = jnp.zeros_like(x)
    for lamp_x, height, lamp_z in LAMPS_M:
        to_x, to_z = lamp_x - eye[0], lamp_z - eye[2]
        along = x * to_x + z * to_z
        beside = jnp.abs(x * to_z - z * to_x)
        meets_y = eye[1] + y * along
        # A post is a straight line in the picture; how many pixels a metre beside it measures, off the middle too,
        # follows from how the plane of post and eye lies to the picture's.
        off_axis = to_z * axes[0, 2] - to_x * axes[2, 2]
        across = jax.lax.rsqrt(jnp.maximum(to_x * to_x + to_z * to_z - off_axis * off_axis, np.float32(0.01)))
        # Products of clipped edges, no booleans: those XLA does not turn into vector code.
        cover = _covered(beside, np.float32(POST_M / 2), spread * across) * jnp.clip(along - np.float32(0.5), 0, 1)
        per_m = spread * reciprocal(jnp.maximum(along, np.float32(0.5)))
        cover *= jnp.clip(meets_y * per_m + np.float32(0.5), 0, 1)
        hidden = jnp.maximum(hidden, cover * jnp.clip((height - meets_y) * per_m + np.float32(0.5), 0, 1))
    return hidden


def _covered(off_m: Array, half_m: np.float32, per_m: Array) -> Array:
    """Share of a pixel that a bar covers, whose middle is so far off; it may be thinner than the pixel."""
    return jnp.clip((half_m - jnp.abs(off_m)) * per_m + np.float32(0.5), 0, jnp.minimum(2 * half_m * per_m, 1))


def _boxes(
    direction: Float[Array, "3 y x"],
    axes: Float[Array, "3 3"],
    eye: Array,
    oncoming_m: Array,
    ahead_m: Array,
    view: View,
) -> Float[Array, "y x"]:
    """Signals on their posts, and two cars: one comes, one drives ahead."""
    x, y, z = direction
    nearness = jnp.maximum(z, np.float32(1e-4))
    inverse = reciprocal(nearness)
    x, y = x * inverse, y * inverse
    # Pixels per metre across and upwards, on a plane a metre ahead that need not face the eye.
    wide, tall = (
        np.float32(view.focal_px)
        * nearness
        * jax.lax.rsqrt((axes[k, 0] - at * axes[2, 0]) ** 2 + (axes[k, 1] - at * axes[2, 1]) ** 2)
        for k, at in ((0, x), (1, y))
    )
    signal = ((0.05, 0.0, 2.6), (0.35, 2.55, 3.6))
    car = ((0.88, 0.25, 0.95), (0.68, 0.9, 1.45))
    hidden = jnp.zeros_like(x)
    for x_m, z_m, parts in ((-2.0, oncoming_m, car), (2.0, ahead_m, car), (SIGNALS_X_M, SIGNALS_Z_M, signal)):
        depth = jnp.maximum(z_m + np.float32(0.05) - eye[2], np.float32(0.1)).astype(jnp.float32)
        nearer = 1 / depth
        at_x, at_y = eye[0] + depth * x, eye[1] + depth * y
        off = (jnp.abs(at_x) if parts is signal else at_x) - np.float32(x_m)
        for half_m, low_m, high_m in parts:
            middle, half_height = np.float32((low_m + high_m) / 2), np.float32((high_m - low_m) / 2)
            cover = _covered(off, np.float32(half_m), wide * nearer)
            cover *= _covered(at_y - middle, half_height, tall * nearer)
            hidden = jnp.maximum(hidden, cover * (depth > 0.5))
    return hidden * (z > np.float32(1e-3))


def _lights(oncoming_m: Array, ahead_m: Array, full_beam: Array) -> _Lights:
    places: list[Array] = [jnp.asarray(place) for place in LAMPS_M]
    radii = [LAMP_M] * len(places)
    colours = [jnp.asarray(rgb * LAMP_CD_M2) for rgb in LAMP_RGB]
    # A headlight shines forwards, so it goes out as it passes; it comes out of the haze in its first second.
    forwards = jnp.maximum(oncoming_m, 0) ** 2 / (oncoming_m**2 + np.float32(2.6**2))
    beam = jnp.where(full_beam, FULL_CD_M2, DIPPED_CD_M2) * forwards * arrived(oncoming_m)
    for x_m, z_m, radius, colour in (
        (-2.65, oncoming_m, HEADLIGHT_M, jnp.asarray(XENON) * beam),
        (-1.35, oncoming_m, HEADLIGHT_M, jnp.asarray(XENON) * beam),
        (1.35, ahead_m, 0.08, jnp.asarray(RED) * 3e2),
        (2.65, ahead_m, 0.08, jnp.asarray(RED) * 3e2),
    ):
        places.append(jnp.stack([jnp.float32(x_m), jnp.float32(0.68), jnp.float32(z_m)]))
        radii.append(radius)
        colours.append(colour)
    for x_m, rgb in ((-SIGNALS_X_M, RED), (SIGNALS_X_M, GREEN)):
        colour = jnp.asarray(rgb) * SIGNALS_CD_M2
        places.append(jnp.asarray([x_m, SIGNALS_HEIGHT_M, SIGNALS_Z_M], jnp.float32))
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
    half = min(int(0.05 * view.focal_px) + 4, LARGEST_PX)
    return add_discs(image, x_px, y_px, jnp.minimum(radius_px, half - 3), colour, half)


def _sky_lights(image: Float[Array, "3 y x"], axes: Array, eye: Array, view: View) -> Float[Array, "3 y x"]:
    """Stars and moon, where no building hides them."""
    places = jnp.concatenate([jnp.asarray(STARS), jnp.asarray(MOON)[None]])
    x_px, y_px, depth = _project(places, axes, view)
    seen = sky_share(places.T, axes, eye, view) * (depth > 0.2)
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
