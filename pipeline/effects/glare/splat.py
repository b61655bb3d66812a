"""Kernels laid down at single pixels: no FFT, so neither its cost nor its rounding, where the light is in few of them.

A splat touches no more of the frame than its kernel covers, and is cut at the frame's edges.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare import convolve
from entoptic.pipeline.effects.glare.kernel import Mixture
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.measure import luminance

AT_ONCE = 256
"""Stamps of one call: their number is compiled in, how many of them are used is not."""


def bright_pixels(rgb: Float[Array, "3 y x"], above_cd_m2: float) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Row and column (n, 2) of the pixels above a luminance, and their light (n, 3); brightest first."""
    above = np.flatnonzero(np.asarray(_above(rgb, np.float32(above_cd_m2))))
    # Padded to a power of two: as many shapes to compile as there are magnitudes.
    padded = np.zeros(1 << max(len(above) - 1, 0).bit_length(), np.intp)
    padded[: len(above)] = above
    light = np.asarray(_pixels(rgb, *np.unravel_index(padded, rgb.shape[1:])))[:, : len(above)]
    order = np.argsort(-luminances(light.T), kind="stable")
    return np.stack(np.unravel_index(above[order], rgb.shape[1:]), axis=1), light.T[order]


def luminances(light: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Luminance of single pixels."""
    return light @ np.array(LUMINANCE_WEIGHTS, light.dtype)


@jax.jit
def _pixels(rgb: Float[Array, "3 y x"], rows: Int[Array, "n"], columns: Int[Array, "n"]) -> Float[Array, "3 n"]:
    return rgb[:, rows, columns]


@jax.jit
def _above(rgb: Float[Array, "3 y x"], above_cd_m2: Array) -> Array:
    return luminance(rgb) > above_cd_m2


def lay_down(
    image: Float[Array, "3 y x"], at: NDArray[np.intp], light: NDArray[np.float32], mixture: Mixture
) -> Float[Array, "3 y x"]:
    """Adds what a kernel makes of the light (n, 3) of the pixels `at` (n, 2), row and column. Consumes `image`."""
    parts = tuple(component.scatters for component, _ in mixture)
    kernels = _blend(parts, convolve.weights(mixture, "float32"))
    for kernel in kernels:
        image = splat(image, at, np.zeros(len(at), np.int64), light, kernel[None])
    moved = light.astype(np.float64) @ convolve.staying(mixture).T
    for k in range(0, len(at), AT_ONCE):
        image = _add(image, _filled(at[k : k + AT_ONCE]), _filled(moved[k : k + AT_ONCE].astype(np.float32)))
    return image


_blend = jax.jit(convolve.blend)


def splat(
    image: Float[Array, "3 y x"],
    at: NDArray[np.int64],
    which: NDArray[np.int64],
    light: NDArray[np.float32],
    kernels: Float[Array, "s o i j k"],
) -> Float[Array, "3 y x"]:
    """Adds kernel `which` (n,) times the light (n, i) around each of the pixels `at` (n, 2), row and column.

    A pixel may lie outside the frame by as much as its kernel still reaches in, and must not lie further. Consumes
    `image`.
    """
    radius = kernels.shape[3] // 2
    size = np.array(image.shape[1:])
    # A block that leaves the frame would be moved back into it: then a wider frame is made for it, and cut off again.
    margin = 0 if (at >= radius).all() and (at < size - radius).all() else 2 * radius
    if margin:
        image = jnp.pad(image, ((0, 0), (margin, margin), (margin, margin)))
    for k in range(0, len(at), AT_ONCE):
        some = slice(k, k + AT_ONCE)
        corner = _filled(at[some] + margin - radius)
        image = _stamp(image, corner, _filled(which[some]), _filled(light[some]), kernels, len(at[some]))
    return image[:, margin : margin + size[0], margin : margin + size[1]] if margin else image


def _filled(rows: NDArray[np.generic]) -> NDArray[np.generic]:
    result = np.zeros((AT_ONCE, *rows.shape[1:]), rows.dtype)
    result[: len(rows)] = rows
    return result


@functools.partial(jax.jit, donate_argnames="image")
def _add(image: Float[Array, "3 y x"], at: Int[Array, "n 2"], light: Float[Array, "n 3"]) -> Float[Array, "3 y x"]:
    return image.at[:, at[:, 0], at[:, 1]].add(light.T)


@functools.partial(jax.jit, donate_argnames="image")
def _stamp(
    image: Float[Array, "3 y x"],
    corner: Int[Array, "n 2"],
    which: Int[Array, "n"],
    light: Float[Array, "n i"],
    kernels: Float[Array, "s o i j k"],
    count: int,
) -> Float[Array, "3 y x"]:
    block = (3, *kernels.shape[3:])

    def add(k: int, image: Array) -> Array:
        start = (0, corner[k, 0], corner[k, 1])
        # Fused with the update, the sum over channels is not vectorized and takes seven times as long.
        change = jax.lax.optimization_barrier(convolve.through(kernels[which[k]], light[k][:, None, None]))
        return jax.lax.dynamic_update_slice(image, jax.lax.dynamic_slice(image, start, block) + change, start)

    return jax.lax.fori_loop(0, count, add, image)
