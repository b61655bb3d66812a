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
    scatter, amplitude = observer.scatter, []
    places = []
    for part, share in enumerate((scatter.cornea, scatter.lens, scatter.vitreous)):
        random = np.random.default_rng([observer.seed, STREAM, part])
        match part:
            case 0:
                place = cornea.places_m(random, POINTS)
            case 1:
                place = lens.places_m(random, POINTS, pose.lens_m)
            case _:
                place = vitreous.places_m(random, POINTS, pose.vitreous_deg)
        places.append(np.stack(place))
        amplitude.append(math.sqrt(share) * np.exp(2j * np.pi * random.random(places[-1].shape[1])))
    x, y = np.concatenate(places, axis=1) / (PLANE_M / n) + m // 2
    inside = (np.abs(x - m // 2) < m // 2) & (np.abs(y - m // 2) < m // 2)
    x, y, of = x[inside], y[inside], np.concatenate(amplitude)[inside]
    column, row = x.astype(int), y.astype(int)
    right, down = x - column, y - row
    cells = [row * m + column + step for step in (0, 1, m, m + 1)]
    parts = [(1 - down) * (1 - right), (1 - down) * right, down * (1 - right), down * right]
    cell, light = np.concatenate(cells), np.concatenate([part * of for part in parts])
    box = np.empty((m, m), np.complex64)
    box.real = np.bincount(cell, light.real, m * m).reshape(m, m)
    box.imag = np.bincount(cell, light.imag, m * m).reshape(m, m)
    return box


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
    deg = np.hypot(index[:, None], index) * step_deg
    light = straylight.fine_density(deg, WAVELENGTH_NM, age_years, pigmentation, scatter) * math.radians(step_deg) ** 2
    light[deg > min(n, straylight.FIELD_SAMPLES) / 2 * bin_deg(WAVELENGTH_NM)] = 0
    total = float(light.sum())
    # A point between two samples has (2 + cos k)/3 of its light at k radians a sample, on average over its place.
    line = (2 + np.cos(2 * np.pi * index / size)) / 3
    return np.sqrt(light / (line[:, None] * line) / (total or 1.0)).astype(np.float32), total
