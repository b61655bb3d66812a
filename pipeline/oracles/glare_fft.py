"""Glare by one float64 FFT of the whole padded frame, and its veil by sums over boxes of pixels at true angles.

The kernel is the one that the program prepares, its own pixel included: nothing is kept out of the FFT, so of a frame
with the sun the dark corners hold rounding, here of 1e-15 of the sun. The kernel's transform and the veil's matrix are
prepared, as the program has them at hand.
"""

from __future__ import annotations

import dataclasses
import os

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

from entoptic.pipeline.effects.glare.kernel import Mixture
from entoptic.pipeline.frame import View
from entoptic.pipeline.optics import radial
from entoptic.pipeline.oracles.glare import of_mixture, pixel_solid_angles

Reals = NDArray[np.float64]

BOXES = 64
"""Along the longer side at most. Engineering choice: 1.6° of a view of 104°; the matrix has 100 MB at most."""
WORKERS = os.cpu_count() or 1


@dataclasses.dataclass(frozen=True, eq=False)
class PreparedFft:
    """A kernel as prepared for one view."""

    view: View
    size: tuple[int, int]
    """Of the FFT."""
    transform: NDArray[np.complex128]
    """(o, i, u, v)."""
    side: int
    """Of a box, in pixels."""
    carries: Reals
    """(box, box): the light that the veil brings to a box for each cd/m²·sr that another sends out."""
    solid_angles: Reals
    """(y, x), sr."""

    def __call__(self, rgb: Reals) -> Reals:
        """A frame in cd/m² with glare, (3, y, x)."""
        height, width = rgb.shape[1:]
        spectrum = scipy.fft.rfft2(rgb, self.size, workers=WORKERS)
        through = np.stack([sum(self.transform[o, i] * spectrum[i] for i in range(3)) for o in range(3)])
        result = scipy.fft.irfft2(through, self.size, workers=WORKERS)[:, :height, :width]
        return np.asarray(result + self.veil(rgb))

    def veil(self, rgb: Reals) -> Reals:
        """What the veil brings to each pixel."""
        boxes = _boxes(rgb * self.solid_angles, self.side)
        low = (boxes.reshape(3, -1) @ self.carries.T).reshape(boxes.shape)
        rows, columns = (_middles(size, self.side) for size in rgb.shape[1:])
        ends = [min(3, len(places) - 1) for places in (rows, columns)]
        if min(ends) < 1:
            return np.broadcast_to(low.mean(axis=(1, 2), keepdims=True), rgb.shape)
        y, x = (np.arange(size) for size in rgb.shape[1:])
        return np.stack([RectBivariateSpline(rows, columns, one, kx=ends[0], ky=ends[1])(y, x) for one in low])


def prepare(view: View, kernel: Mixture) -> PreparedFft:
    """A kernel for frames of this view."""
    whole, veils = of_mixture(kernel)
    taken = sum(share for _, share in veils)
    middle = whole.shape[-1] // 2
    whole = np.eye(3)[:, :, None, None] * whole[0, 0] if len(whole) == 1 else whole.copy()
    whole[:, :, middle, middle] += np.eye(3) * (1 - taken) - whole.sum(axis=(2, 3))
    up, left = min(middle, view.height_px - 1), min(middle, view.width_px - 1)
    reaching = whole[..., middle - up : middle + up + 1, middle - left : middle + left + 1]
    size = (
        scipy.fft.next_fast_len(view.height_px + up, real=True),
        scipy.fft.next_fast_len(view.width_px + left, real=True),
    )
    padded = np.zeros((3, 3, *size))
    padded[..., : 2 * up + 1, : 2 * left + 1] = reaching
    at_origin = np.roll(padded, (-up, -left), (2, 3))
    side = -(-max(view.height_px, view.width_px) // BOXES)
    directions = _directions(view, side)
    cosine = np.clip(directions @ directions.T, -1, 1)
    deg = np.degrees(np.arccos(cosine))
    near = (deg > 0) & (deg <= radial.EDGE_DEG)
    carries = np.zeros_like(deg)
    for wide, share in veils:
        carries[near] += share / radial.hemisphere_volume(wide.density) * wide.density(deg[near])
    transform = scipy.fft.rfft2(at_origin, workers=WORKERS)
    return PreparedFft(view, size, transform, side, carries, pixel_solid_angles(view))


def _middles(size: int, side: int) -> Reals:
    """Of the boxes along a side, in pixels; the last may be smaller."""
    start = np.arange(0, size, side)
    return np.asarray((start + np.minimum(start + side, size) - 1) / 2)


def _boxes(values: Reals, side: int) -> Reals:
    by_row = np.add.reduceat(values, np.arange(0, values.shape[1], side), axis=1)
    return np.asarray(np.add.reduceat(by_row, np.arange(0, values.shape[2], side), axis=2))


def _directions(view: View, side: int) -> Reals:
    """Unit vectors of the boxes' middles, (box, 3)."""
    v = (_middles(view.height_px, side) + 0.5 - view.height_px / 2) / view.focal_px
    u = (_middles(view.width_px, side) + 0.5 - view.width_px / 2) / view.focal_px
    towards = np.stack(np.broadcast_arrays(u[None, :], v[:, None], 1.0), axis=-1).reshape(-1, 3)
    return np.asarray(towards / np.linalg.norm(towards, axis=1, keepdims=True))
