"""How much of each sample of the pupil plane a shape covers: exact areas, so that a finer grid is a better one.

In a grid of n × n samples `dx_m` apart, sample i lies at (i − n//2)·dx and its cell reaches half a dx to either side.
Columns run to the right and rows downward, as their owner sees out of the eye; x is right, y is down, in metres.

An edge drawn hard, or blurred over one sample along its normal, errs by chance from sample to sample. With exact areas
a plane is the true one seen through a square of one sample: what is left of the error is smooth and falls with dx².
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

PLANE_M = 9e-3
"""Side of the pupil plane: the widest pupil."""
CHUNK_CELLS = 2_000_000
"""Cells worked on at once. Engineering choice: 16 MB for each array of float64."""


class Patches(NamedTuple):
    """Squares of cells around some of the discs, all of one size."""

    disc: Int[np.ndarray, " m"]
    """Which of the discs."""
    row: Int[np.ndarray, "m p"]
    """Row of each cell; may lie outside the grid."""
    column: Int[np.ndarray, "m p"]
    share: Float[np.ndarray, "m p p"]
    """Covered share of each cell, [disc, row, column]."""


class Region(NamedTuple):
    """Covered shares in a rectangle of cells; what lies around it is for the maker to say."""

    row: int
    column: int
    share: Float[np.ndarray, "rows columns"]


def disc(diameter_m: float, n: int, dx_m: float) -> Float[np.ndarray, "n n"]:
    """Covered share of every cell under a disc around the origin, float32; wider than the plane: cut by its sides."""
    radius = diameter_m / 2 / dx_m
    offset = np.abs(np.arange(n) - n // 2)
    inner = np.sqrt(np.maximum(radius**2 - (offset + 0.5) ** 2, 0))
    outer = np.sqrt(np.maximum(radius**2 - np.maximum(offset - 0.5, 0) ** 2, 0))
    whole = np.where(offset + 0.5 < radius, np.floor(inner - 0.5), -1)  # cells up to this offset are full
    covered = (offset.astype(np.int16)[None, :] <= whole.astype(np.int16)[:, None]).astype(np.float32)
    # Between `whole` and `outer` the circle itself runs through the row's cells.
    last = np.where(outer > 0, np.ceil(outer + 0.5) - 1, -1)
    count = np.maximum(last - whole, 0).astype(int)
    row = np.repeat(np.arange(n), count)
    reach = np.repeat(whole, count) + 1 + _count_up(count)
    x, y = reach[:, None] + [-0.5, 0.5], offset[row][:, None] + [-0.5, 0.5]
    area = np.diff(np.diff(_corner_area(x[:, :, None], y[:, None, :], radius), axis=1), axis=2)[:, 0, 0]
    for side in (-1, 1):
        column = (n // 2 + side * reach).astype(int)
        there = (column >= 0) & (column < n)
        covered[row[there], column[there]] = np.clip(area[there], 0, 1)
    return covered


def disc_patches(
    x_m: Float[np.ndarray, " disc"],
    y_m: Float[np.ndarray, " disc"],
    radius_m: Float[np.ndarray, " disc"],
    n: int,
    dx_m: float,
) -> Iterator[Patches]:
    """Covered shares of the cells around each disc on the grid, many discs of similar size at a time."""
    x, y, radius = x_m / dx_m + n // 2, y_m / dx_m + n // 2, radius_m / dx_m
    seen = (np.abs(x - (n - 1) / 2) < n / 2 + radius) & (np.abs(y - (n - 1) / 2) < n / 2 + radius)
    half = np.maximum(np.ceil(radius), 1).astype(int)
    # Two sizes of patch to an octave: few passes, and no small disc in a patch many times too wide.
    size = np.ceil(2 * np.log2(half)).astype(int)
    for group in np.unique(size[seen]):
        members = np.flatnonzero(seen & (size == group))
        reach = np.arange(-half[members].max(), half[members].max() + 1)
        step = max(CHUNK_CELLS // len(reach) ** 2, 1)
        for chunk in (members[i : i + step] for i in range(0, len(members), step)):
            column, row = np.rint(x[chunk]).astype(int), np.rint(y[chunk]).astype(int)
            corners = np.append(reach, reach[-1] + 1) - 0.5
            right = corners + (column - x[chunk])[:, None]
            down = corners + (row - y[chunk])[:, None]
            area = _corner_area(right[:, None, :], down[:, :, None], radius[chunk][:, None, None])
            share = np.clip(np.diff(np.diff(area, axis=1), axis=2), 0, 1)
            yield Patches(chunk, row[:, None] + reach, column[:, None] + reach, share)


def shade_discs(
    transmittance: Float[np.ndarray, "n n"],
    dx_m: float,
    x_m: Float[np.ndarray, " disc"],
    y_m: Float[np.ndarray, " disc"],
    radius_m: Float[np.ndarray, " disc"],
) -> None:
    """Puts opaque discs before a plane, in place. Where discs overlap, their transmittances multiply."""
    n = transmittance.shape[0]
    for patches in disc_patches(x_m, y_m, radius_m, n, dx_m):
        index, share, _ = on_grid(patches, n)
        np.multiply.at(transmittance.reshape(-1), index, (1 - share).astype(transmittance.dtype))


def on_grid(
    patches: Patches, n: int
) -> tuple[Int[np.ndarray, " cell"], Float[np.ndarray, " cell"], Int[np.ndarray, " cell"]]:
    """The covered cells that lie on the grid: index into the flat plane, covered share, and which of the discs."""
    row, column = patches.row[:, :, None], patches.column[:, None, :]
    index = row * n + column
    kept = (patches.share > 0) & ((row >= 0) & (row < n)) & ((column >= 0) & (column < n))
    owner = np.broadcast_to(patches.disc[:, None, None], kept.shape)
    return index[kept], patches.share[kept], owner[kept]


def polygons(
    x_m: Float[np.ndarray, "polygon corner"], y_m: Float[np.ndarray, "polygon corner"], n: int, dx_m: float
) -> Region:
    """Covered shares under closed polygons of either sense, overlaps added up to at most 1; 0 around the region.

    Every edge is cut where it crosses a cell's side. A piece within one cell has the area to its right in that cell and
    all of its height in the cells beyond, so a running sum along the row, over all pieces, is the exact covered area.
    """
    x, y = x_m / dx_m + n // 2 + 0.5, y_m / dx_m + n // 2 + 0.5
    near = (y.max(axis=1) > 0) & (y.min(axis=1) < n) & (x.min(axis=1) < n) & (x.max(axis=1) > 0)
    x, y = x[near], y[near]
    x_next, y_next = np.roll(x, -1, axis=1), np.roll(y, -1, axis=1)
    sense = np.sign((x * y_next - x_next * y).sum(axis=1))
    sense = np.broadcast_to(sense[:, None], x.shape).ravel()
    middle, height, edge = _pieces(x.ravel(), y.ravel(), x_next.ravel(), y_next.ravel())
    row, along = np.floor(middle[1]).astype(int), np.maximum(middle[0], 0)
    column = np.floor(along).astype(int)
    kept = (row >= 0) & (row < n) & (column < n) & (height != 0)
    if not kept.any():
        return Region(0, 0, np.zeros((0, 0)))
    row, column, along = row[kept], column[kept], along[kept]
    height = -height[kept] * sense[edge[kept]]
    top, left = int(row.min()), int(column.min())
    rows, columns = int(row.max()) + 1 - top, int(column.max()) + 2 - left
    cell = (row - top) * columns + column - left
    beyond = along - column
    steps = np.bincount(cell, height * (1 - beyond), rows * columns)
    steps += np.bincount(cell + 1, height * beyond, rows * columns)
    share = np.clip(np.cumsum(steps.reshape(rows, columns), axis=1), 0, 1)
    return Region(top, left, share[:, : n - left])


def below_parabola(height_m: float, bend_per_m: float, n: int, dx_m: float) -> Region:
    """Covered shares below the curve height + bend·x², both upward, in the rows it crosses; 0 above them, 1 below."""
    height, bend = height_m / dx_m, bend_per_m * dx_m
    right = np.arange(n + 1) - n // 2 - 0.5
    low, high = sorted((height, height + bend * right[0] ** 2))
    first = min(max(math.floor(n // 2 + 0.5 - high), 0), n)
    last = min(max(math.floor(n // 2 + 0.5 - low), -1), n - 1)
    up = n // 2 + 0.5 - np.arange(first, max(last, first - 1) + 2)
    # ∫ max(bend·t² + above, 0) dt from 0 to each corner: the parabola is positive between its roots, or outside them.
    above = height - up[:, None]
    bend = bend or -1e-30  # a straight edge is a parabola with its roots far away
    root = np.sqrt(np.maximum(-above / bend, 0))
    between = np.clip(right, -root, root)
    area = (bend / 3 * between * between + above) * between
    if bend > 0:
        area = (bend / 3 * right * right + above) * right - area
    return Region(first, 0, np.clip(np.diff(np.diff(area, axis=1), axis=0), 0, 1))


def _corner_area(
    x: Float[np.ndarray, "..."], y: Float[np.ndarray, "..."], radius: Float[np.ndarray, "..."] | float
) -> Float[np.ndarray, "..."]:
    """Area of a disc around the origin between the origin and (x, y), negative where one of the two is."""
    across, along = np.minimum(np.abs(x), radius), np.minimum(np.abs(y), radius)
    meets = np.sqrt(radius**2 - along**2)
    under = along * meets - _under_circle(meets, radius) + _under_circle(across, radius)
    return np.sign(x) * np.sign(y) * np.where(across <= meets, across * along, under)


def _under_circle(x: Float[np.ndarray, "..."], radius: Float[np.ndarray, "..."] | float) -> Float[np.ndarray, "..."]:
    """∫ √(radius² − t²) dt from 0 to x."""
    return (x * np.sqrt(np.maximum(radius**2 - x**2, 0)) + radius**2 * np.arcsin(np.minimum(x / radius, 1))) / 2


def _pieces(
    x0: Float[np.ndarray, " edge"],
    y0: Float[np.ndarray, " edge"],
    x1: Float[np.ndarray, " edge"],
    y1: Float[np.ndarray, " edge"],
) -> tuple[Float[np.ndarray, "2 piece"], Float[np.ndarray, " piece"], Int[np.ndarray, " piece"]]:
    """Edges cut at whole coordinates: the pieces' middles, their signed extents along y, and which edge each is of."""
    edges = np.arange(len(x0))
    cut_edge, cut_at = [edges, edges], [np.zeros(len(x0)), np.ones(len(x0))]
    for start, end in ((x0, x1), (y0, y1)):
        first = np.floor(np.minimum(start, end)) + 1
        count = np.maximum(np.ceil(np.maximum(start, end)) - first, 0).astype(int)
        edge = np.repeat(edges, count)
        cut_edge.append(edge)
        cut_at.append((first[edge] + _count_up(count) - start[edge]) / (end - start)[edge])
    edge, at = np.concatenate(cut_edge), np.concatenate(cut_at)
    order = np.lexsort((at, edge))
    edge, at = edge[order], at[order]
    inner = edge[1:] == edge[:-1]
    edge, low, high = edge[1:][inner], at[:-1][inner], at[1:][inner]
    dx, dy = (x1 - x0)[edge], (y1 - y0)[edge]
    middle = (low + high) / 2
    return np.stack([x0[edge] + middle * dx, y0[edge] + middle * dy]), (high - low) * dy, edge


def _count_up(count: Int[np.ndarray, " m"]) -> Int[np.ndarray, " total"]:
    """0, 1, … count − 1 for each of the counts, one after the other."""
    ends = np.cumsum(count)
    return np.arange(int(ends[-1]) if len(ends) else 0) - np.repeat(ends - count, count)
