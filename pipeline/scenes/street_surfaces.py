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
from jaxtyping import Array, Float

from entoptic.pipeline.frame import View
from entoptic.pipeline.scenes.street_facades import (
    far_window_light,
    gable_share,
    panes,
    wall_share,
    window_key,
    window_light,
)
from entoptic.pipeline.scenes.street_patterns import reciprocal, stripe, stripes, uniform
from entoptic.pipeline.scenes.street_plan import (
    ASPHALT,
    BEAM_CD,
    BEYOND_LUX,
    DARK_CD_M2,
    GABLE_CD_M2,
    GLASS,
    KERB,
    LAMP_DOWN_CD,
    LAMPS_END_M,
    LAMPS_M,
    LED,
    MOON_LUX,
    PAINT,
    PAVING,
    ROAD_M,
    SKY,
    SODIUM,
    WALL,
    WARM,
    XENON,
    arrived,
)
from entoptic.pipeline.scenes.street_rays import Seen, footprint_m, seen_from


def surfaces(
    axes: Float[np.ndarray, "3 3"],
    eye: Float[np.ndarray, "3"],
    oncoming_m: np.float32,
    hidden: Float[Array, "y x"] | np.float32,
    view: View,
) -> Float[Array, "3 y x"]:
    """Sky, ground and facades, without lights of their own size; `hidden` is what dark things cover of each pixel.

    All light is that of few spectra, so a pixel is a few numbers until the last pass makes colours of them. Each is
    computed by a function of its own: XLA makes fast code of one result, computing what several need again for each,
    and slow code of several.
    """
    along_m = _along_m(axes, eye, view)
    walls, gables = wall_share(axes, eye, along_m, view), gable_share(axes, eye, along_m, view)
    reflected = _reflected(axes, eye, along_m, walls, view)
    windows = window_light(axes, eye, along_m, walls, view)
    spectra = (
        _sodium(axes, eye, along_m, reflected, view),
        _led(axes, eye, along_m, reflected, windows, walls, view),
        headlights(axes, eye, oncoming_m, reflected, view),
        _warm(axes, eye, along_m, windows, walls, view),
        _sky(axes, eye, walls, gables, view),
    )
    return _coloured(spectra, reflected, gables, hidden)


@jax.jit
def _coloured(
    spectra: tuple[Float[Array, "y x"], ...],
    reflected: Float[Array, "y x"],
    gables: Float[Array, "y x"],
    hidden: Float[Array, "y x"],
) -> Float[Array, "3 y x"]:
    def channel(c: int) -> Array:
        light = reflected * np.float32(0.4 * MOON_LUX) + gables * GABLE_CD_M2
        for colour, amount in zip((SODIUM, LED, XENON, WARM, SKY), spectra, strict=True):
            light = light + np.float32(colour[c]) * amount
        return light + hidden * (np.float32(DARK_CD_M2) - light)

    return jnp.stack([channel(c) for c in range(3)])


@functools.partial(jax.jit, static_argnames="view")
def _along_m(axes: Float[Array, "3 3"], eye: Float[Array, "3"], view: View) -> Float[Array, "y x"]:
    seen = seen_from(axes, eye, view)
    return footprint_m(seen.direction, axes, seen.depth, seen.on_ground, view)[1]


@functools.partial(jax.jit, static_argnames="view")
def _reflected(
    axes: Float[Array, "3 3"],
    eye: Float[Array, "3"],
    along_m: Float[Array, "y x"],
    walls: Float[Array, "y x"],
    view: View,
) -> Float[Array, "y x"]:
    """Luminance per lux on ground and facades."""
    seen = seen_from(axes, eye, view)
    across_m, _ = footprint_m(seen.direction, axes, seen.depth, seen.on_ground, view)
    pane, share, resolved = panes(seen, across_m, along_m)
    glass = share + (pane - share) * resolved
    albedo = jnp.where(
        seen.on_ground, _ground_albedo(seen.place, across_m, along_m), walls * (WALL + (GLASS - WALL) * glass)
    )
    return albedo * np.float32(1 / np.pi)


@functools.partial(jax.jit, static_argnames="view")
def _sodium(
    axes: Float[Array, "3 3"], eye: Array, along_m: Array, reflected: Float[Array, "y x"], view: View
) -> Float[Array, "y x"]:
    seen = seen_from(axes, eye, view)
    return lamps_lux(seen, along_m, 0) * reflected


@functools.partial(jax.jit, static_argnames="view")
def _led(
    axes: Float[Array, "3 3"],
    eye: Array,
    along_m: Array,
    reflected: Float[Array, "y x"],
    windows: Float[Array, "y x"],
    walls: Float[Array, "y x"],
    view: View,
) -> Float[Array, "y x"]:
    seen = seen_from(axes, eye, view)
    cold = windows * (1 - uniform(*window_key(seen), 5))
    return lamps_lux(seen, along_m, 1) * reflected + cold + walls * far_window_light(along_m)


@functools.partial(jax.jit, static_argnames="view")
def _warm(
    axes: Float[Array, "3 3"], eye: Array, along_m: Array, windows: Array, walls: Array, view: View
) -> Float[Array, "y x"]:
    seen = seen_from(axes, eye, view)
    return windows * uniform(*window_key(seen), 5) + walls * far_window_light(along_m)


@functools.partial(jax.jit, static_argnames="view")
def headlights(
    axes: Float[Array, "3 3"], eye: Array, oncoming_m: Array, reflected: Float[Array, "y x"], view: View
) -> Float[Array, "y x"]:
    """Of headlights."""
    seen = seen_from(axes, eye, view)
    x, y, z = seen.place
    dx, dy, dz = np.float32(-2.0) - x, np.float32(0.65) - y, oncoming_m - z
    inverse = jax.lax.rsqrt(dx * dx + dy * dy + dz * dz + np.float32(0.1))
    ahead = jnp.maximum(dz, np.float32(0.1))
    away = (dx * dx + (dy - np.float32(0.03) * dz) ** 2) * reciprocal(ahead * ahead)
    beam = np.float32(BEAM_CD) * jnp.exp(-away * np.float32(1 / 0.22**2)) * (dz > 0) * arrived(oncoming_m)
    return beam * facing(seen, dx, dy) * inverse * inverse * inverse * reflected


@functools.partial(jax.jit, static_argnames="view")
def _sky(
    axes: Float[Array, "3 3"], eye: Array, walls: Float[Array, "y x"], gables: Float[Array, "y x"], view: View
) -> Float[Array, "y x"]:
    """Moonlit sky: 0.003 cd/m² overhead, ten times that in the town's haze."""
    seen = seen_from(axes, eye, view)
    x, y, z = seen.direction
    up = y * jax.lax.rsqrt(x * x + y * y + z * z)
    haze = 0.003 + 0.03 * jnp.exp(-jnp.clip(up, 0, 1) * np.float32(1 / 0.13))
    return jnp.where(seen.on_ground, 0, haze * (1 - walls - gables))


def lamps_lux(seen: Seen, along_m: Float[Array, "y x"], first: int) -> Float[Array, "y x"]:
    """Lux of every second lamp from the `first` on, over `along_m` of the street, and of those after the last."""
    # Component by component: as 3-vectors, XLA makes ten times as many passes over memory.
    x, y, z = seen.place
    lux = jnp.zeros_like(x)
    # h/(h² + z²)^1.5, the light of a lamp along the street, is half its peak over 1.53 h. A longer footprint widens it
    # by as much, and the factor in front keeps its integral.
    widening = along_m * along_m * np.float32(1 / 1.53**2)
    for lamp_x, lamp_y, lamp_z in LAMPS_M[first::2]:
        dx, dy, dz = lamp_x - x, lamp_y - y, lamp_z - z
        beside = dx * dx + dy * dy + np.float32(0.05)
        inverse = jax.lax.rsqrt(beside + widening + dz * dz)
        # A luminaire shines down and sideways, little upwards.
        down = jnp.clip(np.float32(0.25) + dy * inverse, 0, 1)
        widened = 1 + widening * reciprocal(beside)
        light = np.float32(LAMP_DOWN_CD) * facing(seen, dx, dy) * down * widened
        lux += light * inverse * inverse * inverse
    beyond = jnp.clip((jnp.abs(z - LAMPS_M[:, 2].mean()) - np.float32(LAMPS_END_M)) * np.float32(0.1), 0, 1)
    return lux + np.float32(BEYOND_LUX / 2) * beyond * jnp.clip(np.float32(1.8) - y * np.float32(0.2), 0, 1)


def facing(seen: Seen, dx: Array, dy: Array) -> Array:
    """How far a light is over the surface."""
    return jnp.maximum(jnp.where(seen.on_ground, dy, -jnp.sign(seen.direction[0]) * dx), 0)


def _ground_albedo(
    place: tuple[Array, Array, Array], across: Float[Array, "y x"], along: Float[Array, "y x"]
) -> Float[Array, "y x"]:
    x, _, z = place
    road = stripe(x, 0.0, 2 * ROAD_M, across)
    albedo = PAVING + (ASPHALT - PAVING) * road
    paint = stripe(x, 0.0, 0.15, across) * stripes(z, 8.0, 0.5, 3.0, along)
    paint += stripe(jnp.abs(x), ROAD_M - 0.35, 0.12, across)
    # A crossing before the signals.
    paint = jnp.maximum(paint, stripe(z, 26.0, 3.0, along) * road * stripes(x, 1.0, 0.25, 0.5, across))
    kerb = stripe(jnp.abs(x), ROAD_M + 0.1, 0.2, across)
    return albedo * (1 - paint - kerb) + PAINT * paint + KERB * kerb
