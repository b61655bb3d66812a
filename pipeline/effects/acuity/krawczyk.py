"""Krawczyk's blur, whose σ may be many pixels: from a stack of evenly blurred frames.

Where each pixel takes its own σ, its result is that of a frame blurred evenly by this σ, read at this pixel. So the
frame is blurred evenly by a ladder of σ, σ² doubling, and each pixel is interpolated between the two that its own σ²
lies between, in the logarithm of σ². That is the true two-dimensional filter but for the interpolation. A kernel's
radius stays at 6 px whatever σ: from σ = 2 px on the frame is halved for each octave. The frame's edge is a mirror,
which evenly blurred and halved frames keep.
"""

from __future__ import annotations

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from entoptic.pipeline.effects.acuity import larson
from entoptic.pipeline.effects.acuity.cielab import lightness, luminance_of
from entoptic.pipeline.effects.acuity.fit import add_grey
from entoptic.pipeline.measure import luminance

FIRST_PX2 = 0.25
"""σ² of the first rung. Engineering choice: σ = 0.5 px takes a fifth from a pixel; below it blur grows as σ² does."""
FULL_SIZE_RUNGS = 4
"""σ² of 0.25, 0.5, 1 and 2 px² are made of the frame itself; from 4 px² on the frame is halved every second rung."""
HALVED_STEP_PX2, STEP_PX2 = 0.5, 1.0
"""In px² of a halved frame, from two rungs below after halving and from the rung below without: from 1 to 4 px² it is
¼ for the halving, whose pairs lie ½ px to each side, 4·HALVED_STEP_PX2, and ¾ for enlarging linearly."""


def krawczyk_acuity(
    rgb: Float[Array, "eye 3 y x"], pixels_per_deg: float, display_limit: bool
) -> Float[Array, "eye 3 y x"]:
    """A frame in cd/m² with what the eye does not resolve taken away."""
    least = np.float32(larson.display_px2(display_limit))
    sharp, place, highest = _prepare(rgb, np.float32(pixels_per_deg), least)
    rungs = math.ceil(float(highest))
    if rungs == 0:
        return rgb
    blurred, levels = _take(jnp.zeros_like(sharp), sharp, place, 0), [sharp]
    for rung in range(1, rungs + 1):
        if rung <= FULL_SIZE_RUNGS:
            level = _even(sharp, _variance_px2(rung))
        elif rung % 2:
            level = _even(_halve(levels[-2]), HALVED_STEP_PX2)
        else:
            level = _even(levels[-1], STEP_PX2)
        levels = [levels[-1], level]
        blurred = _take(blurred, _enlarged(level, _halvings(rung), sharp.shape), place, rung)
    return add_grey(rgb, _change(blurred, sharp, place))


def reach_px(variance_px2: float) -> int:
    """How far away light may lie that reaches a pixel blurred by up to this σ²."""
    reaches = [0]
    for rung in range(1, math.ceil(place_of(variance_px2)) + 1):
        size = 2 ** _halvings(rung)
        if rung <= FULL_SIZE_RUNGS:
            reaches.append(_radius(_variance_px2(rung)))
        elif rung % 2:
            reaches.append(reaches[-2] + size * (1 + _radius(HALVED_STEP_PX2)))
        else:
            reaches.append(reaches[-1] + size * _radius(STEP_PX2))
    # Enlarging goes to the next pixel of each size but the last.
    return max(reaches) + 2 * (2 ** _halvings(len(reaches) - 1) - 1)


def place_of(variance_px2: float) -> float:
    """Where on the ladder this σ² stands: 0 sharp, 1 the first rung, 2 the second."""
    rungs = variance_px2 / FIRST_PX2
    return rungs if rungs < 1 else 1 + math.log2(rungs)


def _variance_px2(rung: int) -> float:
    return FIRST_PX2 * 2.0 ** (rung - 1)


def _halvings(rung: int) -> int:
    return max(rung - FULL_SIZE_RUNGS + 1, 0) // 2


@jax.jit
def _prepare(
    rgb: Float[Array, "eye 3 y x"], pixels_per_deg: Float[Array, ""], least_px2: Float[Array, ""]
) -> tuple[Float[Array, "eye y x"], Float[Array, "eye y x"], Float[Array, ""]]:
    """Lightness, each pixel's place on the ladder (0 sharp, 1 the first rung), and the highest of these."""
    y = luminance(rgb)
    rungs = larson.variance_map(y, pixels_per_deg, least_px2) / np.float32(FIRST_PX2)
    place = jnp.where(rungs < 1, rungs, 1 + jnp.log(jnp.maximum(rungs, 1)) * np.float32(1 / math.log(2)))
    return lightness(y), place, place.max()


@functools.partial(jax.jit, donate_argnums=0)
def _take(
    onto: Float[Array, "eye y x"], level: Float[Array, "eye y x"], place: Float[Array, "eye y x"], rung: float
) -> Float[Array, "eye y x"]:
    """What pixels at this place of the ladder have from one rung of it: all at the rung, nothing at its neighbours."""
    return onto + jnp.maximum(1 - jnp.abs(place - jnp.float32(rung)), 0) * level


@jax.jit
def _change(
    blurred: Float[Array, "eye y x"], sharp: Float[Array, "eye y x"], place: Float[Array, "eye y x"]
) -> Float[Array, "eye y x"]:
    return jnp.where(place > 0, luminance_of(blurred) - luminance_of(sharp), 0)


def _even(values: Float[Array, "eye y x"], variance: float) -> Float[Array, "eye y x"]:
    # Compiled as one function, XLA would fuse the passes and make of n + n taps n².
    for axis in (2, 1):
        values = _along(_mirrored(values, _radius(variance), axis), variance, axis)
    return values


@functools.partial(jax.jit, static_argnums=(1, 2))
def _mirrored(values: Float[Array, "eye y x"], radius: int, axis: int) -> Float[Array, "eye y x"]:
    margin = [(0, 0)] * 3
    margin[axis] = (radius, radius)
    return jnp.pad(values, margin, mode="symmetric")


@functools.partial(jax.jit, static_argnums=(1, 2))
def _along(padded: Float[Array, "eye y x"], variance: float, axis: int) -> Float[Array, "eye y x"]:
    weights = _weights(variance)
    radius = _radius(variance)
    size = padded.shape[axis] - 2 * radius

    def tap(offset: int) -> Float[Array, "eye y x"]:
        return jax.lax.slice_in_dim(padded, radius + offset, radius + offset + size, axis=axis)

    result = weights[0] * tap(0)
    for k in range(1, radius + 1):
        result = result + weights[k] * (tap(-k) + tap(k))
    return result


def _weights(variance: float) -> list[np.float32]:
    """A Gaussian's from the middle outwards, at pixels; they add up to 1 with the mirrored ones."""
    taps = np.exp(-(np.arange(_radius(variance) + 1) ** 2) / (2 * variance))
    return [np.float32(tap) for tap in taps / (2 * taps.sum() - 1)]


def _radius(variance: float) -> int:
    """4σ: what lies beyond weighs 6e-5."""
    return math.ceil(4 * math.sqrt(variance))


@jax.jit
def _halve(values: Float[Array, "eye y x"]) -> Float[Array, "eye y/2 x/2"]:
    """Means of two by two pixels; an odd last row or column counts as its own neighbour."""
    for axis in (2, 1):
        if values.shape[axis] % 2:
            last = jax.lax.slice_in_dim(values, values.shape[axis] - 1, values.shape[axis], axis=axis)
            values = jnp.concatenate([values, last], axis)
        values = (
            jax.lax.slice_in_dim(values, 0, None, 2, axis=axis) + jax.lax.slice_in_dim(values, 1, None, 2, axis=axis)
        ) * np.float32(0.5)
    return values


def _enlarged(values: Float[Array, "eye y x"], halvings: int, shape: tuple[int, ...]) -> Float[Array, "eye y x"]:
    """Back to full size, linearly between the middles of pixels."""
    for left in reversed(range(halvings)):
        # As many as the halving one step up had.
        values = _doubled(_repeated(values), -(-shape[1] // 2**left), -(-shape[2] // 2**left))
    return values


@jax.jit
def _repeated(values: Float[Array, "eye y x"]) -> Float[Array, "eye 2y+4 2x+4"]:
    return jnp.repeat(jnp.repeat(jnp.pad(values, ((0, 0), (1, 1), (1, 1)), mode="edge"), 2, 1), 2, 2)


@functools.partial(jax.jit, static_argnums=(1, 2))
def _doubled(repeated: Float[Array, "eye 2y+4 2x+4"], height: int, width: int) -> Float[Array, "eye height width"]:
    """Of pixels repeated: their mean with weights ¼, ½, ¼ in both directions lies linearly between the pixels'."""
    result = jnp.zeros((repeated.shape[0], height, width), jnp.float32)
    for dy, weight_y in enumerate((0.25, 0.5, 0.25)):
        for dx, weight_x in enumerate((0.25, 0.5, 0.25)):
            part = repeated[:, 1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width]
            result = result + np.float32(weight_y * weight_x) * part
    return result
