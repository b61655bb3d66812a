"""What neighbouring effects do to each pixel by itself runs in one pass over memory, encoding included.

An effect says what it makes of a pixel as a function of planes (`Pointwise`); several of them and the encoding become
one function for XLA, which reads and writes each pixel once. Frames of 28 MB stay in no cache: what costs is reading
and writing them.

An effect may have two functions: one for all pixels, which says of which it does not hold, and a dear one for those.
Blocks that hold any are cut out, made again with the dear one, and put back. Values differ from those of one effect
after the other by the rounding of float32, since XLA contracts other products and sums: a code value at rare pixels.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt32

from entoptic.pipeline.effects.effect import Domain, Picture
from entoptic.pipeline.effects.encode import Coding, encode, encoder_of, packed, unpacked
from entoptic.pipeline.frame import Display

BLOCK_PX = 8
"""Side of a block. Engineering choice: half as large, twice as many hold a pixel beyond the display."""
AT_ONCE = 256
"""Blocks. Engineering choice: enough for two cores, few enough that the last, filled up, wastes little."""
MARK = np.uint32(1 << 30)
"""The bit of a packed pixel that says that it is to be made again: above three components of ten bits."""

Planes = tuple[Float[Array, "n y x"], ...]
"""Red, green and blue."""
Arguments = tuple[tuple[Any, ...], tuple[Array, ...], tuple[Any, ...]]
"""Numbers, planes and tables: see Pointwise."""
_Made = tuple[Planes, Bool[Array, "n y x"] | None]
Function = Callable[..., Any]
"""Of (image, scene, numbers, planes, tables, *static)."""


@dataclasses.dataclass(frozen=True, eq=False)
class Pointwise:
    """What an effect makes of each pixel, as a function of `image` and `scene` (Planes, see `Picture`)."""

    function: Function
    """`function(image, scene, numbers, planes, tables, *static)` gives Planes; with `exact` a pair, the second (n, y,
    x): pixels for which it does not hold. A module's own function, or JAX compiles it anew each frame."""
    domain: Domain
    """Of what it makes."""
    numbers: tuple[Any, ...] = ()
    """Arrays of (eye, …). The functions get them with an image's or a block's along the first axis."""
    planes: tuple[Float[Array, "eye y x"], ...] = ()
    """What differs from pixel to pixel beside the image."""
    tables: tuple[Any, ...] = ()
    """Arrays that are the same for all."""
    static: tuple[Any, ...] = ()
    """What XLA compiles for: no arrays, hashable."""
    exact: Function | None = None
    """The dear function: the same arguments, and Planes for all pixels."""

    @property
    def arguments(self) -> Arguments:
        """What XLA is given."""
        return self.numbers, self.planes, self.tables

    @property
    def kind(self) -> _Kind:
        """What XLA compiles for."""
        return _Kind(self.function, self.exact, self.domain, self.static)


@dataclasses.dataclass(frozen=True)
class _Kind:
    function: Function
    exact: Function | None
    domain: Domain
    static: tuple[Any, ...]


def weighted(planes: Sequence[Float[Array, "n y x"]], weights: Sequence[float]) -> Float[Array, "n y x"]:
    """A weighted sum of three planes."""
    red, green, blue = (np.float32(weight) * plane for weight, plane in zip(weights, planes, strict=True))
    return red + green + blue


def image_after(picture: Picture, effects: Sequence[Pointwise]) -> Float[Array, "eye 3 y x"]:
    """The images after these effects, one after the other."""
    kinds, arguments, scene = _what(picture, effects)
    return _image(picture.image, scene, arguments, kinds)


def encoded_after(picture: Picture, effects: Sequence[Pointwise], display: Display) -> np.ndarray:
    """(eye, y, x, 3): what a display is sent of the images after these effects."""
    encoder = encoder_of(display)
    if encoder is None:
        return encode(image_after(picture, effects), display)
    kinds, arguments, scene = _what(picture, effects)
    code = encoder.numbers, encoder.entries
    pixels = _packed(picture.image, scene, arguments, code, kinds, encoder.coding)
    return unpacked(pixels, encoder.coding)


def _what(
    picture: Picture, effects: Sequence[Pointwise]
) -> tuple[tuple[_Kind, ...], tuple[Arguments, ...], Float[Array, "eye 3 y x"] | None]:
    scene = None if picture.scene is picture.image else picture.scene
    return tuple(one.kind for one in effects), tuple(one.arguments for one in effects), scene


def _chain(image: Array, scene: Array | None, arguments: Sequence[Arguments], kinds: Sequence[_Kind]) -> _Made:
    """The planes after all effects, and where they do not hold."""
    planes = _planes(image)
    of_scene = planes if scene is None else _planes(scene)
    beyond: list[Bool[Array, "n y x"]] = []
    for kind, its in zip(kinds, arguments, strict=True):
        planes = kind.function(planes, of_scene, *its, *kind.static)
        if kind.exact is not None:
            planes, there = planes
            beyond.append(there)
        if kind.domain is Domain.SCENE:
            of_scene = planes
    return planes, functools.reduce(jnp.logical_or, beyond) if beyond else None


def _blocks(
    image: Array,
    scene: Array | None,
    arguments: Sequence[Arguments],
    places: Int[Array, "block 3"],
    kinds: Sequence[_Kind],
    sides: tuple[int, int],
) -> Planes:
    """The planes of these blocks, by the dear functions."""

    def cut(of: Array) -> Array:
        size = (1, *of.shape[1:-2], *sides)

        def one(place: Int[Array, "3"]) -> Array:
            return jax.lax.dynamic_slice(of, (place[0], *(jnp.int32(0),) * (of.ndim - 3), place[1], place[2]), size)[0]

        return jax.lax.map(one, places)

    of_blocks = [
        (tuple(jnp.asarray(one)[places[:, 0]] for one in numbers), tuple(map(cut, planes)), tables)
        for numbers, planes, tables in arguments
    ]
    dear = [dataclasses.replace(kind, function=kind.exact or kind.function, exact=None) for kind in kinds]
    made, _ = _chain(cut(image), None if scene is None else cut(scene), of_blocks, dear)
    return made


@functools.partial(jax.jit, static_argnames="kinds")
def _image(
    image: Array, scene: Array | None, arguments: tuple[Arguments, ...], kinds: tuple[_Kind, ...]
) -> Float[Array, "eye 3 y x"]:
    planes, beyond = _chain(image, scene, arguments, kinds)
    made = jnp.stack(planes, 1)
    if beyond is None:
        return made

    def again(places: Int[Array, "block 3"], sides: tuple[int, int]) -> Float[Array, "block 3 p q"]:
        return jnp.stack(_blocks(image, scene, arguments, places, kinds, sides), 1)

    return _made_again(made, jax.lax.optimization_barrier(beyond.astype(jnp.uint32) * MARK), again)


@functools.partial(jax.jit, static_argnames=("kinds", "coding"))
def _packed(
    image: Array,
    scene: Array | None,
    arguments: tuple[Arguments, ...],
    code: Any,
    kinds: tuple[_Kind, ...],
    coding: Coding,
) -> UInt32[Array, "eye y x"]:
    planes, beyond = _chain(image, scene, arguments, kinds)
    pixels = packed(planes, code[0], code[1], coding)
    if beyond is None:
        return pixels

    def again(places: Int[Array, "block 3"], sides: tuple[int, int]) -> UInt32[Array, "block p q"]:
        return packed(_blocks(image, scene, arguments, places, kinds, sides), code[0], code[1], coding)

    # The barrier keeps XLA from working out each pixel again for the blocks.
    pixels = jax.lax.optimization_barrier(jnp.where(beyond, pixels | MARK, pixels))
    return _made_again(pixels, pixels, again)


def _made_again(
    image: Array, marked: UInt32[Array, "eye y x"], again: Callable[[Array, tuple[int, int]], Array]
) -> Array:
    """`image` with blocks that hold a marked pixel made again, so many at once."""
    blocks = _blocks_of(marked)
    sides = min(BLOCK_PX, marked.shape[1]), min(BLOCK_PX, marked.shape[2])
    last = np.array((marked.shape[0], marked.shape[1] - sides[0], marked.shape[2] - sides[1]), np.int32)
    found, count = blocks.sum(dtype=jnp.int32), min(AT_ONCE, blocks.size)
    of_all = jnp.nonzero(blocks.ravel(), size=blocks.size)[0].astype(jnp.int32)

    def more(state: tuple[Array, Array]) -> Array:
        return state[0] < found

    def some(state: tuple[Array, Array]) -> tuple[Array, Array]:
        begin, image = state
        # The last of them again and again, where they do not fill up: it is the same each time.
        which = of_all[jnp.minimum(begin + jnp.arange(count, dtype=jnp.int32), found - 1)]
        corners = jnp.stack(jnp.unravel_index(which, blocks.shape), 1).astype(jnp.int32)
        places = jnp.minimum(corners * np.array((1, BLOCK_PX, BLOCK_PX), np.int32), last)
        return begin + count, _put(image, again(places, sides), places)

    _, image = jax.lax.while_loop(more, some, (jnp.int32(0), image))
    return image


def _put(image: Array, blocks: Array, places: Int[Array, "block 3"]) -> Array:
    def one(k: int, image: Array) -> Array:
        corner = (places[k, 0], *(jnp.int32(0),) * (image.ndim - 3), places[k, 1], places[k, 2])
        return jax.lax.dynamic_update_slice(image, blocks[k][None], corner)

    return jax.lax.fori_loop(0, places.shape[0], one, image)


def _blocks_of(pixels: UInt32[Array, "eye y x"]) -> Bool[Array, "eye row column"]:
    """Blocks that hold a marked pixel."""
    height, width = pixels.shape[1:]
    below, right = -height % BLOCK_PX, -width % BLOCK_PX
    # Rows first: whole rows are taken at once. The barrier keeps XLA from taking columns before.
    size = (1, BLOCK_PX, 1)
    rows = jax.lax.reduce_window(pixels, np.uint32(0), jax.lax.max, size, size, ((0, 0), (0, below), (0, 0)))
    rows = jnp.pad(jax.lax.optimization_barrier(rows), ((0, 0), (0, 0), (0, right)))
    return rows.reshape(*rows.shape[:2], -1, BLOCK_PX).max(-1) >= MARK


def _planes(image: Float[Array, "n 3 y x"]) -> Planes:
    return image[:, 0], image[:, 1], image[:, 2]
