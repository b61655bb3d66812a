"""How much afterimages may change of a displayed frame, and of a change that came before them.

What is shown of a channel d is (1 − s)·(d + (1 − d²)·Δ) + s: s the eye's own light, Δ = Σ (what cone c sees more)·(its
colour)·(its catch). What all cones see more or less, m, changes no colour, and only what each differs from that by
needs the cones' matrices: |Δ| ≤ |m|·d + Σ |d_c|·|to RGB|·|catch|. All of it is bilinear between nodes, so over a tile
it is no more than at the nodes that its pixels lie between.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.effects.afterimage import geometry
from entoptic.pipeline.effects.afterimage.retina import Retina, cone_matrix
from entoptic.pipeline.effects.afterimage.seen import seen
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, View
from entoptic.pipeline.ranges import Change, Range


def skip_bound(range_: Range, retina: Retina, view: View, gaze_px: tuple[float, float]) -> Change:
    """The most that leaving afterimages out changes any pixel of each tile."""
    alike, apart, light = _over_tiles(range_.tile_px, retina, view, gaze_px)
    low, high = range_.low[:3], range_.high[:3]
    room = np.maximum(np.abs(1 - low), np.abs(1 - high))
    return _with_luminance(_headroom(low, high) * _more(high, alike, apart) + light * room)


def propagate(change: Change, range_: Range, retina: Retina, view: View, gaze_px: tuple[float, float]) -> Change:
    """What becomes of a change that came before them."""
    alike, apart, _ = _over_tiles(range_.tile_px, retina, view, gaze_px)
    wide = range_.widened(change)
    low, high, before = wide.low[:3], wide.high[:3], change[:3]
    # (1 − d′²)·Δ′ − (1 − d²)·Δ = (1 − d²)·(Δ′ − Δ) − (d′ + d)·(d′ − d)·Δ′, and Δ is linear.
    itself = 1 + 2 * high * _more(high, alike, apart)
    return _with_luminance(before * itself + _headroom(low, high) * _more(before, alike, apart))


def _headroom(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """|1 − d²| at most."""
    return np.asarray(np.maximum(np.abs(1 - low * low), np.abs(1 - high * high)))


def _more(rgb: NDArray[np.float64], alike: NDArray[np.float64], apart: NDArray[np.float64]) -> NDArray[np.float64]:
    """|Δ| at most, for |d| ≤ rgb."""
    cones = cone_matrix()
    catches = np.einsum("cj,jyx->cyx", np.abs(cones), rgb)
    return np.asarray(alike * rgb + np.einsum("kc,cyx->kyx", np.abs(np.linalg.inv(cones)), apart * catches))


def _with_luminance(rgb: NDArray[np.float64]) -> Change:
    y = np.einsum("k,kyx->yx", np.array(LUMINANCE_WEIGHTS), rgb)
    return np.concatenate([rgb, y[None]])


@functools.lru_cache(maxsize=8)
def _over_tiles(
    tile_px: int, retina: Retina, view: View, gaze_px: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """The largest |m|, |d_c| and s of each tile: (1 or 3, rows, columns). A plan asks for them several times."""
    layer = seen(retina, view, gaze_px)
    change = np.asarray(layer.change, np.float64)
    alike = change.mean(0, keepdims=True)
    values = np.concatenate([np.abs(alike), np.abs(change - alike), np.asarray(layer.light, np.float64)])
    for axis, side, size in zip((1, 2), geometry.node_px(view), (view.height_px, view.width_px), strict=True):
        ends = [min(begin + tile_px, size) for begin in range(0, size, tile_px)]
        # The nodes that the pixels of a tile lie between; beyond the last there is none.
        nodes = [range(max(k * tile_px // side - 1, 0), (end - 1) // side + 2) for k, end in enumerate(ends)]
        moved = np.moveaxis(values, axis, 0)
        values = np.moveaxis(np.stack([moved[span.start : span.stop].max(0) for span in nodes]), 0, axis)
    return values[:1], values[1:4], values[4:]
