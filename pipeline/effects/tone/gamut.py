"""Colours beyond the display's go to white along a path of one hue.

A colour loses chroma at Oklab's hue and one luminance until the display has it: chroma clipping at constant hue and CIE
lightness (CIE 156:2004, Morovič 2008), with the hue of Ottosson 2020. Before, it is dimmed: as in Ottosson's clipping
"with adaptive L0" (2021) lightness is traded for chroma, and here the less the nearer its luminance is to white's. So a
lamp's glow turns white where a curve of luminance is at the peak, and a saturated one keeps its colour for longer.
Colours with a component below 0, spectral ones of glare, are brought back to the display's edge in the same way.

Few pixels of most frames are beyond the display, and the others cost nothing: blocks that hold any are cut out, mapped,
and put back.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.typing import NDArray

from entoptic.pipeline.effects.tone.hue import TRADED, weighted
from entoptic.pipeline.effects.tone.oklab import HUES, LUMINANCES, TO_A, TO_B, TO_LMS, directions, turn
from entoptic.pipeline.fast_math import cube_root
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS

BLOCK_PX = 32
"""Side of a block. Engineering choice: half as large, twice as many hold a pixel beyond the display."""
AT_ONCE = 32
"""Blocks. Engineering choice: enough for two cores, few enough that the last, filled up, wastes little."""
CLIPPED = 0.01
"""What lies so far beyond the display, of its distance from grey, is clipped: less than a code value."""
MAPPED = 0.06
"""What lies so far beyond it, or farther, is mapped in full; between the two the one passes into the other."""

_TINY = np.float32(1e-30)
_ROOM = np.float32(1e-7)


def marked_gain(
    planes: list[Float[Array, "eye y x"]],
    y: Float[Array, "eye y x"],
    gain: Float[Array, "eye #y #x"],
    offset: Float[Array, "eye 1 1"],
) -> Float[Array, "eye y x"]:
    """The gain of each pixel, negative where planes·gain + offset, of luminance y·gain + offset, are to be mapped.

    One array says both: a second one of a frame's size costs more than all that is computed here.
    """
    largest = jnp.maximum(jnp.maximum(planes[0], planes[1]), planes[2]) * gain + offset
    least = jnp.minimum(jnp.minimum(planes[0], planes[1]), planes[2]) * gain + offset
    luminance = jnp.minimum(y * gain + offset, 1)
    edge = np.float32(1 + CLIPPED)
    beyond = (largest - luminance > edge * (1 - luminance)) | (luminance - least > edge * luminance)
    # White is clipped to white.
    return jnp.where(beyond & ((luminance < 1) | (least < 1)), -gain, gain)


def marked_blocks(gain: Float[Array, "eye y x"]) -> Bool[Array, "eye row column"]:
    """Blocks in which a gain is negative."""
    height, width = gain.shape[1:]
    below, right = -height % BLOCK_PX, -width % BLOCK_PX
    # Rows first: whole rows are compared at once.
    size = (1, BLOCK_PX, 1)
    least = jax.lax.reduce_window(gain, np.float32(np.inf), jax.lax.min, size, size, ((0, 0), (0, below), (0, 0)))
    (least,) = _apart(least)
    least = jnp.pad(least, ((0, 0), (0, 0), (0, right)))
    return least.reshape(*least.shape[:2], -1, BLOCK_PX).min(-1) < 0


def map_blocks(
    clipped: Float[Array, "eye 3 y x"],
    rgb: Float[Array, "eye 3 y x"],
    gain: Float[Array, "eye y x"],
    offset: Float[Array, "eye 1 1"],
    blocks: NDArray[np.bool_],
) -> Float[Array, "eye 3 y x"]:
    """`clipped`, whose memory is taken, with what is marked in these blocks mapped: rgb·|gain| + offset."""
    found = np.argwhere(blocks)
    if not len(found):
        return clipped
    sides = min(BLOCK_PX, rgb.shape[2]), min(BLOCK_PX, rgb.shape[3])
    last = (rgb.shape[0], rgb.shape[2] - sides[0], rgb.shape[3] - sides[1])
    places = np.minimum(found * (1, BLOCK_PX, BLOCK_PX), last).astype(np.int32)
    for start in range(0, len(places), AT_ONCE):
        # The last of them again and again, where they do not fill up: it is the same each time.
        some = places[np.minimum(np.arange(start, start + AT_ONCE), len(places) - 1)]
        clipped = _put(clipped, _mapped_blocks(rgb, gain, offset, some, sides, *_tables()), some)
    return clipped


@functools.cache
def _tables() -> tuple[Array, Array]:
    red, blue = directions()
    return jnp.asarray(red), jnp.asarray(blue)


@functools.partial(jax.jit, static_argnames="sides")
def _mapped_blocks(
    rgb: Float[Array, "eye 3 y x"],
    gain: Float[Array, "eye y x"],
    offset: Float[Array, "eye 1 1"],
    places: Int[Array, "block 3"],
    sides: tuple[int, int],
    red: Float[Array, "cell"],
    blue: Float[Array, "cell"],
) -> tuple[Float[Array, "block p q"], ...]:
    zero = jnp.int32(0)

    def cut(place: Int[Array, "3"]) -> tuple[Float[Array, "3 p q"], Float[Array, "p q"]]:
        eye, top, left = place[0], place[1], place[2]
        scene = jax.lax.dynamic_slice(rgb, (eye, zero, top, left), (1, 3, *sides))[0]
        factor = jax.lax.dynamic_slice(gain, (eye, top, left), (1, *sides))[0]
        return scene * jnp.abs(factor) + offset[eye], factor

    shown, factor = jax.lax.map(cut, places)
    mapped = to_white([shown[:, k] for k in range(3)], red, blue)
    return tuple(jnp.where(factor < 0, one, jnp.clip(shown[:, k], 0, 1)) for k, one in enumerate(mapped))


@functools.partial(jax.jit, donate_argnums=0)
def _put(
    image: Float[Array, "eye 3 y x"], blocks: tuple[Float[Array, "block p q"], ...], places: Int[Array, "block 3"]
) -> Float[Array, "eye 3 y x"]:
    def one(k: int, image: Float[Array, "eye 3 y x"]) -> Float[Array, "eye 3 y x"]:
        block = jnp.stack([channel[k] for channel in blocks])[None]
        return jax.lax.dynamic_update_slice(image, block, (places[k, 0], jnp.int32(0), places[k, 1], places[k, 2]))

    return jax.lax.fori_loop(0, places.shape[0], one, image)


def to_white(
    planes: list[Float[Array, "block y x"]], red: Float[Array, "cell"], blue: Float[Array, "cell"]
) -> list[Float[Array, "block y x"]]:
    """Colours beyond the display, linear Rec.709 and 1 = its peak, on the display's edge at their hue.

    What has no luminance becomes black. `red` and `blue` are the tables of `oklab.directions`. The barriers keep XLA
    from working out each step again for each of three channels.
    """
    y = jnp.maximum(weighted(planes, LUMINANCE_WEIGHTS), _TINY)
    y, per_y = _apart(y, 1 / y)
    whole = jnp.minimum(y, 1)
    # Hue does not depend on luminance, and this keeps cube roots within float32.
    ratios = [jnp.clip(plane * per_y, -100, 100) for plane in planes]
    by_peak, by_black = _apart(*_beyond_edge([(ratio - 1) * whole for ratio in ratios], whole))
    brightest = jnp.maximum(jnp.maximum(ratios[0], ratios[1]), ratios[2]) * y
    dims = jnp.exp(jnp.log(jnp.maximum(brightest, 1)) * (np.float32(-TRADED) * (1 - whole)))
    (luminance,) = _apart(whole * dims)
    roots = _apart(*(_signed_root(weighted(ratios, row)) for row in TO_LMS))
    hue = turn(weighted(roots, TO_A), weighted(roots, TO_B)) * np.float32(HUES / 4)
    hue, level = _apart(jnp.clip(hue, 0, HUES - np.float32(1e-3)), luminance * np.float32(LUMINANCES))
    level = jnp.minimum(level, LUMINANCES - np.float32(1e-4))
    i, k = hue.astype(jnp.int32), level.astype(jnp.int32)
    cell, across, along = _apart(i * (LUMINANCES + 1) + k, hue - i, level - k)
    up, sideways = _apart(_between(red, cell, across, along), _between(blue, cell, across, along))
    r, g, b = LUMINANCE_WEIGHTS
    direction = [up, up * np.float32(-r / g) + sideways * np.float32(-b / g), sideways]
    # Near blue a path of one hue leaves the display's triangle of chromaticities for a while. What lies in the triangle
    # and is too bright is clipped there: it would lose the peak of its blue, and is off by 0.2° instead.
    fills = jnp.clip((by_peak - 1) * 20, 0, 1) * jnp.clip(1 - (by_black - 1) * 20, 0, 1)
    way_to_peak, way_to_black = _beyond_edge(direction, luminance)
    ends = 1 / jnp.maximum(way_to_peak, (1 - fills) * way_to_black)
    share = (jnp.maximum(by_peak, by_black) - np.float32(1 + CLIPPED)) * np.float32(1 / (MAPPED - CLIPPED))
    share, ends = _apart(jnp.clip(share, 0, 1), ends)
    mapped = [jnp.clip(luminance + step * ends, 0, 1) for step in direction]
    return [
        clipped + share * (one - clipped)
        for one, clipped in zip(mapped, (jnp.clip(plane, 0, 1) for plane in planes), strict=True)
    ]


def _apart(*arrays: Array) -> tuple[Array, ...]:
    """The same, worked out by themselves and kept."""
    kept: tuple[Array, ...] = jax.lax.optimization_barrier(arrays)
    return kept


def _signed_root(x: Float[Array, "block y x"]) -> Float[Array, "block y x"]:
    return jnp.sign(x) * cube_root(jnp.abs(x) + np.float32(1e-12))


def _between(
    table: Float[Array, "cell"],
    cell: Int[Array, "block y x"],
    across: Float[Array, "block y x"],
    along: Float[Array, "block y x"],
) -> Float[Array, "block y x"]:
    """Of a table hue by hue: linear between four entries."""
    row = LUMINANCES + 1
    corners = [table.at[cell + step].get(mode="promise_in_bounds") for step in (0, 1, row, row + 1)]
    # Apart from the look-ups, which are no vector code.
    one, other, next_one, next_other = _apart(*corners)
    low, high = one + (other - one) * along, next_one + (next_other - next_one) * along
    return low + (high - low) * across


def _beyond_edge(
    step: list[Float[Array, "block y x"]], luminance: Float[Array, "block y x"]
) -> tuple[Float[Array, "block y x"], Float[Array, "block y x"]]:
    """How many times as long as the way to the peak, and to black, a step away from the grey of this luminance is."""
    most = jnp.maximum(jnp.maximum(step[0], step[1]), step[2])
    least = jnp.minimum(jnp.minimum(step[0], step[1]), step[2])
    return most / jnp.maximum(1 - luminance, _ROOM), -least / luminance
