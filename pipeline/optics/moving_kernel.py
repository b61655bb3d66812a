"""The kernel of an eye in motion: those of the eye at rest, which serve again, and one of what the motion changes.

A kernel takes hundreds of milliseconds, and one of an eye in motion serves for one frame. But what moves is coarse:
particles of tens of µm, lids, focus. So each frame has only the change of the light within 1.9° worked out, on samples
twice as wide, transformed no wider than the pupil needs. What the fine samples are there for stays that of the eye at
rest: the light further out, and the halo, which is weighted by the fibres that the lids leave. Fibres lie along a
radius, so their light goes to the right and left of it.

What this misses is in docs/optics.md, part by part.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import msgspec
import numpy as np
import scipy.sparse
from jaxtyping import Float
from numpy.typing import NDArray

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import analytic, aperture, lens, spectrum, whole
from entoptic.pipeline.optics.aperture import PLANE_M, Pose
from entoptic.pipeline.optics.diffraction import bin_deg, power
from entoptic.pipeline.optics.monochromatic import monochromatic
from entoptic.pipeline.optics.whole import Cells, Straylight

FINE, COARSE = 2048, 1024
"""Samples along the plane of the eye at rest, and along that of what moves."""
SIZES = (256, 288, 320, 360, 400, 432, 480, 512, 540, 576, 600, 640, 675, 720, 768, 810, 864, 900, 960, 1024)
"""At which the lit part of the coarse plane is transformed; of the fine one, at twice that up to `WIDE_PER_DEG`."""
WIDE_PER_DEG = 12.0
"""Up to so many cells per degree the eye at rest too is transformed no wider than the pupil needs. Engineering choice:
wider, the samples would be as wide as a good part of a cell."""
ROOM = 1.12
"""How much wider than the pupil that is. Engineering choice: the light of pixels of 0.05° and more is then within 0.5 %
of that of any wider one; without room it is 2–4 % off, as samples fall onto Airy's dark rings."""
LID_SAMPLES, SECTORS = 256, 72
"""Of the plane on which the fibres are counted that the lids leave, and in how many directions."""
FINEST, CLOSEST, CLOSE_PX = 3, 12, 3
"""Of the cells over which the motion is worked out, so many along a pixel of the view; and close to the axis, so many
pixels to each side. As many as glare asks for: coarser cells close to a lamp are off by a fifth of its light there."""
SAME = 1e-6
"""Lids that change the fibres' light by less leave it as it is: rounding."""
BLUR_PX = 1.0
"""A resting eye's defocus is one of those whose blur discs differ by so many pixels. Engineering choice: the nearest is
within half a pixel; nearer ones gain nothing within 2° and 0.5 % of the halo."""


class Rest(NamedTuple):
    """An eye at rest that one in motion starts from."""

    pupil_diameter_mm: float
    focus_d: float
    weight: float
    """All weights add up to 1."""


class _Resting(NamedTuple):
    """What of its kernel is wave optics'."""

    bare: NDArray[np.float64]
    """Without the fibres."""
    halo: NDArray[np.float64]
    """What the fibres add to what they leave of that."""
    halo_share: float
    """Their share of the light."""
    coarse_share: float
    """Of the light without fibres, what the coarse plane has."""


class Kernel(Protocol):
    """An eye's kernels for light of any spectrum in cells of any size: whole.wave_kernel's arguments and results."""

    def __call__(
        self,
        nm: NDArray[np.float64],
        weights: NDArray[np.float64],
        pixels_per_deg: float,
        *,
        radius_px: int | None = None,
        wider: float = 1.0,
    ) -> tuple[NDArray[np.float64], float]:
        """The kernel and the veil's share."""
        ...


def rests(observer: Observer, pose: Pose, steps: Sequence[tuple[float, float]], pixels_per_deg: float) -> list[Rest]:
    """The eyes at rest nearest to a pose, for a view of so many pixels per degree: with pupils of these diameters in mm
    and weights, and at one of few focuses for each pupil, so that they serve again.
    """
    result = []
    for mm, weight in steps:
        step_d = BLUR_PX * math.radians(1 / pixels_per_deg) / (mm * 1e-3)
        away = step_d * round((pose.defocus_d - observer.defocus_d) / step_d)
        result.append(Rest(mm, observer.defocus_d + away, weight))
    return result


def resting_kernel(observer: Observer, pupil_diameter_mm: float, focus_d: float) -> Kernel:
    """Of an eye at rest, as `change_kernel` knows it."""
    eye = _straylight_of(observer)

    def kernel(
        nm: NDArray[np.float64],
        weights: NDArray[np.float64],
        pixels_per_deg: float,
        *,
        radius_px: int | None = None,
        wider: float = 1.0,
    ) -> tuple[NDArray[np.float64], float]:
        cells = Cells(tuple(nm.tolist()), weights.tobytes(), weights.shape, pixels_per_deg, radius_px, wider)
        known = _resting(observer, pupil_diameter_mm, focus_d, cells)
        return whole.joined((1 - known.halo_share) * known.bare + known.halo, FINE, cells, eye)

    return kernel


def change_kernel(observer: Observer, pose: Pose, rests: Sequence[Rest], view_per_deg: float) -> Kernel:
    """What a pose adds to the weighted kernels of eyes at rest, as nearly as the docs say; the veil has no part in it.

    For a view of `view_per_deg` pixels per degree, beside which finer cells are lit evenly.
    """
    psf, shown = _coarse_psf(observer, pose), _fibres(observer, pose)
    at_rest = mean_of([_fibres_at_rest(observer, rest.pupil_diameter_mm) for rest in rests], rests)
    gain = np.divide(shown, at_rest, out=np.ones(SECTORS), where=at_rest > 0)
    shown_share = float(shown.sum() / at_rest.sum()) if at_rest.any() else 1.0
    made: dict[Cells, Coarse] = {}

    def kernel(
        nm: NDArray[np.float64],
        weights: NDArray[np.float64],
        pixels_per_deg: float,
        *,
        radius_px: int | None = None,
        wider: float = 1.0,
    ) -> tuple[NDArray[np.float64], float]:
        cells = Cells(tuple(nm.tolist()), weights.tobytes(), weights.shape, pixels_per_deg, radius_px, wider)
        light = cells._replace(pixels_per_deg=view_per_deg, radius_px=None, wider=1.0)
        if light not in made:
            made[light] = Coarse(psf, light, observer)
        known = [_resting(observer, rest.pupil_diameter_mm, rest.focus_d, cells) for rest in rests]
        halo_share = float(mean_of([each.halo_share for each in known], rests))
        left = 1 - halo_share * shown_share
        before = [
            each.coarse_share * _coarse_at_rest(observer, Pose(rest.pupil_diameter_mm, rest.focus_d), light).over(cells)
            for each, rest in zip(known, rests, strict=True)
        ]
        coarse_share = float(mean_of([each.coarse_share for each in known], rests))
        result = np.zeros((*weights.shape[1:], *[2 * cells.reach_px + 1] * 2))
        add_inside(result, left * (coarse_share * made[light].over(cells) - mean_of(before, rests)))
        if halo_share and np.abs(gain - 1).max() > SAME:
            bare, halo = (mean_of([each[k] for each in known], rests) for k in range(2))
            add_inside(result, halo_share * (1 - shown_share) * bare + halo * (_around(gain, halo.shape[-1]) - 1))
        return result, 0.0

    return kernel


def mean_of(values: Sequence[Any], rests: Sequence[Rest]) -> Any:
    """Weighted as the eyes at rest are."""
    return functools.reduce(np.add, [rest.weight * value for value, rest in zip(values, rests, strict=True)])


class Coarse:
    """Light on the coarse plane, without fibres, over cells of any size: as if each of the finest were lit evenly.

    Worked out over FINEST cells a pixel, and over more of them close to the axis.
    """

    def __init__(self, psf: Float[np.ndarray, "n n"], light: Cells, observer: Observer) -> None:
        self._samples = spectrum.tapered(psf, whole.FIELD_TAPER)
        self._sample_scale = COARSE / len(psf)
        self._nm, self._of_core = np.array(light.nm), whole.core_weights(FINE, light, _straylight_of(observer))
        self._pixels_per_deg = light.pixels_per_deg
        self._made: dict[tuple[float, int], NDArray[np.float64]] = {}

    def over(self, cells: Cells) -> NDArray[np.float64]:
        """Its light in cells, as far as it goes."""
        reach = min(spectrum.kernel_radius_px(COARSE, cells.pixels_per_deg), cells.reach_px)
        asked = cells.pixels_per_deg, reach
        if asked not in self._made:
            close = (reach + 0.5) / asked[0] < (CLOSE_PX + 0.5 / CLOSEST) / self._pixels_per_deg * (1 + SAME)
            finest = self._close if close and asked[0] > FINEST * self._pixels_per_deg else self._all
            per_px = CLOSEST if finest is self._close else FINEST
            share = _overlaps(*asked, per_px * self._pixels_per_deg, finest.shape[-1] // 2)
            *channels, j, _ = finest.shape
            # (column, channel · row), then (row, channel · column).
            turned = np.ascontiguousarray(finest.reshape(-1, j, j).transpose(2, 0, 1)).reshape(j, -1)
            columns = (share @ turned).reshape(2 * reach + 1, -1, j)
            turned = np.ascontiguousarray(columns.transpose(2, 1, 0)).reshape(j, -1)
            rows = (share @ turned).reshape(2 * reach + 1, -1, 2 * reach + 1)
            self._made[asked] = np.ascontiguousarray(rows.transpose(1, 0, 2)).reshape(*channels, *[2 * reach + 1] * 2)
        return self._made[asked]

    @functools.cached_property
    def _all(self) -> NDArray[np.float64]:
        per_deg = FINEST * self._pixels_per_deg
        return self._summed(self._samples, per_deg, spectrum.kernel_radius_px(COARSE, per_deg))

    @functools.cached_property
    def _close(self) -> NDArray[np.float64]:
        # Only the samples that lie there at any wavelength.
        sample_deg = bin_deg(float(self._nm.min())) * self._sample_scale
        middle = len(self._samples) // 2
        half = min(math.ceil((CLOSE_PX + 1) / self._pixels_per_deg / sample_deg) + 1, middle)
        part = slice(middle - half, middle + half)
        inner = np.ascontiguousarray(self._samples[part, part])
        return self._summed(inner, CLOSEST * self._pixels_per_deg, CLOSEST * CLOSE_PX)

    def _summed(self, samples: Float[np.ndarray, "n n"], per_deg: float, radius: int) -> NDArray[np.float64]:
        scale = per_deg * self._sample_scale
        return spectrum.scaled_kernel(samples, self._nm, self._of_core, scale, radius_px=radius)


@functools.lru_cache(maxsize=32)
def _overlaps(per_deg: float, radius: int, finest_per_deg: float, finest_radius: int) -> scipy.sparse.csr_array:
    """Which share of each of the finest cells lies in each of others. Sparse, as BLAS would start threads for it."""
    edge, fine_edge = (
        (np.arange(2 * reach + 2) - reach - 0.5) / each
        for reach, each in ((radius, per_deg), (finest_radius, finest_per_deg))
    )
    last, first = np.minimum(edge[1:, None], fine_edge[1:]), np.maximum(edge[:-1, None], fine_edge[:-1])
    return scipy.sparse.csr_array(np.maximum(last - first, 0) * finest_per_deg)


@functools.lru_cache(maxsize=128)
def _resting(observer: Observer, pupil_diameter_mm: float, focus_d: float, cells: Cells) -> _Resting:
    pose, bare, eye = Pose(pupil_diameter_mm, focus_d), _bare(observer), _straylight_of(observer)
    halo_share, coarse_share = _passes(observer, pupil_diameter_mm)
    size = 2 * _size(pose) if cells.pixels_per_deg <= WIDE_PER_DEG else FINE
    without = whole.core_kernel(_fine_psf(bare, pose, size), cells, eye, FINE)
    halo = np.zeros_like(without)
    if halo_share:
        halo = whole.core_kernel(_fine_psf(observer, pose, size), cells, eye, FINE) - (1 - halo_share) * without
    return _Resting(without, halo, halo_share, coarse_share)


@functools.lru_cache(maxsize=32)
def _passes(observer: Observer, pupil_diameter_mm: float) -> tuple[float, float]:
    """The fibres' share of all light, and what of the light without them the coarse plane has."""
    pose, bare = Pose(pupil_diameter_mm), _bare(observer)
    # By the light that passes: fibres take none, and add to it what they scatter.
    passed = power(aperture.pupil_box(bare, pose, FINE))
    coarse_share = power(aperture.pupil_box(bare, pose, COARSE)) * (FINE / COARSE) ** 2 / passed
    return 1 - passed / power(aperture.pupil_box(observer, pose, FINE)), coarse_share


@functools.lru_cache(maxsize=32)
def _coarse_at_rest(observer: Observer, pose: Pose, finest: Cells) -> Coarse:
    return Coarse(_coarse_psf(observer, pose), finest, observer)


@functools.lru_cache(maxsize=32)
def _fibres_at_rest(observer: Observer, pupil_diameter_mm: float) -> Float[np.ndarray, " sector"]:
    return _fibres(observer, Pose(pupil_diameter_mm))


def _straylight_of(observer: Observer) -> Straylight:
    return Straylight(observer.age_years, analytic.PIGMENTATION[observer.iris], observer.scatter)


def _bare(observer: Observer) -> Observer:
    """Without fibres."""
    return msgspec.structs.replace(observer, gratings=0)


@functools.lru_cache(maxsize=8)
def _fine_psf(observer: Observer, pose: Pose, size: int) -> Float[np.ndarray, "size size"]:
    """Kept for cells of other sizes."""
    return monochromatic(observer, pose, FINE, size=size)


def _coarse_psf(observer: Observer, pose: Pose) -> Float[np.ndarray, "size size"]:
    """Without fibres, on the coarse plane."""
    return monochromatic(_bare(observer), pose, COARSE, size=_size(pose))


def _size(pose: Pose) -> int:
    """At which the lit part of the coarse plane is transformed."""
    wide = ROOM * pose.diameter_m / (PLANE_M / COARSE)
    return next((size for size in SIZES if size >= wide), COARSE)


def add_inside(kernel: NDArray[np.float64], inner: NDArray[np.float64]) -> None:
    """Adds a smaller kernel to a larger one in place."""
    margin = (kernel.shape[-1] - inner.shape[-1]) // 2
    part = slice(margin, kernel.shape[-1] - margin)
    kernel[..., part, part] += inner


def _fibres(observer: Observer, pose: Pose) -> Float[np.ndarray, " sector"]:
    """How much of the light that passes does so where fibres lie, by the direction in which they spread it.

    Fibres run along a radius, so they spread it at right angles to that, to both sides.
    """
    shown = np.square(aperture.opening(observer, pose, LID_SAMPLES).astype(np.float64))
    x = (np.arange(len(shown)) - len(shown) // 2) * PLANE_M / LID_SAMPLES
    outside = np.hypot(x[:, None], x) > lens.FIBRE_INNER_M
    place = np.round(np.arctan2(x[:, None], x) / (2 * np.pi) * SECTORS).astype(int) % SECTORS
    at = np.bincount(place[outside], shown[outside], SECTORS) / max(float(shown.sum()), 1e-12)
    return np.asarray(np.roll(at, SECTORS // 4) + np.roll(at, -SECTORS // 4))


def _around(gain: Float[np.ndarray, " sector"], k: int) -> Float[np.ndarray, "k k"]:
    """A function of the direction over a kernel, linear between sectors."""
    sector, beyond = _directions(k)
    return np.asarray(gain[sector] * (1 - beyond) + gain[(sector + 1) % SECTORS] * beyond)


@functools.lru_cache(maxsize=4)
def _directions(k: int) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    x = np.arange(k) - k // 2
    turn = np.arctan2(x[:, None], x) / (2 * np.pi) * SECTORS % SECTORS
    sector = turn.astype(int) % SECTORS
    return sector, turn - np.floor(turn)
