"""The plane that light is scattered over: stereographic, around the view's axis, at low resolution.

A direction at an angle α off the axis lies 2·tan(α/2) from the plane's middle. The plane is conformal, so a kernel has
the same shape all over it, and the angle θ between two directions is exact: 2·sin(θ/2) = d·c₁·c₂, where d is their
distance in the plane and c = cos(α/2). A direction in the plane turns as it does on the sphere when it is carried along
great circles through the axis.

The frame's pixels are pooled into cells (pyramid.py), whose light goes to the plane by quadratic B-splines and comes
back by the same: each a sum of gathers with weights that are made once a view.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import NDArray

from entoptic.pipeline.fft_length import fft_length
from entoptic.pipeline.frame import View

MARGIN = 2
"""Cells of the plane beyond the frame's outermost: as far as a B-spline reaches."""
ZONES = (0, 50, 80, 95, 100)
"""Percentiles of how many cells a cell of the plane gathers from, few in the middle and many at the edges: each zone
has as many gathers as its fullest cell."""

Reals = NDArray[np.float64]


class Gather(NamedTuple):
    """One zone of the plane: the frame's cells that its cells gather from."""

    sources: Int[Array, "tap cell"]
    weights: Float[Array, "tap cell"]


class Tables(NamedTuple):
    """What goes to the device."""

    zones: tuple[Gather, ...]
    place: Int[Array, "plane"]
    """Where each cell of the plane stands in the zones put one after the other; what gathers nothing, behind them."""
    corner: Int[Array, "row column"]
    """Of each of the frame's cells: the first of the nine cells of the plane that it is read from."""
    rows: Float[Array, "3 row column"]
    columns: Float[Array, "3 row column"]
    """Their weights."""
    solid_angle: Float[Array, "row column"]
    """Of a pixel in each of the frame's cells, sr."""


@dataclasses.dataclass(frozen=True, eq=False)
class Plane:
    """The plane of a view whose pixels are pooled by `pool`."""

    view: View
    pool: int
    step: float
    """Side of a cell of the plane, in radians in the middle."""
    height: int
    width: int
    fft_height: int
    fft_width: int
    least_scale: float
    """The least c² of a direction in the frame: by so much angles are smaller than distances in the plane."""
    cosines: Reals
    """c of each cell of the plane."""
    tables: Tables

    @property
    def step_deg(self) -> float:
        """Side of a cell, in degrees in the middle."""
        return math.degrees(self.step)

    def distances(self) -> tuple[Reals, Reals]:
        """Down and right of all places of the FFT's plane from its first, both ways, in radians: (v, 1) and (1, u)."""
        down, right = ((np.arange(size) + size // 2) % size - size // 2 for size in (self.fft_height, self.fft_width))
        return np.asarray(down[:, None] * self.step), np.asarray(right[None, :] * self.step)

    def places(self, down: Reals, right: Reals) -> tuple[Reals, Reals, Reals]:
        """Row, column and c of directions, by their tangents downwards and to the right of the axis."""
        y, x, cosine = on_plane(down, right)
        return y / self.step + self.height // 2, x / self.step + self.width // 2, cosine


def on_plane(down: Reals, right: Reals) -> tuple[Reals, Reals, Reals]:
    """Where directions lie in the plane, downwards and to the right, and their c, by their tangents."""
    secant = np.sqrt(1 + down * down + right * right)
    scale = 2 / (1 + secant)
    return down * scale, right * scale, np.sqrt(0.5 + 0.5 / secant)


def pixel_solid_angles(down: Reals, right: Reals, pool: int, focal_px: float) -> Reals:
    """Of a pixel, in sr, on average over cells of `pool` × `pool` pixels around tangents, exact."""
    half = pool / 2 / focal_px

    def corner(v: Reals, u: Reals) -> Reals:
        """Of the rectangle between the axis and a direction."""
        return np.asarray(np.arctan(u * v / np.sqrt(1 + u * u + v * v)))

    low, high = down - half, down + half
    left, end = right - half, right + half
    return (corner(high, end) - corner(low, end) - corner(high, left) + corner(low, left)) / pool**2


def b_spline(place: Reals) -> tuple[NDArray[np.intp], Reals]:
    """The first of the three cells that a quadratic B-spline at a place covers, and their weights (3, …)."""
    first = np.rint(place).astype(np.intp) - 1
    beyond = place - first - 1
    return first, np.stack([(0.5 - beyond) ** 2 / 2, 0.75 - beyond * beyond, (0.5 + beyond) ** 2 / 2])


@functools.lru_cache(maxsize=8)
def plane_of(view: View, pool: int) -> Plane:
    """The plane of a view."""
    rows, columns = -(-view.height_px // pool), -(-view.width_px // pool)
    down = np.asarray(((np.arange(rows) + 0.5) * pool - view.height_px / 2)[:, None] / view.focal_px)
    right = np.asarray(((np.arange(columns) + 0.5) * pool - view.width_px / 2)[None, :] / view.focal_px)
    y, x, cosine = on_plane(down, right)
    step = pool / view.focal_px
    height, width = (2 * (math.ceil(float(np.abs(along).max()) / step) + MARGIN) + 1 for along in (y, x))
    middle_y, middle_x = height // 2, width // 2
    across = np.hypot((np.arange(height) - middle_y)[:, None], np.arange(width) - middle_x) * step
    first_y, weights_y = b_spline(y / step + middle_y)
    first_x, weights_x = b_spline(x / step + middle_x)
    zones, place = _gathers(first_y, weights_y, first_x, weights_x, height, width)
    return Plane(
        view=view,
        pool=pool,
        step=step,
        height=height,
        width=width,
        fft_height=fft_length(2 * height - 1, "complex64"),
        fft_width=fft_length(2 * width - 1, "real"),
        least_scale=float(cosine.min()) ** 2,
        cosines=1 / np.sqrt(1 + across * across / 4),
        tables=Tables(
            zones,
            jax.device_put(np.int32(place)),
            jax.device_put(np.int32(first_y * width + first_x)),
            jax.device_put(np.float32(weights_y)),
            jax.device_put(np.float32(weights_x)),
            jax.device_put(np.float32(pixel_solid_angles(down, right, pool, view.focal_px))),
        ),
    )


def _gathers(
    first_y: NDArray[np.intp], weights_y: Reals, first_x: NDArray[np.intp], weights_x: Reals, height: int, width: int
) -> tuple[tuple[Gather, ...], NDArray[np.intp]]:
    """The B-splines of the frame's cells, by the plane's cells that they fall into."""
    tap = np.arange(3)
    into = (first_y + tap[:, None, None])[:, None] * width + (first_x + tap[:, None, None])[None]
    weights = (weights_y[:, None] * weights_x[None]).ravel()
    source = np.broadcast_to(np.arange(first_y.size).reshape(first_y.shape), into.shape).ravel()
    order = np.argsort(into.ravel(), kind="stable")
    weights, source = weights[order], source[order]
    count = np.bincount(into.ravel(), minlength=height * width)
    begin = np.cumsum(count) - count
    limits = np.unique(np.concatenate([[0], np.percentile(count[count > 0], ZONES[1:]).astype(int)]))
    zones, place, reached = [], np.full(height * width, -1), 0
    for low, high in itertools.pairwise(limits):
        cells = np.flatnonzero((count > low) & (count <= high))
        taps = np.arange(high)[:, None]
        there = taps < count[cells]
        at = np.where(there, begin[cells] + taps, 0)
        zones.append(
            Gather(jax.device_put(np.int32(source[at])), jax.device_put(np.float32(np.where(there, weights[at], 0))))
        )
        place[cells] = reached + np.arange(len(cells))
        reached += len(cells)
    place[place < 0] = reached
    return tuple(zones), place


def gathered(light: Float[Array, "c row column"], tables: Tables, height: int) -> Float[Array, "c v u"]:
    """Light of the frame's cells on the plane; none is lost. To be called within the caller's jitted function."""
    flat = light.reshape(len(light), -1)
    parts = [
        sum(flat[:, sources] * weights for sources, weights in zip(zone.sources, zone.weights, strict=True))
        for zone in tables.zones
    ]
    whole = jnp.concatenate([*map(jnp.asarray, parts), jnp.zeros((len(flat), 1), flat.dtype)], axis=1)
    return whole[:, tables.place].reshape(len(flat), height, -1)


def read_off(plane: Float[Array, "c v u"], tables: Tables) -> Float[Array, "c row column"]:
    """The plane at the frame's cells. To be called within the caller's jitted function."""
    flat = plane.reshape(len(plane), -1)
    return jnp.asarray(
        sum(
            flat[:, tables.corner + (down * plane.shape[2] + right)] * (tables.rows[down] * tables.columns[right])
            for down in range(3)
            for right in range(3)
        )
    )
