"""Near light laid down pixel by pixel at true angles, for pixels that stand out and for lights of their own.

What is near falls so steeply that a bright pixel's light has to land where it does, to a pixel. So each such pixel lays
down a window of the function, as it looks from its place in the view: pixels of one tile share one, and a tile's window
is kept as long as the function is.
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

from entoptic.pipeline.effects.glare.kernel import (
    CORE_PER_PX,
    FINE_PER_PX,
    Mixed,
    Part,
    Prepared,
    Sampled,
    far_deg,
)
from entoptic.pipeline.effects.glare.passing import Passing
from entoptic.pipeline.effects.glare.plane import Plane
from entoptic.pipeline.effects.glare.spread import Apart, blended, through
from entoptic.pipeline.frame import View

TILE_RAD = 0.05
"""Side of a tile that shares a window, in the middle. Engineering choice: across it angles per pixel differ by up
to 5 % at 52°."""
REACHES_PX = (24, 40, 64, 100, 144)
"""How far windows reach to each side: few shapes to compile."""
PARTS = 3
"""Of a pixel along each side, where the function is looked up."""
INNER_PX, INNER_PARTS = 2, 5
"""Pixels around one where it is looked up in the core's samples, and at how many parts along each side."""
AT_ONCE = 8
"""Windows made in one call."""
KEPT = 600
"""Windows kept of a part: 60 MB in the middle of a view of 104°."""


class Window(NamedTuple):
    """What light at one place puts around it."""

    density: Float[Array, "o i k k"]
    """Per steradian, 0 in its own pixel."""
    given: Float[Array, "o i"]
    """All that other pixels get."""


def reach_px(plane: Plane, row: NDArray[np.floating], column: NDArray[np.floating]) -> NDArray[np.floating]:
    """How far near light reaches from a pixel, in the direction away from the axis, in which it reaches furthest."""
    view = plane.view
    down, right = (row + 0.5 - view.height_px / 2) / view.focal_px, (column + 0.5 - view.width_px / 2) / view.focal_px
    radial = np.hypot(down, right)
    further = np.tan(np.minimum(np.arctan(radial) + np.radians(far_deg(plane)[1]), 1.5))
    return np.asarray((further - radial) * view.focal_px)


def tile_px(view: View) -> int:
    """Side of a tile."""
    return max(1, int(view.focal_px * TILE_RAD))


def lay_down(
    image: Float[Array, "3 y x"],
    apart: Apart,
    plane: Plane,
    parts: Sequence[tuple[Part, Prepared, float]],
    mixed: Mixed,
) -> Float[Array, "3 y x"]:
    """Adds near light of the pixels apart, in place of what the levels made of it. Consumes `image`."""
    rows, columns, light = (np.asarray(of) for of in apart)
    lit = light.any(axis=0)
    if not lit.any():
        return image
    rows, columns, light = rows[lit], columns[lit], light[:, lit]
    side = tile_px(plane.view)
    tiles = np.stack([rows // side, columns // side], axis=1)
    order = np.lexsort((tiles[:, 1], tiles[:, 0]))
    rows, columns, light, tiles = rows[order], columns[order], light[:, order], tiles[order]
    found, begins = np.unique(tiles, axis=0, return_index=True)
    begins = np.append(begins, len(tiles))
    middles = found * side + side // 2
    classes = np.searchsorted(REACHES_PX, reach_px(plane, *middles.T))
    for k in np.unique(classes[classes < len(REACHES_PX)]):
        mine = np.flatnonzero(classes == k)
        members = np.concatenate([np.arange(begins[t], begins[t + 1]) for t in mine])
        of_tile = np.repeat(np.arange(len(mine)), [begins[t + 1] - begins[t] for t in mine])
        windows = _bank(found[mine], REACHES_PX[k], plane, parts)
        image = _laid_down(
            image,
            windows,
            _padded(middles[mine] - side // 2, 8),
            _padded(np.append(np.searchsorted(of_tile, np.arange(len(mine))), len(members)), 9, len(members)),
            len(mine),
            _padded(np.stack([rows[members], columns[members]], axis=1), 64),
            _padded(light[:, members].T, 64),
            mixed,
            plane.view,
            REACHES_PX[k],
        )
    return image


def _padded(values: NDArray[np.generic], multiple: int, fill: float = 0) -> NDArray[np.generic]:
    """Made longer, so that few lengths are compiled: to a power of two times `multiple`."""
    length = multiple
    while length < len(values):
        length *= 2
    result = np.full((length, *values.shape[1:]), fill, values.dtype)
    result[: len(values)] = values
    return result


def _bank(tiles: NDArray[np.intp], reach: int, plane: Plane, parts: Sequence[tuple[Part, Prepared, float]]) -> Window:
    """The windows of tiles, one after the other; more than there are tiles."""
    banks = [_bank_of(tiles, reach, plane, part, prepared) for part, prepared, _ in parts]
    if len(banks) == 1:
        return banks[0]
    return _blended_windows(banks, np.array([weight for *_, weight in parts], np.float32))


@jax.jit
def _blended_windows(banks: Sequence[Window], weights: Float[Array, "part"]) -> Window:
    def mixed(k: int) -> Array:
        return jnp.moveaxis(blended([jnp.moveaxis(bank[k], 0, 2) for bank in banks], weights), 2, 0)

    return Window(mixed(0), mixed(1))


def _bank_of(tiles: NDArray[np.intp], reach: int, plane: Plane, part: Part, prepared: Prepared) -> Window:
    if isinstance(part, Passing):
        return _passing_bank(tiles, reach, plane, prepared)
    kept = part.kept(("windows", plane), dict)
    missing = [tile for tile in map(tuple, tiles.tolist()) if tile not in kept]
    if len(kept) + len(missing) > KEPT:
        kept.clear()
        missing = list(map(tuple, tiles.tolist()))
    for begin in range(0, len(missing), AT_ONCE):
        some, side = np.array(missing[begin : begin + AT_ONCE]), tile_px(plane.view)
        middle = np.asarray(_padded(some, AT_ONCE), np.int64) * side + side // 2
        made = windows(prepared.sampled, pixel_deg_of(plane), middle, middle + 0.5, plane.view, reach)
        for k, tile in enumerate(map(tuple, some.tolist())):
            kept[tile] = Window(made.density[k], made.given[k])
    asked = tuple(map(tuple, tiles.tolist()))
    last = kept.get("last")
    if last is None or last[0] != (asked, reach):
        count = len(_padded(tiles, 8))
        all_windows = [kept[tile] for tile in asked] + [kept[asked[0]]] * (count - len(asked))
        last = (asked, reach), _stacked(all_windows)
        kept["last"] = last
    bank: Window = last[1]
    return bank


def _passing_bank(tiles: NDArray[np.intp], reach: int, plane: Plane, prepared: Prepared) -> Window:
    side = tile_px(plane.view)
    middle = np.asarray(_padded(tiles, 8), np.int64) * side + side // 2
    averaged = _averaged(prepared.sampled.fine)
    return _passing_windows(averaged, pixel_deg_of(plane), middle, middle + 0.5, plane.view, reach)


def _elsewhere(reach: int) -> NDArray[np.float32]:
    away = np.arange(-reach, reach + 1)
    return np.asarray((away[:, None] != 0) | (away != 0), np.float32)


@jax.jit
def _averaged(fine: Float[Array, "o i k k"]) -> Float[Array, "o i k k"]:
    """Over one pixel; compiled apart, or XLA works it out anew for each look-up."""
    margin, size = FINE_PER_PX // 2, fine.shape[-1]
    wide = jnp.pad(fine, ((0, 0), (0, 0), (margin, margin), (margin, margin)))
    down = functools.reduce(jnp.add, [wide[:, :, k : k + size] for k in range(FINE_PER_PX)])
    both = functools.reduce(jnp.add, [down[:, :, :, k : k + size] for k in range(FINE_PER_PX)])
    return both / np.float32(FINE_PER_PX**2)


@functools.partial(jax.jit, static_argnames=("view", "reach"))
def _passing_windows(
    averaged: Float[Array, "o i k k"],
    pixel_deg: float,
    pixel: Int[Array, "n 2"],
    place: Float[Array, "n 2"],
    view: View,
    reach: int,
) -> Window:
    """As `windows` has them, looked up once a pixel, in samples averaged over one."""

    def one(pixel: Array, place: Array) -> tuple[Array, Array]:
        density, steradians = _seen(averaged, pixel_deg / FINE_PER_PX, pixel, place, view, reach, 1)
        # Where it is not in its own pixel: to set that to 0, XLA would copy it all.
        density = density * _elsewhere(reach)
        return density, (density * steradians).sum(axis=(2, 3))

    return Window(*jax.vmap(one)(pixel, place))


@jax.jit
def _stacked(each: Sequence[Window]) -> Window:
    return Window(jnp.stack([one.density for one in each]), jnp.stack([one.given for one in each]))


def pixel_deg_of(plane: Plane) -> float:
    """Side of a pixel of the middle."""
    return plane.step_deg / plane.pool


@functools.partial(jax.jit, static_argnames=("view", "reach"))
def windows(
    sampled: Sampled,
    pixel_deg: float,
    pixel: Int[Array, "n 2"],
    place: Float[Array, "n 2"],
    view: View,
    reach: int,
) -> Window:
    """Windows around pixels (row, column), of light at places (y, x) px in them."""

    def one(pixel: Array, place: Array) -> tuple[Array, Array]:
        density, steradians = _seen(sampled.fine, pixel_deg / FINE_PER_PX, pixel, place, view, reach, PARTS)
        inner, _ = _seen(sampled.core, pixel_deg / CORE_PER_PX, pixel, place, view, INNER_PX, INNER_PARTS)
        inside = slice(reach - INNER_PX, reach + INNER_PX + 1)
        density = density.at[:, :, inside, inside].set(inner).at[:, :, reach, reach].set(0)
        return density, (density * steradians).sum(axis=(2, 3))

    return Window(*jax.vmap(one)(pixel, place))


def _seen(
    samples: Float[Array, "o i k k"],
    side_deg: Array | float,
    pixel: Array,
    place: Array,
    view: View,
    reach: int,
    count: int,
) -> tuple[Float[Array, "o i w w"], Float[Array, "w w"]]:
    """Density in the pixels around one, of light at a place in it, on average over so many parts along each side; and
    their solid angles.
    """
    # All channels of a sample side by side: one look-up fetches them.
    flat = samples.reshape(samples.shape[0] * samples.shape[1], -1).T
    side, middle = samples.shape[-1], samples.shape[-1] // 2
    offset = jnp.arange(-reach, reach + 1, dtype=jnp.float32)
    from_y, from_x, from_c, _ = _on_plane(place[0], place[1], view)

    def add(part: Array, total: tuple[Array, Array]) -> tuple[Array, Array]:
        down, right = ((of + np.float32(0.5)) / count for of in (part // count, part % count))
        y, x, c, solid = _on_plane((pixel[0] + offset + down)[:, None], (pixel[1] + offset + right)[None, :], view)
        # The angle for a distance in the plane; the direction stays.
        scale = c * from_c * np.float32(180 / np.pi) / side_deg
        at_y, at_x = (jnp.rint(away * scale).astype(jnp.int32) + middle for away in (y - from_y, x - from_x))
        inside = (at_y >= 0) & (at_y < side) & (at_x >= 0) & (at_x < side)
        found = jnp.where(inside[..., None], flat[jnp.where(inside, at_y * side + at_x, 0)], 0)
        return total[0] + found, total[1] + solid

    width = 2 * reach + 1
    nothing = jnp.zeros((width, width, flat.shape[1]), jnp.float32), jnp.zeros((width, width), jnp.float32)
    density, steradians = jax.lax.fori_loop(0, count * count, add, nothing)
    density = jnp.moveaxis(density, 2, 0).reshape(*samples.shape[:2], width, width)
    return density / np.float32(count * count), steradians / np.float32(count * count)


def _on_plane(y_px: Array, x_px: Array, view: View) -> tuple[Array, Array, Array, Array]:
    """Where pixels lie in the plane, their c and solid angle."""
    down, right = (y_px - view.height_px / 2) / view.focal_px, (x_px - view.width_px / 2) / view.focal_px
    secant = jnp.sqrt(1 + down * down + right * right)
    scale = 2 / (1 + secant)
    return down * scale, right * scale, jnp.sqrt(0.5 + 0.5 / secant), secant**-3 / np.float32(view.focal_px**2)


@functools.partial(jax.jit, static_argnames=("view", "reach"), donate_argnames="image")
def _laid_down(
    image: Float[Array, "3 y x"],
    bank: Window,
    origins: Int[Array, "tile 2"],
    begins: Int[Array, "tile"],
    tiles: int,
    pixels: Int[Array, "n 2"],
    light: Float[Array, "n 3"],
    mixed: Mixed,
    view: View,
    reach: int,
) -> Float[Array, "3 y x"]:
    side = tile_px(view) + 2 * reach

    def of_tile(t: Array, image: Array) -> Array:
        density, given = bank.density[t], bank.given[t]

        def of_pixel(k: Array, around: Array) -> Array:
            at, colour = pixels[k], light[k]
            down, right = at[0] - origins[t, 0], at[1] - origins[t, 1]
            _, _, c, solid = _on_plane(at[0] + 0.5, at[1] + 0.5, view)
            start = (0, down, right)
            change = jax.lax.optimization_barrier(through(density, (colour * solid)[:, None, None]))
            was = jax.lax.dynamic_slice(around, start, (3, 2 * reach + 1, 2 * reach + 1))
            around = jax.lax.dynamic_update_slice(around, was + change, start)
            sine = 1 - (2 * c * c - 1) ** 2

            def there(powers: Array) -> Array:
                return functools.reduce(jnp.add, [powers[k] * sine**k for k in range(len(powers))]) * colour

            beside, diagonal = (there(tap) for tap in mixed.taps[0])
            own = through((mixed.all_near - given - mixed.stays)[:, :, None], colour[:, None])[:, 0]
            square = jnp.stack(
                [
                    jnp.stack([-diagonal, -beside, -diagonal], -1),
                    jnp.stack([-beside, own + there(mixed.leaves), -beside], -1),
                    jnp.stack([-diagonal, -beside, -diagonal], -1),
                ],
                1,
            )
            start = (0, down + reach - 1, right + reach - 1)
            was = jax.lax.dynamic_slice(around, start, (3, 3, 3))
            return jax.lax.dynamic_update_slice(around, was + square, start)

        around = jax.lax.fori_loop(begins[t], begins[t + 1], of_pixel, jnp.zeros((3, side, side), jnp.float32))
        return added(image, around, origins[t] - reach)

    return jax.lax.fori_loop(0, tiles, of_tile, image)


def added(
    image: Float[Array, "3 y x"], around: Float[Array, "3 k k"], corner: Int[Array, "2"]
) -> Float[Array, "3 y x"]:
    """A square added to an image, as much of it as lies in it. To be called within the caller's jitted function."""
    side = around.shape[1]
    size = tuple(min(side, whole) for whole in image.shape[1:])
    corner = corner.astype(jnp.int32)
    start = [jnp.clip(corner[k], 0, image.shape[k + 1] - size[k]) for k in range(2)]
    wide = jnp.pad(around, ((0, 0), (side, side), (side, side)))
    first = jnp.int32(0)
    part = jax.lax.dynamic_slice(wide, (first, *(side + start[k] - corner[k] for k in range(2))), (3, *size))
    was = jax.lax.dynamic_slice(image, (first, *start), (3, *size))
    return jax.lax.dynamic_update_slice(image, was + part, (first, *start))
