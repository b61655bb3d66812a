"""An equirectangular panorama seen through a pinhole camera that follows the head.

Theory of operation: a pixel is one sample of the panorama smoothed by a quadratic B-spline, the bump that three boxes
of one texel make. A sum of samples of it stays the same under shifts by parts of a pixel as long as a texel is no
smaller than a pixel, to 2 % in each axis for a single bright texel at the worst ratio (its transform, sinc³, at 1.5)
and to parts in a thousand for the ratios of common views. So two things are done before the first frame, for each size
of view: a panorama finer than the view is reduced by area, weighted by solid angle, to texels of one central pixel;
and its rows are shortened towards the poles as their circles are, so that texels stay as wide as high on the sphere.
Linear interpolation would cost half as much but needs four samples a pixel for the same bound.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import NDArray

from entoptic.pipeline.effects.effect import Cost
from entoptic.pipeline.frame import (
    LUMINANCE_WEIGHTS,
    Cleaned,
    Frame,
    Surroundings,
    View,
    outside_rad,
)
from entoptic.pipeline.scenes.image_file import HdrFile, band_solid_angles
from entoptic.pipeline.scenes.resample import area_mean
from entoptic.pipeline.scenes.scene import Head, count_eyes, headset_view, rays, rotation
from entoptic.tracker_bridge.wire import Eye

WIDEST_ROW_COSINE = 0.84
"""Rows nearer to the equator than this cosine of latitude (33°) keep all their texels, which leaves the part that is
mostly looked at as sharp as it was; their texels are at most 1/0.84 too narrow, 1.2 % of ripple (sinc³ at 0.84)."""


SPOT_ROWS, SPOT_RATIO, SPOTS = 360, 10.0, 64
"""A panorama is looked through for spots in so many rows, half a degree each; one that is so many times brighter than
its cell stands out, and at most so many do. Engineering choice."""
CELL_ROWS = 20
"""The rest of its light beyond a view is known in so many rows of cells, 9° each. Engineering choice: a lamp
3° and more beyond the edge veils the view within 6 % of the truth (test_around.py)."""


class Pieces(NamedTuple):
    """All of a panorama's light, in world directions, as Surroundings have it."""

    towards: NDArray[np.float32]
    """Unit vectors (n, 3): right, up, ahead."""
    rgb_lx: NDArray[np.float32]
    steradians: NDArray[np.float32]


class Texels(NamedTuple):
    """A panorama ready to be sampled: rows of their own lengths, from the zenith down."""

    rgb_cd_m2: Float[Array, "3 row column"]
    """In each row its last texel, its texels, and its first two again, so that sampling need not wrap: the remainder of
    a division costs more than all the rest. What follows them is never read."""
    columns: Int[Array, " row"]
    """How many texels each row has, all of equal width, from azimuth −180° to +180°."""


@dataclasses.dataclass(frozen=True, eq=False)
class Panorama:
    """A panorama at an infinite distance: both eyes see the same. Implements Scene."""

    rgb_cd_m2: np.ndarray
    """float32 (3, y, 2y); the middle column is azimuth 0°, columns go to the right, the first row is the zenith."""
    name: str
    notes: tuple[str, ...] = ()
    cleaned: Cleaned = dataclasses.field(default_factory=Cleaned)
    _prepared: dict[int, Texels] = dataclasses.field(default_factory=dict, repr=False)
    _shown: dict[tuple[View, Head, int], Frame] = dataclasses.field(default_factory=dict, repr=False)

    @classmethod
    def from_file(cls, file: HdrFile, cd_m2_per_unit: float, notes: tuple[str, ...]) -> Panorama:
        """The panorama in a file, at a scale."""
        about = f"{file.header.path.name}: an equirectangular panorama, it follows the head."
        rgb = file.rgb * np.float32(cd_m2_per_unit)
        return cls(rgb, f"panorama {file.header.path.name}", (about, *notes), file.cleaned)

    @property
    def cost(self) -> Cost:
        """Of a head that moves, with the glare of what lies beyond the view."""
        return Cost(20.0, 27.0)

    def view_for(self, width_px: int | None, height_px: int | None, fov_deg: float) -> View:
        """Any view."""
        return headset_view(width_px, height_px, fov_deg)

    def frame(self, t_s: float, view: View, head: Head, eyes: tuple[Eye, ...]) -> Frame:
        """The panorama from a head; it does not change with time."""
        seen = (view, head, count_eyes(eyes))
        if seen not in self._shown:
            image = _look(self._texels_for(view), view, jnp.asarray(rotation(head)))
            # The last frame alone: a head that rests sees the same array, so that nothing is done twice.
            self._shown.clear()
            self._shown[seen] = Frame(
                jnp.stack([image] * count_eyes(eyes)),
                view,
                self.cleaned,
                all_around_cd_m2=self._mean_cd_m2,
                surroundings=beyond(self._pieces, view, head),
            )
        return self._shown[seen]

    @functools.cached_property
    def _mean_cd_m2(self) -> float:
        luminance = np.tensordot(np.array(LUMINANCE_WEIGHTS, np.float32), self.rgb_cd_m2, 1).mean(1, dtype=np.float64)
        return float(np.average(luminance, weights=band_solid_angles(len(luminance))))

    @functools.cached_property
    def _pieces(self) -> Pieces:
        return pieces(self.rgb_cd_m2)

    def _texels_for(self, view: View) -> Texels:
        rows = min(self.rgb_cd_m2.shape[1], max(1, round(math.pi * view.focal_px)))
        if rows not in self._prepared:
            self._prepared.clear()  # one view at a time: a large panorama is hundreds of megabytes
            self._prepared[rows] = prepare(self.rgb_cd_m2, rows)
        return self._prepared[rows]


def pieces(rgb: np.ndarray) -> Pieces:
    """A panorama (3, y, 2y) in cells, and by themselves its brightest spots: what glare needs of it out of view."""
    solid_angles = 4 * math.pi * band_solid_angles(rgb.shape[1]) / rgb.shape[2]
    rows = min(SPOT_ROWS, rgb.shape[1])
    of_spots = area_mean(np.swapaxes(area_mean(rgb * solid_angles[:, None].astype(np.float32), 2 * rows), 1, 2), rows)
    lux = np.swapaxes(of_spots, 1, 2).astype(np.float64) * (rgb[0].size / (2 * rows * rows))
    steradians = np.repeat(4 * math.pi * band_solid_angles(rows)[:, None] / (2 * rows), 2 * rows, axis=1)
    cell = np.minimum(np.arange(rows) * CELL_ROWS // rows, CELL_ROWS - 1)
    cell_columns = np.minimum(np.arange(2 * rows) * CELL_ROWS // rows, 2 * CELL_ROWS - 1)
    index = (cell[:, None] * 2 * CELL_ROWS + cell_columns).ravel()

    def summed(values: np.ndarray) -> np.ndarray:
        return np.bincount(index, values.ravel(), 2 * CELL_ROWS**2)

    luminance = np.tensordot(LUMINANCE_WEIGHTS, lux, 1)
    mean = np.divide(
        summed(luminance), summed(steradians), where=summed(steradians) > 0, out=np.zeros(2 * CELL_ROWS**2)
    )
    stands_out = luminance / steradians > SPOT_RATIO * mean[index].reshape(luminance.shape)
    brightest = np.argsort(np.where(stands_out, luminance, 0).ravel(), kind="stable")[::-1][:SPOTS]
    brightest = brightest[stands_out.ravel()[brightest]]
    elevation = math.pi / 2 - (np.arange(rows) + 0.5) * math.pi / rows
    azimuth = ((np.arange(2 * rows) + 0.5) / rows - 1) * math.pi
    world = np.stack(
        np.broadcast_arrays(
            np.sin(azimuth) * np.cos(elevation)[:, None],
            np.sin(elevation)[:, None],
            np.cos(azimuth) * np.cos(elevation)[:, None],
        )
    ).reshape(3, -1)
    spots = world[:, brightest].T, lux.reshape(3, -1)[:, brightest].T, steradians.ravel()[brightest]
    rest = lux.reshape(3, -1).copy()
    rest[:, brightest] = 0
    towards = np.stack([summed(axis * steradians.ravel()) for axis in world], axis=1)
    filled = np.linalg.norm(towards, axis=1) > 0
    towards = towards[filled] / np.linalg.norm(towards[filled], axis=1, keepdims=True)
    cells = towards, np.stack([summed(of)[filled] for of in rest], axis=1), summed(steradians)[filled]
    return Pieces(*(np.concatenate([one, other]).astype(np.float32) for one, other in zip(spots, cells, strict=True)))


def beyond(of: Pieces, view: View, head: Head) -> Surroundings:
    """What of a panorama a view does not show; a piece on its edge in part, so that it comes and goes smoothly."""
    towards = of.towards @ rotation(head) * np.array([1, -1, 1], np.float32)
    radius = np.sqrt(of.steradians / np.float32(np.pi))
    share = np.clip(0.5 + outside_rad(towards, view) / (2 * radius), 0, 1)
    lit = share > 0
    return Surroundings(towards[lit], of.rgb_lx[lit] * share[lit, None], of.steradians[lit] * share[lit])


def prepare(rgb: np.ndarray, rows: int) -> Texels:
    """A panorama (3, y, 2y) with `rows` rows, no more than it has, that shorten towards the poles.

    The light from each band of latitude stays the same.
    """
    solid_angles = band_solid_angles(rgb.shape[1]).astype(np.float32)
    weighted = area_mean(np.swapaxes(rgb * solid_angles[:, None], 1, 2), rows)
    fewer = np.swapaxes(weighted / area_mean(solid_angles, rows), 1, 2)
    cosines = np.sin((np.arange(rows) + 0.5) * np.pi / rows)
    shares = np.where(cosines > WIDEST_ROW_COSINE, 1.0, cosines)
    columns = np.maximum(3, np.round(2 * rows * shares)).astype(np.int32)
    texels = np.zeros((3, rows, int(columns.max()) + 3), np.float32)
    for row, count in enumerate(columns):
        texels[:, row, : count + 3] = np.pad(area_mean(fewer[:, row], int(count)), ((0, 0), (1, 2)), mode="wrap")
    return Texels(jnp.asarray(texels), jnp.asarray(columns))


@functools.partial(jax.jit, static_argnames="view")
def _look(texels: Texels, view: View, axes: Float[Array, "3 3"]) -> Float[Array, "3 y x"]:
    right, up, forward = rays(view, axes)
    turn = jnp.arctan2(right, forward) / np.float32(2 * np.pi) + np.float32(0.5)
    rows = texels.columns.shape[0]
    height = (np.float32(0.5) - jnp.arctan2(up, jnp.hypot(right, forward)) / np.float32(np.pi)) * rows - np.float32(0.5)
    middle = jnp.round(height)
    image = jnp.zeros((3, view.height_px, view.width_px), jnp.float32)
    for down, row_weight in zip((-1, 0, 1), _spline(height - middle), strict=True):
        # Beyond a pole the last row is read again: it is three texels around the pole.
        row = jnp.clip(middle.astype(jnp.int32) + down, 0, rows - 1)
        place = turn * texels.columns[row].astype(jnp.float32) - np.float32(0.5)
        column = jnp.round(place)
        for across, weight in zip((-1, 0, 1), _spline(place - column), strict=True):
            image += (row_weight * weight) * texels.rgb_cd_m2[:, row, column.astype(jnp.int32) + (1 + across)]
    return image


def _spline(offset: Float[Array, "y x"]) -> tuple[Float[Array, "y x"], Float[Array, "y x"], Float[Array, "y x"]]:
    """Weights of the texel before, at and after, for an offset of −0.5…0.5 texels: they sum to 1."""
    before, after = np.float32(0.5) - offset, np.float32(0.5) + offset
    return before * before / 2, np.float32(0.75) - offset * offset, after * after / 2
