"""A frame at half its resolution, at a quarter and so on; and back, added up.

Down, by boxes; the last step to the plane's cells by linear weights, so that light keeps its place where it lies
between two cells. Up, by cubic interpolation (Catmull and Rom 1974), which leaves what is straight as it is, and to the
pixels themselves by linear weights. On the way up each level adds what light scatters over a few of its own pixels: the
finer, the nearer.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

RISE = ((-3 / 128, 29 / 128, 111 / 128, -9 / 128), (-9 / 128, 111 / 128, 29 / 128, -3 / 128))
"""Weights of four cells for the two pixels of one: a quarter of a cell before its middle, and behind it."""
Stencil = tuple[tuple[int, int], ...]
NEXT: Stencil = ((0, 1), (1, 1))
"""Pixels around one that it scatters to, by their distances along the axes, the longer last."""
WIDER: Stencil = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2), (0, 3), (1, 3))
"""The same at the coarser levels."""


def halved(image: Float[Array, "c y x"]) -> Float[Array, "c y x"]:
    """Means of two by two pixels."""
    rows = image.reshape(image.shape[0], -1, 2, image.shape[2])
    # In one step with the columns, XLA leaves the sum of rows to single numbers.
    both = jax.lax.optimization_barrier(rows[:, :, 0] + rows[:, :, 1])
    return (both[:, :, ::2] + both[:, :, 1::2]) * np.float32(0.25)


def to_cells(image: Float[Array, "c y x"]) -> Float[Array, "c y x"]:
    """The same, each pixel shared with the next cell by linear weights."""
    for axis in (1, 2):
        first, second = (_every_other(image, k, axis) for k in (0, 1))
        before = jnp.concatenate([_part(first, 0, 1, axis), _part(second, 0, second.shape[axis] - 1, axis)], axis)
        after = jnp.concatenate(
            [_part(first, 1, first.shape[axis], axis), _part(second, second.shape[axis] - 1, None, axis)], axis
        )
        image = jax.lax.optimization_barrier(
            np.float32(0.375) * (first + second) + np.float32(0.125) * (before + after)
        )
    return image


def _every_other(image: Array, first: int, axis: int) -> Array:
    return image[:, first::2] if axis == 1 else image[:, :, first::2]


def _part(image: Array, begin: int, end: int | None, axis: int) -> Array:
    return image[:, begin:end] if axis == 1 else image[:, :, begin:end]


def raised(image: Float[Array, "c y x"]) -> Float[Array, "c y x"]:
    """An image at twice its resolution."""
    channels, height, width = image.shape
    edged = jnp.pad(image, ((0, 0), (2, 2), (2, 2)), mode="edge")
    across = [
        _sum([np.float32(weight) * edged[:, :, phase + k : phase + k + width] for k, weight in enumerate(RISE[phase])])
        for phase in (0, 1)
    ]
    wide = jnp.stack(across, axis=-1).reshape(channels, height + 4, 2 * width)
    weights = np.zeros((5, 2), np.float32)
    for phase in (0, 1):
        weights[phase : phase + 4, phase] = RISE[phase]
    tall = _sum([wide[:, k : k + height, None] * weights[k][:, None] for k in range(5)])
    return tall.reshape(channels, 2 * height, 2 * width)


def raised_linearly(image: Float[Array, "c y x"]) -> Float[Array, "c y x"]:
    """The same by linear weights: nowhere below 0, for images that are smooth over their pixels."""
    channels, height, width = image.shape
    edged = jnp.pad(image, ((0, 0), (0, 0), (1, 1)), mode="edge")
    own, less = np.float32(0.75), np.float32(0.25)
    across = jnp.stack([own * image + less * edged[:, :, :-2], own * image + less * edged[:, :, 2:]], axis=-1)
    wide = jax.lax.optimization_barrier(across.reshape(channels, height, 2 * width))
    edged = jnp.pad(wide, ((0, 0), (1, 1), (0, 0)), mode="edge")
    before, after = np.array([[0.25], [0]], np.float32), np.array([[0], [0.25]], np.float32)
    tall = before * edged[:, :-2, None] + own * wide[:, :, None] + after * edged[:, 2:, None]
    return tall.reshape(channels, 2 * height, 2 * width)


def scattered(image: Float[Array, "c y x"], stencil: Stencil, weights: Sequence[Array]) -> Float[Array, "c y x"]:
    """What pixels around each one scatter to it; a tap's weight is that of one of the pixels that it stands for."""
    return _sum([weight * part for weight, part in zip(weights, scattered_each(image, stencil), strict=True)])


def scattered_each(image: Float[Array, "c y x"], stencil: Stencil) -> list[Float[Array, "c y x"]]:
    """For each tap, the sum of the pixels that it stands for."""
    reach = max(max(tap) for tap in stencil)
    height, width = image.shape[1:]
    edged = jnp.pad(image, ((0, 0), (reach, reach), (reach, reach)))

    def moved(down: int, right: int) -> Array:
        return edged[:, reach + down : reach + down + height, reach + right : reach + right + width]

    return [_sum([moved(*to) for to in around(tap)]) for tap in stencil]


@functools.cache
def around(tap: tuple[int, int]) -> tuple[tuple[int, int], ...]:
    """All pixels that lie as far away as a tap: down and right."""
    near, far = tap
    return tuple(sorted({(sy * y, sx * x) for y, x in ((near, far), (far, near)) for sy in (1, -1) for sx in (1, -1)}))


def _sum(parts: list[Array]) -> Array:
    return functools.reduce(jnp.add, parts)
