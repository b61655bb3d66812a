"""A displayed frame with its afterimages."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from entoptic.pipeline.effects.afterimage import geometry
from entoptic.pipeline.effects.afterimage.retina import Retina, cone_matrix
from entoptic.pipeline.effects.afterimage.seen import seen
from entoptic.pipeline.frame import View


def show(
    displayed: Float[Array, "eye 3 y x"],
    retinas: Sequence[Retina],
    view: View,
    gaze_px: Sequence[tuple[float, float]],
) -> Float[Array, "eye 3 y x"]:
    """A frame, linear Rec.709 with 1 = the display's peak, as eyes with these retinas see it. One gaze for each eye.

    What the cones see more or less counts in full where the frame is dark and not at all at the display's peak, as
    1 − d²: what is shown there is brighter than can be shown, and with half its light still is. Engineering choice: of
    half the light a curve 1 − exp(−x) makes 0.29 out of 0.5, this 0.31. The eye's own light is laid over it as light is
    that adds up before such a curve: a + b − a·b.
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


@functools.partial(jax.jit, static_argnames="sides")
def _show(
    displayed: Float[Array, "eye 3 y x"],
    change: Float[Array, "eye 3 row column"],
    light: Float[Array, "eye 3 row column"],
    sides: tuple[int, int],
    cones: Float[Array, "3 3"],
    to_rgb: Float[Array, "3 3"],
) -> Float[Array, "eye 3 y x"]:
    height, width = displayed.shape[2:]
    down, across = sides
    nodes = _across(jnp.concatenate([change, light], 1), across, width)
    whole = height // down
    # In blocks of rows that lie between the same nodes: along a row there is nothing to look up.
    parts = [_block(displayed[:, :, : whole * down], nodes, 0, down, down, cones, to_rgb)]
    if height % down:
        parts.append(_block(displayed[:, :, whole * down :], nodes, whole, down, height % down, cones, to_rgb))
    return parts[0] if len(parts) == 1 else jnp.concatenate(parts, 2)


def _block(
    displayed: Float[Array, "eye 3 y x"],
    nodes: Float[Array, "eye 6 row+2 x"],
    first: int,
    side: int,
    rows: int,
    cones: Float[Array, "3 3"],
    to_rgb: Float[Array, "3 3"],
) -> Float[Array, "eye 3 y x"]:
    """Blocks of so many rows, one around each node from `first` on."""
    image = displayed.reshape(*displayed.shape[:2], -1, rows, displayed.shape[3])
    count = image.shape[2]
    weights = _weights(side)[:, :rows, None]
    layers = sum(weights[k] * nodes[:, :, first + k : first + k + count, None] for k in range(3))
    red, green, blue = image[:, 0], image[:, 1], image[:, 2]
    more = [
        layers[:, cone] * (cones[cone, 0] * red + cones[cone, 1] * green + cones[cone, 2] * blue) for cone in range(3)
    ]
    channels = []
    for k in range(3):
        channel = image[:, k]
        changed = to_rgb[k, 0] * more[0] + to_rgb[k, 1] * more[1] + to_rgb[k, 2] * more[2]
        changed = channel + (1 - channel * channel) * changed
        channels.append(changed + layers[:, 3 + k] * (1 - changed))
    return jnp.stack(channels, 1).reshape(displayed.shape)


def _across(nodes: Float[Array, "eye 6 row column"], side: int, width: int) -> Float[Array, "eye 6 row+2 x"]:
    """Values between nodes along each row, constant beyond the outer ones; the outer rows twice."""
    count = nodes.shape[3]
    padded = jnp.pad(nodes, ((0, 0), (0, 0), (0, 0), (1, 1)), mode="edge")
    weights = _weights(side)
    pixels = sum(weights[k] * padded[..., k : k + count, None] for k in range(3))
    rows = pixels.reshape(*nodes.shape[:3], -1)[..., :width]
    # A pass of its own: within the next one, each pixel would ask again whether it lies at an edge.
    return jax.lax.optimization_barrier(jnp.pad(rows, ((0, 0), (0, 0), (1, 1), (0, 0)), mode="edge"))


def _weights(side: int) -> Float[np.ndarray, "3 side"]:
    """Of the node before, the nearest and the one after, for each pixel of a node's own."""
    from_node = (np.arange(side) + 0.5) / side - 0.5
    weights = np.stack([np.maximum(-from_node, 0), 1 - np.abs(from_node), np.maximum(from_node, 0)])
    return weights.astype(np.float32)
