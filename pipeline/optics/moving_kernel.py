"""The kernel of an eye in motion: what changes against the eye at rest, on a coarser pupil plane.

A kernel takes hundreds of milliseconds, and one of an eye in motion serves for one cells. But what moves is coarse:
particles of tens of µm, lids, focus. So each cells has only the change of the light within 1.9° worked out, on samples
twice as wide, transformed no wider than the pupil needs, and puts it on top of kernels of the eye at rest, which serve
again. What the fine samples are there for is taken from those as it is: the light further out, and the halo, which is
weighted by the fibres that the lids leave. Fibres lie along a radius, so their light goes to the right and left of it.

What this misses is in docs/optics.md, part by part.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import msgspec
import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import analytic, aperture, lens, spectrum, whole
from entoptic.pipeline.optics.aperture import PLANE_M, Pose
from entoptic.pipeline.optics.diffraction import power
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
BLUR_PX = 0.5
"""A resting eye's defocus is one of those whose blur discs differ by so many pixels. Engineering choice: the nearest is
within a quarter of a pixel."""


class _Rest(NamedTuple):
    """What an eye in motion takes over from one at rest with a certain pupil and focus."""

    beyond: NDArray[np.float64]
    """Its core without the fibres, less what the coarse plane has of that."""
    coarse_share: float
    """Of the light of that core, what the coarse plane has."""
    halo: NDArray[np.float64]
    """What the fibres add to what they leave of that core."""
    halo_share: float
    """Their share of the core's light."""
    fibres: Float[np.ndarray, " sector"]
    """How much of what is shown lies where fibres do, by the direction of their light."""


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


def moving_kernel(observer: Observer, pose: Pose, steps: Sequence[tuple[float, float]]) -> Kernel:
    """The kernels that whole.wave_kernel would give for this pose, as nearly as the docs say.

    `steps` are the diameters in mm of the pupils at rest that it starts from, with weights that add up to 1.
    """
    coarse_psf, shown = _coarse_psf(observer, pose), _fibres(observer, pose)
    eye = Straylight(observer.age_years, analytic.PIGMENTATION[observer.iris], observer.scatter)

    def kernel(
        nm: NDArray[np.float64],
        weights: NDArray[np.float64],
        pixels_per_deg: float,
        *,
        radius_px: int | None = None,
        wider: float = 1.0,
    ) -> tuple[NDArray[np.float64], float]:
        cells = Cells(tuple(nm.tolist()), weights.tobytes(), weights.shape, pixels_per_deg, radius_px, wider)
        rests = [
            (_rest(observer, mm, _nearest_focus_d(observer, pose.defocus_d, mm, pixels_per_deg), cells, eye), weight)
            for mm, weight in steps
        ]

        def mean(of: Callable[[_Rest], Any]) -> Any:
            return functools.reduce(np.add, [weight * of(rest) for rest, weight in rests])

        core, halo_share = mean(lambda rest: rest.beyond), float(mean(lambda rest: rest.halo_share))
        _add_inside(core, float(mean(lambda rest: rest.coarse_share)) * _coarse(coarse_psf, cells, eye))
        if halo_share:
            at_rest = mean(lambda rest: rest.fibres)
            gain = np.divide(shown, at_rest, out=np.zeros(SECTORS), where=at_rest > 0)
            core *= 1 - halo_share * float(shown.sum() / at_rest.sum())
            core += mean(lambda rest: rest.halo) * _around(gain, core.shape[-1])
        return whole.joined(core, FINE, cells, eye)

    return kernel


def _nearest_focus_d(observer: Observer, defocus_d: float, pupil_diameter_mm: float, pixels_per_deg: float) -> float:
    """One of few for each pupil, so that it serves again."""
    step_d = BLUR_PX * math.radians(1 / pixels_per_deg) / (pupil_diameter_mm * 1e-3)
    return observer.defocus_d + step_d * round((defocus_d - observer.defocus_d) / step_d)


@functools.lru_cache(maxsize=64)
def _rest(observer: Observer, pupil_diameter_mm: float, focus_d: float, cells: Cells, eye: Straylight) -> _Rest:
    pose, bare = Pose(pupil_diameter_mm, focus_d), _bare(observer)
    # By the light that passes: fibres take none, and add to it what they scatter.
    passed = power(aperture.pupil_box(bare, pose, FINE))
    halo_share = 1 - passed / power(aperture.pupil_box(observer, pose, FINE))
    coarse_share = power(aperture.pupil_box(bare, pose, COARSE)) * (FINE / COARSE) ** 2 / passed
    size = 2 * _size(pose) if cells.pixels_per_deg <= WIDE_PER_DEG else FINE
    beyond = whole.core_kernel(_fine_psf(bare, pose, size), cells, eye, FINE)
    halo = np.zeros(())
    if halo_share:
        halo = whole.core_kernel(_fine_psf(observer, pose, size), cells, eye, FINE) - (1 - halo_share) * beyond
    _add_inside(beyond, -coarse_share * _coarse(_coarse_psf(observer, pose), cells, eye))
    return _Rest(beyond, coarse_share, halo, halo_share, _fibres(observer, pose))


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


def _coarse(psf: Float[np.ndarray, "n n"], cells: Cells, eye: Straylight) -> NDArray[np.float64]:
    radius_px = min(spectrum.kernel_radius_px(COARSE, cells.pixels_per_deg), cells.reach_px)
    scale = cells.pixels_per_deg * COARSE / len(psf)
    of_core = whole.core_weights(FINE, cells, eye)
    return spectrum.scaled_kernel(psf, np.array(cells.nm), of_core, scale, taper=whole.FIELD_TAPER, radius_px=radius_px)


def _add_inside(kernel: NDArray[np.float64], inner: NDArray[np.float64]) -> None:
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
