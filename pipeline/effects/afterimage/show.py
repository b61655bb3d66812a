"""A displayed frame with its afterimages."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pipeline.effects.afterimage import geometry
from pipeline.effects.afterimage.retina import Retina, cone_matrix
from pipeline.effects.afterimage.seen import seen
from pipeline.frame import View


def show(
    displayed: Float[Array, "eye 3 y x"],
    retinas: Sequence[Retina],
    view: View,
    gaze_px: Sequence[tuple[float, float]],
) -> Float[Array, "eye 3 y x"]:
    """A frame, linear Rec.709 with 1 = the display's peak, as eyes with these retinas see it. One gaze for each eye.

    The eye's own light is laid over it as light is that adds up before a curve 1 − exp(−x): a + b − a·b. So nothing
    becomes brighter than the display's peak, and where the display shows that, nothing is added.
    """
    cones = cone_matrix()
    layers = [seen(retina, view, gaze) for retina, gaze in zip(retinas, gaze_px, strict=True)]
    return _show(
        displayed,
        jnp.stack([layer.change for layer in layers]),
        jnp.stack([layer.light for layer in layers]),
        geometry.node_px(view),
        cones.astype(np.float32),
        np.linalg.inv(cones).astype(np.float32),
    )


@functools.partial(jax.jit, static_argnames="side")
def _show(
    displayed: Float[Array, "eye 3 y x"],
    change: Float[Array, "eye 3 row column"],
    light: Float[Array, "eye 3 row column"],
    side: int,
    cones: Float[Array, "3 3"],
    to_rgb: Float[Array, "3 3"],
) -> Float[Array, "eye 3 y x"]:
    height, width = displayed.shape[2:]
    change, light = (_between(_between(nodes, side, height, 2), side, width, 3) for nodes in (change, light))
    red, green, blue = displayed[:, 0], displayed[:, 1], displayed[:, 2]
    more = [
        change[:, cone] * (cones[cone, 0] * red + cones[cone, 1] * green + cones[cone, 2] * blue) for cone in range(3)
    ]
    changed = jnp.stack([to_rgb[k, 0] * more[0] + to_rgb[k, 1] * more[1] + to_rgb[k, 2] * more[2] for k in range(3)], 1)
    changed = displayed + changed
    return changed + light * (1 - changed)


def _between(nodes: Float[Array, "eye 3 _ _"], side: int, size: int, axis: int) -> Float[Array, "eye 3 _ _"]:
    """Values at each pixel along an axis, linear between nodes and constant beyond the outer ones."""
    count = nodes.shape[axis]
    padded = jnp.concatenate(
        [
            jax.lax.slice_in_dim(nodes, 0, 1, axis=axis),
            nodes,
            jax.lax.slice_in_dim(nodes, count - 1, count, axis=axis),
        ],
        axis,
    )
    before, here, after = (
        jnp.expand_dims(jax.lax.slice_in_dim(padded, k, k + count, axis=axis), axis + 1) for k in range(3)
    )
    shape = [1] * (nodes.ndim + 1)
    shape[axis + 1] = side
    from_middle = ((np.arange(side) + 0.5) / side - 0.5).astype(np.float32).reshape(shape)
    pixels = (
        np.maximum(-from_middle, 0) * before + (1 - np.abs(from_middle)) * here + np.maximum(from_middle, 0) * after
    )
    merged = pixels.reshape(*nodes.shape[:axis], count * side, *nodes.shape[axis + 1 :])
    return jax.lax.slice_in_dim(merged, 0, size, axis=axis)
