"""Light convolved with a mixture of kernels by FFT.

Where nothing but rounding can make the luminance of what arrives negative, since every kernel's is positive, nothing
arrives: no pixel's luminance is ever below 0, and the hue of the others is untouched.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Literal, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare.kernel import Component, Mixture

KEPT = 2
"""Transforms kept of a component: of one view at two precisions. At 1440×1600 one takes 38 MB, of a frame 94 MB."""
Values = TypeVar("Values", NDArray[np.floating], Array)
Precision = Literal["float32", "float64"]


def spill_share(luminance_cd_m2: Values, ceiling_cd_m2: float) -> Values:
    """The share of a pixel's light above a ceiling > 0: all that spreads where the display makes the rest itself."""
    return 1 - ceiling_cd_m2 / luminance_cd_m2.clip(ceiling_cd_m2)


def transform(
    component: Component, rows: int, columns: int, reach: tuple[int, int], dtype: Precision
) -> Complex[Array, "o i u v"]:
    """FFT of what a component scatters up to `reach` pixels up and down, right and left, its centre at the origin."""
    wanted = (rows, columns, reach, dtype)
    if wanted not in component.transforms:
        scatters = component.scatters
        y, x = (side // 2 for side in scatters.shape[2:])
        up, left = min(reach[0], y), min(reach[1], x)
        part = scatters[..., y - up : y + up + 1, x - left : x + left + 1].astype(dtype)
        while len(component.transforms) >= KEPT:
            component.transforms.pop(next(iter(component.transforms)))
        component.transforms[wanted] = _transform(part, rows, columns)
    return component.transforms[wanted]


@functools.partial(jax.jit, static_argnames=("rows", "columns"))
def _transform(scatters: Float[Array, "o i j k"], rows: int, columns: int) -> Complex[Array, "o i u v"]:
    high, wide = scatters.shape[2:]
    padded = jnp.pad(scatters, ((0, 0), (0, 0), (0, rows - high), (0, columns - wide)))
    return jnp.fft.rfft2(jnp.roll(padded, (-(high // 2), -(wide // 2)), (2, 3)))


def staying(mixture: Mixture) -> NDArray[np.float64]:
    """What the kernel changes of the light where it is, 3×3: the part that stays or that the veil will take, less 1."""
    return np.asarray(sum(weight * component.keeps for component, weight in mixture)) - np.eye(3)


def weights(mixture: Mixture, dtype: Precision) -> NDArray[np.floating]:
    """The weights of a mixture."""
    return np.array([weight for _, weight in mixture], dtype)


def through(matrix: Array, light: Array) -> Array:
    """Light (i, …) through a matrix (o, i, …) from channel to channel; a 1×1 matrix does the same to each channel.

    The sum is written out: XLA makes one vectorized pass of it. An einsum takes thirty times as long, and with a stack
    of three sums each element asks which of them it is.
    """
    if matrix.shape[:2] == (1, 1):
        return matrix[0, 0] * light
    return functools.reduce(jnp.add, [matrix[:, i] * light[i] for i in range(matrix.shape[1])])


def blend(parts: Sequence[Array], weights: Array) -> tuple[Array, ...]:
    """The weighted sum of matrices (o, i, …): one of those that are 1×1, one of the others."""
    return tuple(
        functools.reduce(jnp.add, alike)
        for grey in (True, False)
        if (alike := [part * w for part, w in zip(parts, weights, strict=True) if (part.shape[0] == 1) is grey])
    )


@functools.partial(jax.jit, static_argnames="columns")
def spread(
    light: Float[Array, "3 y x"], parts: Sequence[Complex[Array, "o i u v"]], weights: Float[Array, "n"], columns: int
) -> Float[Array, "3 v u"]:
    """Light convolved with a mixture of kernels, transformed at a size with `columns` columns; of that size.

    Rounding may make it a little less than nothing.
    """
    size = parts[0].shape[2], columns
    of_light = jnp.fft.rfft2(light, s=size)
    product = functools.reduce(jnp.add, [through(part, of_light) for part in blend(parts, weights)])
    return jnp.fft.irfft2(product, s=size)
