"""All light of a frame scattered: pooled, over the plane, and back through the levels.

Beyond the frame's edges there is the same light everywhere. It scatters into itself, so only what the frame has more
or less than that is scattered. Where nothing but rounding and the B-splines' swing can make the luminance of what
arrives negative, since every function's is positive, nothing arrives.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare.kernel import FALLS, TURNS, Mixed, Prepared
from entoptic.pipeline.effects.glare.plane import Plane, Tables, gathered, read_off
from entoptic.pipeline.effects.glare.pyramid import (
    NEXT,
    WIDER,
    halved,
    raised,
    raised_linearly,
    scattered,
    scattered_each,
    to_cells,
)
from entoptic.pipeline.frame import View
from entoptic.pipeline.measure import luminance


class Apart(NamedTuple):
    """Pixels whose near light is laid down pixel by pixel; those that are not used have no light."""

    rows: Int[Array, "n"]
    columns: Int[Array, "n"]
    light: Float[Array, "3 n"]


class Pooled(NamedTuple):
    """A frame's light at lower resolutions."""

    coarser: tuple[Float[Array, "3 y x"], ...]
    """At the levels from twice as large pixels to the cells', finest first."""
    cells: Float[Array, "3 row column"]


def pooled(light: Float[Array, "3 y x"], pool: int) -> Pooled:
    """What a frame whose sides are whole numbers of cells has more than there is beyond its edges, at each level."""
    levels = [light]
    while 2 ** len(levels) <= pool:
        levels.append(_halved(levels[-1]))
    return Pooled(tuple(levels[1:]), _to_cells(levels[-2]) if pool > 1 else light)


def without(whole: Pooled, apart: Apart, pool: int) -> Pooled:
    """The same without the pixels apart. Consumes the coarser levels."""
    return _without(whole.coarser, whole.cells, apart, pool)


@functools.partial(jax.jit, static_argnames="pool", donate_argnames="coarser")
def _without(coarser: tuple[Array, ...], cells: Float[Array, "3 row column"], apart: Apart, pool: int) -> Pooled:
    coarser = tuple(_less(image, apart, 2 ** (k + 1)) for k, image in enumerate(coarser))
    if pool == 1:
        return Pooled(coarser, cells.at[:, apart.rows, apart.columns].add(-apart.light))
    side = pool // 2
    half_y, half_x = apart.rows // side, apart.columns // side
    light = apart.light / np.float32(side * side)
    height, width = cells.shape[1:]
    for to_y, weight_y in ((half_y // 2, 0.375), (half_y // 2 + half_y % 2 * 2 - 1, 0.125)):
        for to_x, weight_x in ((half_x // 2, 0.375), (half_x // 2 + half_x % 2 * 2 - 1, 0.125)):
            place = jnp.clip(to_y, 0, height - 1), jnp.clip(to_x, 0, width - 1)
            cells = cells.at[:, place[0], place[1]].add(-light * np.float32(weight_y * weight_x))
    return Pooled(coarser, cells)


def _less(image: Float[Array, "3 y x"], apart: Apart, side: int) -> Float[Array, "3 y x"]:
    return image.at[:, apart.rows // side, apart.columns // side].add(-apart.light / np.float32(side * side))


def arrives(
    plane: Plane,
    cells: Float[Array, "3 row column"],
    rest: Float[Array, "3 row column"],
    parts: Sequence[Prepared],
    weights: NDArray[np.float32],
    beyond: Float[Array, "3 1 1"],
    further: Float[Array, "3 v u"] | None = None,
) -> Float[Array, "3 row column"]:
    """What the plane brings to each of a frame's cells, in cd/m² more than `beyond`.

    Far light of all `cells`; near light of the `rest` where cells are pixels, else the levels have it. `further` is the
    plane's own light from elsewhere, not yet weighed by c^−FALLS where it lands. Its steps are
    compiled apart: fused, XLA works out the plane anew for each of the nine cells that a B-spline reads.
    """
    cosines, size = _cosines(plane), (plane.height, plane.width)
    high, turning, near = _mixed_spectra([(part.high, part.turning, part.near) for part in parts], weights)
    straight, turned, close = _to_plane(
        cells, None if near is None else rest, plane.tables, cosines, plane.pool, size[0]
    )
    fft = plane.fft_height, plane.fft_width
    direct = _convolved(
        [straight] if close is None else [straight, close], [high] if near is None else [high, near], fft
    )
    low = _weighed(direct, _convolved([turned], [turning], fft), further, cosines, size)
    return _positive(_read_off(low, plane.tables), beyond)


@functools.lru_cache(maxsize=8)
def _cosines(plane: Plane) -> Float[Array, "v u"]:
    return jax.device_put(np.float32(plane.cosines))


Spectra = tuple[Array, Array, Array | None]


def _mixed_spectra(parts: Sequence[Spectra], weights: NDArray[np.float32]) -> Spectra:
    return parts[0] if len(parts) == 1 else _blended_spectra(parts, weights)


@jax.jit
def _blended_spectra(parts: Sequence[Spectra], weights: Float[Array, "part"]) -> Spectra:
    high, turning, near = zip(*parts, strict=True)
    return blended(high, weights), blended(turning, weights), None if near[0] is None else blended(near, weights)


@functools.partial(jax.jit, static_argnames=("pool", "height"))
def _to_plane(
    cells: Float[Array, "3 row column"],
    rest: Float[Array, "3 row column"] | None,
    tables: Tables,
    cosines: Float[Array, "v u"],
    pool: int,
    height: int,
) -> tuple[Float[Array, "3 v u"], Float[Array, "3 v u"], Float[Array, "3 v u"] | None]:
    """Light weighed for both terms of the far function, and the rest's for the near one."""
    both = cells if rest is None else jnp.concatenate([cells, rest])
    flux = both * (tables.solid_angle * np.float32(pool * pool))
    light = gathered(flux, tables, height) * cosines ** np.float32(-FALLS)
    return light[:3], light[:3] * cosines ** np.float32(TURNS), None if rest is None else light[3:]


@functools.partial(jax.jit, static_argnames="fft")
def _convolved(
    light: Sequence[Float[Array, "i v u"]], spectra: Sequence[Array], fft: tuple[int, int]
) -> Float[Array, "o fft_v fft_u"]:
    sums = [through(spectrum, jnp.fft.rfft2(each, s=fft)) for each, spectrum in zip(light, spectra, strict=True)]
    return jnp.fft.irfft2(functools.reduce(jnp.add, sums), s=fft)


@functools.partial(jax.jit, static_argnames="size")
def _weighed(
    direct: Float[Array, "o fft_v fft_u"],
    turning: Float[Array, "o fft_v fft_u"],
    further: Float[Array, "3 v u"] | None,
    cosines: Float[Array, "v u"],
    size: tuple[int, int],
) -> Float[Array, "o v u"]:
    direct, turning = (image[:, : size[0], : size[1]] for image in (direct, turning))
    both = direct + turning * cosines ** np.float32(TURNS)
    return (both if further is None else both + further) * cosines ** np.float32(-FALLS)


_read_off = jax.jit(read_off)


@jax.jit
def mixed(parts: Sequence[Mixed], weights: Float[Array, "part"]) -> Mixed:
    """The weighted sum of what is small."""
    if len(parts) == 1:
        return parts[0]

    def mean(each: Sequence[Array]) -> Array:
        return functools.reduce(jnp.add, [one * weight for one, weight in zip(each, weights, strict=True)])

    return Mixed(
        blended([part.all_near for part in parts], weights),
        blended([part.stays for part in parts], weights),
        tuple(mean([part.taps[k] for part in parts]) for k in range(len(parts[0].taps))),
        mean([part.leaves for part in parts]),
    )


def through(matrix: Array, light: Array) -> Array:
    """Light (i, …) through a matrix (o, i, …) from channel to channel; a 1×1 matrix does the same to each channel.

    The sum is written out: XLA makes one vectorized pass of it. An einsum takes thirty times as long.
    """
    if matrix.shape[:2] == (1, 1):
        return matrix[0, 0] * light
    return functools.reduce(jnp.add, [matrix[:, i] * light[i] for i in range(matrix.shape[1])])


def blended(parts: Sequence[Array], weights: Array) -> Array:
    """The weighted sum of arrays of each part, (o, i, …): of 1×1 ones too, if not all are."""
    if len(parts) == 1:
        return parts[0]
    if len({part.shape[:2] for part in parts}) > 1:
        three = jnp.eye(3, dtype=jnp.float32)
        parts = [part * three[:, :, *[None] * (part.ndim - 2)] if part.shape[0] == 1 else part for part in parts]
    return functools.reduce(jnp.add, [part * weight for part, weight in zip(parts, weights, strict=True)])


def combined(
    light: Float[Array, "3 y x"],
    rest: Pooled,
    low: Float[Array, "3 row column"],
    mixed: Mixed,
    beyond: Float[Array, "3 1 1"],
    view: View,
    pool: int,
) -> Float[Array, "3 y x"]:
    """All light where it lands: raised from the cells to the pixels, and scattered over a few pixels of each level.

    Its steps are compiled apart: fused, XLA works out a stencil anew for each of the sums that its result is part of.
    """
    side = pool
    for image, of_level in zip(reversed(rest.coarser), reversed(mixed.taps[1:]), strict=True):
        if side < pool:
            low = raised_at_once(low)
        low = _positive(_level(low, image, of_level, view, side), beyond)
        side //= 2
    if not rest.coarser:
        return _with(beyond, _as_is(light, low, mixed, view))
    return _smooth(light, _positive(low, _leaves(beyond, mixed, view, 2, low.shape[1:])), mixed, beyond, view)


@functools.partial(jax.jit, static_argnames=("view", "side"))
def _level(
    up: Float[Array, "3 y x"], image: Float[Array, "3 y x"], taps: Float[Array, "tap power o"], view: View, side: int
) -> Float[Array, "3 y x"]:
    return up + scattered(image, WIDER, _at(_sines(view, side, image.shape[1:]), taps))


@functools.partial(jax.jit, static_argnames="view")
def _smooth(
    light: Float[Array, "3 y x"],
    low: Float[Array, "3 row column"],
    mixed: Mixed,
    beyond: Float[Array, "3 1 1"],
    view: View,
) -> Float[Array, "3 y x"]:
    return raised_linearly(low) + _near(light, mixed, view) + beyond


@functools.partial(jax.jit, static_argnames="view")
def _as_is(
    light: Float[Array, "3 y x"],
    low: Float[Array, "3 y x"],
    mixed: Mixed,
    view: View,
) -> Float[Array, "3 y x"]:
    return low + _near(light, mixed, view)


@functools.partial(jax.jit, static_argnames=("view", "side", "size"))
def _leaves(
    even: Float[Array, "3 1 1"], mixed: Mixed, view: View, side: int, size: tuple[int, ...]
) -> Float[Array, "3 y x"]:
    """What of an even light comes from further than next pixels: so much less than `beyond` the rest may be."""
    sines = _sines(view, side, size)
    near = through(mixed.stays[:, :, None, None], even) - _polynomial(sines, mixed.leaves) * even
    for tap in mixed.taps[0]:
        near = near + 4 * _polynomial(sines, tap) * even
    return even - near


def _near(light: Float[Array, "3 y x"], mixed: Mixed, view: View) -> Float[Array, "3 y x"]:
    """What stays of pixels' light, and what those next to them give."""
    sines = _sines(view, 1, light.shape[1:])
    beside, diagonal = scattered_each(light, NEXT)
    to_beside, to_diagonal = _at(sines, mixed.taps[0])
    stays = through(mixed.stays[:, :, None, None], light) - _polynomial(sines, mixed.leaves) * light
    return stays + to_beside * beside + to_diagonal * diagonal


raised_at_once = jax.jit(raised)
_halved = jax.jit(halved)
_to_cells = jax.jit(to_cells)


@jax.jit
def _positive(image: Float[Array, "3 y x"], beyond: Float[Array, "3 #y #x"]) -> Float[Array, "3 y x"]:
    """Of light more than `beyond`: no light where there would be less than none."""
    return jnp.where(luminance(image) > -luminance(beyond), image, -beyond)


@functools.partial(jax.jit, donate_argnames="image")
def _with(beyond: Float[Array, "3 1 1"], image: Float[Array, "3 y x"]) -> Float[Array, "3 y x"]:
    """All light; nothing where luminance is not above 0."""
    image = image + beyond
    return jnp.where(luminance(image) > 0, image, 0)


def _sines(view: View, side: int, size: tuple[int, ...]) -> Float[Array, "y x"]:
    """sin²α at the pixels of a level."""
    down, right = (
        ((jnp.arange(count, dtype=jnp.float32) + 0.5) * side - whole / 2) / np.float32(view.focal_px)
        for count, whole in zip(size, (view.height_px, view.width_px), strict=True)
    )
    tangent = (down * down)[:, None] + right * right
    return tangent / (1 + tangent)


def _at(sines: Float[Array, "y x"], taps: Float[Array, "tap power o"]) -> list[Float[Array, "o y x"]]:
    return [_polynomial(sines, tap) for tap in taps]


def _polynomial(sines: Float[Array, "y x"], powers: Float[Array, "power o"]) -> Float[Array, "o y x"]:
    result = jnp.asarray(powers[-1][:, None, None])
    for power in powers[-2::-1]:
        result = result * sines + power[:, None, None]
    return result
