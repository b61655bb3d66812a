"""Colours beyond the display's go to white along a path of one hue.

A colour loses chroma at Oklab's hue and one luminance until the display has it: chroma clipping at constant hue and CIE
lightness (CIE 156:2004, Morovič 2008), with the hue of Ottosson 2020. Before, it is dimmed: as in Ottosson's clipping
"with adaptive L0" (2021) lightness is traded for chroma, and here the less the nearer its luminance is to white's. So a
lamp's glow turns white where a curve of luminance is at the peak, and a saturated one keeps its colour for longer.
Colours with a component below 0, spectral ones of glare, are brought back to the display's edge in the same way.

Few pixels of most frames are beyond the display, and the others cost nothing: see `Pointwise.exact`.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from entoptic.pipeline.effects.pointwise import weighted
from entoptic.pipeline.effects.tone.hue import TRADED
from entoptic.pipeline.effects.tone.oklab import HUES, LUMINANCES, TO_A, TO_B, TO_LMS, turn
from entoptic.pipeline.fast_math import clip, cube_root, larger, smaller
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS

CLIPPED = 0.01
"""What lies so far beyond the display, of its distance from grey, is clipped: less than a code value."""
MAPPED = 0.06
"""What lies so far beyond it, or farther, is mapped in full; between the two the one passes into the other."""

_TINY = np.float32(1e-30)
_ROOM = np.float32(1e-7)


def is_beyond(
    planes: Sequence[Float[Array, "n y x"]],
    y: Float[Array, "n y x"],
    gain: Float[Array, "n #y #x"],
    offset: Float[Array, "n 1 1"],
) -> Bool[Array, "n y x"]:
    """Where planes·gain + offset, of luminance y·gain + offset, are to be mapped."""
    largest = larger(larger(planes[0], planes[1]), planes[2]) * gain + offset
    least = smaller(smaller(planes[0], planes[1]), planes[2]) * gain + offset
    luminance = smaller(y * gain + offset, 1)
    edge = np.float32(1 + CLIPPED)
    beyond = (largest - luminance > edge * (1 - luminance)) | (luminance - least > edge * luminance)
    # White is clipped to white.
    return beyond & ((luminance < 1) | (least < 1))


def to_white(
    planes: list[Float[Array, "block y x"]], red: Float[Array, "cell"], blue: Float[Array, "cell"]
) -> list[Float[Array, "block y x"]]:
    """Colours beyond the display, linear Rec.709 and 1 = its peak, on the display's edge at their hue.

    What has no luminance becomes black. `red` and `blue` are the tables of `oklab.directions`. The barriers keep XLA
    from working out each step again for each of three channels.
    """
    y = larger(weighted(planes, LUMINANCE_WEIGHTS), _TINY)
    y, per_y = _apart(y, 1 / y)
    whole = smaller(y, 1)
    # Hue does not depend on luminance, and this keeps cube roots within float32.
    ratios = [clip(plane * per_y, -100, 100) for plane in planes]
    by_peak, by_black = _apart(*_beyond_edge([(ratio - 1) * whole for ratio in ratios], whole))
    brightest = larger(larger(ratios[0], ratios[1]), ratios[2]) * y
    dims = jnp.exp(jnp.log(larger(brightest, 1)) * (np.float32(-TRADED) * (1 - whole)))
    (luminance,) = _apart(whole * dims)
    roots = _apart(*(_signed_root(weighted(ratios, row)) for row in TO_LMS))
    hue = turn(weighted(roots, TO_A), weighted(roots, TO_B)) * np.float32(HUES / 4)
    hue, level = _apart(clip(hue, 0, HUES - np.float32(1e-3)), luminance * np.float32(LUMINANCES))
    level = smaller(level, LUMINANCES - np.float32(1e-4))
    i, k = hue.astype(jnp.int32), level.astype(jnp.int32)
    cell, across, along = _apart(i * (LUMINANCES + 1) + k, hue - i, level - k)
    up, sideways = _apart(_between(red, cell, across, along), _between(blue, cell, across, along))
    r, g, b = LUMINANCE_WEIGHTS
    direction = [up, up * np.float32(-r / g) + sideways * np.float32(-b / g), sideways]
    # Near blue a path of one hue leaves the display's triangle of chromaticities for a while. What lies in the triangle
    # and is too bright is clipped there: it would lose the peak of its blue, and is off by 0.2° instead.
    fills = clip((by_peak - 1) * 20, 0, 1) * clip(1 - (by_black - 1) * 20, 0, 1)
    way_to_peak, way_to_black = _beyond_edge(direction, luminance)
    ends = 1 / larger(way_to_peak, (1 - fills) * way_to_black)
    share = (larger(by_peak, by_black) - np.float32(1 + CLIPPED)) * np.float32(1 / (MAPPED - CLIPPED))
    share, ends = _apart(clip(share, 0, 1), ends)
    mapped = [clip(luminance + step * ends, 0, 1) for step in direction]
    return [
        clipped + share * (one - clipped)
        for one, clipped in zip(mapped, (clip(plane, 0, 1) for plane in planes), strict=True)
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
    most = larger(larger(step[0], step[1]), step[2])
    least = smaller(smaller(step[0], step[1]), step[2])
    return most / larger(1 - luminance, _ROOM), -least / luminance
