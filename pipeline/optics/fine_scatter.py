"""Particles too fine for the samples of the pupil plane: the light that follows CIE 135's curve, and its needles.

Particles of 0.7 µm make most of the straylight, each over tens of degrees, and their waves interfere (van den Berg,
Hagenouw, Coppens 2005). In one wavelength that is speckle as wide as λ/D; it scales with the wavelength as all that the
pupil plane does, so over a spectrum each speckle is drawn out to a needle. Nothing is put in of the needles' contrast:
pixels wider than λ/D and many wavelengths average it out.

Here the particles are points with a random phase, as they lie at all depths, in the cornea, in the lens and in the
vitreous, where they move as these do. Behind the pupil their field is weighted by the angle, so that its mean is
CIE's light, as much of it as the eye's larger structures and its retina leave.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from jaxtyping import Complex, Float

from entoptic.pipeline.observer import Observer, ScatterShares
from entoptic.pipeline.optics import analytic, aperture, cornea, diffraction, focus, lens, straylight, vitreous, whole
from entoptic.pipeline.optics.aperture import PLANE_M, Pose
from entoptic.pipeline.optics.diffraction import WAVELENGTH_NM, bin_deg

POINTS = 6000
"""Of each part, before the plane. Engineering choice: the narrowest pupil shows 300 of each."""
STREAM = 6
"""Which random stream is theirs; each part has one of its own within it."""


def points(observer: Observer, pose: Pose, n: int, wavelength_nm: float = WAVELENGTH_NM) -> Complex[np.ndarray, "m m"]:
    """The particles behind the pupil, on the same samples as aperture.pupil_box; complex64."""
    shown = aperture.opening(observer, pose, n)
    if pose.parts_at_rest:
        # Of all eyes with these shares and this seed.
        cloud = _resting(Observer(seed=observer.seed, scatter=observer.scatter), n)
        part = slice(n // 2 - len(shown) // 2, n // 2 + len(shown) // 2 + 1)
        box = np.asarray(cloud[part, part] * shown)
    else:
        box = _cloud(observer, pose, n, len(shown))
        box *= shown
    if pose.defocus_d:
        focus.turn(box, n, pose.defocus_d, pose.diameter_m, wavelength_nm)
    return box


@functools.lru_cache(maxsize=2)
def _resting(observer: Observer, n: int) -> Complex[np.ndarray, "k k"]:
    return _cloud(observer, Pose(aperture.PUPIL_RANGE_MM[1]), n, n + 1)


def _cloud(observer: Observer, pose: Pose, n: int, m: int) -> Complex[np.ndarray, "m m"]:
    """The middle m × m samples, m odd, of an n × n plane; each particle on the four samples around it."""
    places = [
        cornea.places_m((observer.seed, STREAM, 0), POINTS),
        lens.places_m((observer.seed, STREAM, 1), POINTS, pose.lens_m),
        vitreous.places_m((observer.seed, STREAM, 2), POINTS, pose.vitreous_deg),
    ]
    x, y = np.concatenate([np.stack(place) for place in places], axis=1) / (PLANE_M / n) + m // 2
    inside = (np.abs(x - m // 2) < m // 2) & (np.abs(y - m // 2) < m // 2)
    amplitude = _amplitudes(observer, tuple(len(of) for of, _ in places))[inside]
    x, y = x[inside], y[inside]
    column, row = x.astype(np.int64), y.astype(np.int64)
    right, down = (x - column).astype(np.float32), (y - row).astype(np.float32)
    box = np.zeros(m * m, np.complex64)
    for step, part in zip((0, 1, m, m + 1), ((0, 0), (0, 1), (1, 0), (1, 1)), strict=True):
        share = (down if part[0] else 1 - down) * (right if part[1] else 1 - right)
        np.add.at(box, row * m + column + step, share * amplitude)
    return box.reshape(m, m)


@functools.lru_cache(maxsize=4)
def _amplitudes(observer: Observer, counts: tuple[int, ...]) -> Complex[np.ndarray, " point"]:
    """Of each particle: its part's share, at a random phase."""
    shares = (observer.scatter.cornea, observer.scatter.lens, observer.scatter.vitreous)
    of = np.repeat(np.sqrt(shares), counts)
    turns = np.random.default_rng([observer.seed, STREAM, len(shares)]).random(len(of))
    return np.asarray(of * np.exp(2j * np.pi * turns), np.complex64)


def power(box: Complex[np.ndarray, "m m"]) -> float:
    """Of the points themselves: spread over four samples each has, on average over its place, 4/9 of it left."""
    return diffraction.power(box) * 9 / 4


def weighting(n: int, size: int, observer: Observer) -> tuple[Float[np.ndarray, "size size"], float]:
    """What the points' field of `size` × `size` samples, axis first, is weighted with, and their share of the light.

    The samples are those of an n × n plane whose lit part was transformed at that size. Weighted, points whose field
    has a mean power of 1 a sample have a light of 1 in all, with the shape of straylight.fine_density in a round field.
    """
    pigmentation = analytic.PIGMENTATION[observer.iris]
    weight, light = _weighting(n, size, observer.age_years, pigmentation, observer.scatter)
    of_core, *_ = whole.shares(
        WAVELENGTH_NM, min(n, straylight.FIELD_SAMPLES), observer.age_years, pigmentation, scatter=observer.scatter
    )
    return weight, light / of_core


@functools.lru_cache(maxsize=24)
def _weighting(
    n: int, size: int, age_years: float, pigmentation: float, scatter: ScatterShares
) -> tuple[Float[np.ndarray, "size size"], float]:
    step_deg = bin_deg(WAVELENGTH_NM) * n / size
    index = np.fft.fftfreq(size, 1 / size)
    # The root of a density that falls smoothly: linear between quarters of a sample.
    table = np.arange(4 * math.ceil(size / math.sqrt(2)) + 8) / 4
    light = straylight.fine_density(table * step_deg, WAVELENGTH_NM, age_years, pigmentation, scatter)
    light[table * step_deg > min(n, straylight.FIELD_SAMPLES) / 2 * bin_deg(WAVELENGTH_NM)] = 0
    root = np.interp(np.hypot(index[:, None], index), table, np.sqrt(light) * math.radians(step_deg))
    total = float(np.square(root).sum())
    # A point between two samples has (2 + cos k)/3 of its light at k radians a sample, on average over its place.
    line = np.sqrt((2 + np.cos(2 * np.pi * index / size)) / 3 * math.sqrt(total or 1.0))
    return (root / line[:, None] / line).astype(np.float32), total
