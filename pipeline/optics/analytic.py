"""Point-spread functions measured on people, as closed formulas of the angle θ in degrees, in sr⁻¹.

Three sets, each of unit volume over the hemisphere:

spe       Spencer 1995, after Vos 1984: core f0, two scattering terms f1 and f2 and the lenticular halo f3; adaptation
          and age set their weights (SPE 3.1, eqs 5–10, with the errata E7 of the papers mended)
cie135    CIE 135/1 and Vos 2003, the total glare function: age and pigmentation
ijspeert  IJspeert 1993: age, pigmentation and the pupil's diameter

and, for a clear pupil, Airy's. Of each, the modulation transfer function over spatial frequencies ν in cycles per
degree. A scattering function of small angles lies in a plane, where its terms have these transforms, with k = 2πν:

    exp(−(r/w)²)       πw²·exp(−(kw)²/4)              1/(1+(r/a)²)^1.5    2πa²·exp(−ka)
    1/(r+c)²           2π[(π/2)S0 + x(1 − (π/2)S1)]   1/(1+(r/a)²)        2πa²·K0(ka)
    1/(r+c)³           2πk[(π/4)(S1 + xS0) − 1]       1/(1+(r/a)²)^0.5    2πa·exp(−ka)/k

x = kc, S = H − Y, the difference of Struve's and Bessel's second functions, which is what ∫J0(kr)/(r+c) dr comes to. At
frequencies below PLANE_CPD, whose period reaches over a good part of the hemisphere, the plane ends: there the
transforms are integrated numerically over the sphere.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from entoptic.pipeline.observer import Iris
from entoptic.pipeline.optics import radial

PHOTOPIC, MESOPIC, SCOTOPIC = (
    np.array([0.384, 0.478, 0.138, 0.0]),
    np.array([0.368, 0.478, 0.138, 0.016]),
    np.array([0.282, 0.478, 0.207, 0.033]),
)
"""Weights of f0 … f3 (SPE eqs 8–10)."""
PHOTOPIC_CD_M2, SCOTOPIC_CD_M2 = 3.0, 0.01
"""Adaptation above which only cones, below which only rods work (SPE 2.2)."""
SPE_CORE_DEG, SPE_OFFSET_DEG = 0.02, 0.02
"""Width of f0, and the angle that keeps f1 and f2 finite on the axis (SPE 3.1)."""
SPE_HALO_NM = 568.0
"""Wavelength at which the halo lies at 3° (SPE eq. 7, E7)."""

PIGMENTATION: dict[Iris, float] = {Iris.DARK: 0.0, Iris.BROWN: 0.5, Iris.GREEN: 1.0, Iris.BLUE: 1.2}
"""CIE 135's factor p (Vos 2003): 0 for very dark to 1.2 for very light eyes."""
STRAYLIGHT: dict[Iris, float] = {Iris.DARK: 0.056, Iris.BROWN: 0.106, Iris.GREEN: 0.142, Iris.BLUE: 0.16}
"""IJspeert's parameter m (IJspeert 1993): pigmented-skin dark brown, brown and blue Caucasian eyes. He gives none for
green eyes, between brown and blue; they have the population's mean."""

PLANE_CPD = 0.5
"""Frequency below which the plane's transforms are given up. Engineering choice: above it they are within 1e-4 of the
sphere's for all three sets."""

Angles = NDArray[np.float64]


def f0(deg: Angles) -> Angles:
    """The core."""
    return 2.61e6 * np.exp(-((deg / SPE_CORE_DEG) ** 2))


def f1(deg: Angles) -> Angles:
    """Narrow scattering."""
    return 20.91 / (deg + SPE_OFFSET_DEG) ** 3


def f2(deg: Angles) -> Angles:
    """Wide scattering."""
    return 72.37 / (deg + SPE_OFFSET_DEG) ** 2


def f3(deg: Angles, wavelength_nm: float = SPE_HALO_NM) -> Angles:
    """The lenticular halo, at 3° for 568 nm (E7: with 19.75 in the exponent its volume is 1)."""
    scale = wavelength_nm / SPE_HALO_NM
    return 436.9 / scale * np.exp(-19.75 * (deg - 3 * scale) ** 2)


def spe_weights(adapted_cd_m2: float, age_years: float) -> NDArray[np.float64]:
    """Weights of f0 … f3 for a state of adaptation and an age.

    SPE gives three states; between them the weights go linearly with the log of the luminance, so that nothing jumps.
    Age moves light from the core to the wide term in photopic vision (SPE eq. 10b), until at 86 years none is left.
    """
    moved = min(6.9e-9 * age_years**4, float(PHOTOPIC[0]))
    aged = PHOTOPIC + moved * np.array([-1.0, 0.0, 1.0, 0.0])
    low, high = math.log10(SCOTOPIC_CD_M2), math.log10(PHOTOPIC_CD_M2)
    position = np.clip((math.log10(max(adapted_cd_m2, 1e-12)) - low) / (high - low), 0, 1)
    stages = np.stack([SCOTOPIC, MESOPIC, aged])
    return np.array([np.interp(position, [0.0, 0.5, 1.0], stages[:, k]) for k in range(4)])


def spe(deg: Angles, adapted_cd_m2: float, age_years: float, wavelength_nm: float = SPE_HALO_NM) -> Angles:
    """SPE's whole function for a state of adaptation and an age."""
    weights = spe_weights(adapted_cd_m2, age_years)
    parts = (f0(deg), f1(deg), f2(deg), f3(deg, wavelength_nm))
    return np.asarray(sum(weight * part for weight, part in zip(weights, parts, strict=True)))


def cie135_printed(deg: Angles, age_years: float, pigmentation: float) -> Angles:
    """CIE 135/1's total glare function as printed (Vos 2003); its volume is near but not 1."""
    a4 = (age_years / 70) ** 4
    core, skirt, wide = 1 + (deg / 0.0046) ** 2, 1 + (deg / 0.045) ** 2, 1 + (deg / 0.1) ** 2
    return (
        (1 - 0.08 * a4) * (9.2e6 / (core * np.sqrt(core)) + 1.5e5 / (skirt * np.sqrt(skirt)))
        + (1 + 1.6 * a4) * (400 / wide + 3e-8 * deg**2 + pigmentation * (1300 / wide + 0.8) / np.sqrt(wide))
        + 2.5e-3 * pigmentation
    )


@functools.lru_cache(maxsize=256)
def cie135_volume(age_years: float, pigmentation: float) -> float:
    """Volume of the printed function over the hemisphere: 1.00–1.14 up to 70 years, 1.20 at 80 and light blue."""
    return radial.hemisphere_volume(lambda deg: cie135_printed(deg, age_years, pigmentation))


def cie135(deg: Angles, age_years: float, pigmentation: float) -> Angles:
    """CIE 135/1's total glare function, of unit volume. `pigmentation` as in PIGMENTATION."""
    return cie135_printed(deg, age_years, pigmentation) / cie135_volume(age_years, pigmentation)


def _ijspeert_terms(pupil_diameter_mm: float, age_years: float, straylight: float) -> list[tuple[float, float]]:
    """Share c and width β in radians of each of IJspeert's four terms: diffraction and aberrations, then scattering."""
    m, p, d = straylight, pupil_diameter_mm, 3.2
    ageing = 1 + (age_years / 70) ** 4
    near = 1 / (1 + ageing / (1 / m - 1))
    far = 1 / (1 + (1 / m - 1) / ageing)
    b, e = 9000 - 936 * math.sqrt(ageing), math.sqrt(ageing) / 2000
    narrow = far / ((1 + 25 * m) * (1 + 1 / ageing))
    return [
        (near / (1 + (p / d) ** 2), (1 + (p / d) ** 2) / (b * p)),
        (near / (1 + (d / p) ** 2), (1 + (d / p) ** 2) * (e - 1 / (b * p))),
        (narrow, 1 / (10 + 60 * m - 5 / ageing)),
        (far - narrow, 1.0),
    ]


def ijspeert(deg: Angles, pupil_diameter_mm: float, age_years: float, straylight: float) -> Angles:
    """IJspeert 1993's function. Pupils of 2–8 mm, his range; `straylight` is his m, as in STRAYLIGHT.

    Each term has unit volume over the hemisphere whatever its width, and their shares add up to 1.
    """
    sin2 = np.sin(np.radians(deg)) ** 2
    density = np.zeros_like(sin2)
    for share, width in _ijspeert_terms(pupil_diameter_mm, age_years, straylight):
        squared = sin2 + width**2 * (1 - sin2)
        density += share * width / (2 * math.pi * squared * np.sqrt(squared))
    return density


def diffraction_mtf(cpd: ArrayLike, pupil_diameter_mm: float, wavelength_nm: float) -> Angles:
    """Transfer function of a clear, focused pupil: 0 beyond the cut-off of D/λ cycles per radian."""
    cut_off_cpd = math.radians(1) * pupil_diameter_mm * 1e-3 / (wavelength_nm * 1e-9)
    share = np.minimum(np.asarray(cpd, np.float64) / cut_off_cpd, 1)
    return 2 / math.pi * (np.arccos(share) - share * np.sqrt(1 - share**2))


def spe_mtf(cpd: ArrayLike, adapted_cd_m2: float, age_years: float, wavelength_nm: float = SPE_HALO_NM) -> Angles:
    """Transfer function of SPE's whole function. The halo has no closed form: its part is always numerical."""
    weights = spe_weights(adapted_cd_m2, age_years)

    def plane(nu: Angles) -> Angles:
        k, c = 2 * math.pi * nu, SPE_OFFSET_DEG
        x = k * c
        s0, s1 = (special.struve(order, x) - special.yv(order, x) for order in (0, 1))
        core = 2.61e6 * math.pi * SPE_CORE_DEG**2 * np.exp(-((k * SPE_CORE_DEG) ** 2) / 4)
        narrow = 20.91 * 2 * math.pi * k * (math.pi / 4 * (s1 + x * s0) - 1)
        wide = 72.37 * 2 * math.pi * (math.pi / 2 * s0 + x * (1 - math.pi / 2 * s1))
        scattered = weights[0] * core + weights[1] * narrow + weights[2] * wide
        halo = weights[3] * radial.hankel(lambda deg: f3(deg, wavelength_nm), nu) if weights[3] else 0.0
        return radial.SR_PER_DEG2 * scattered + halo

    return _transfer(cpd, plane, lambda deg: spe(deg, adapted_cd_m2, age_years, wavelength_nm))


def cie135_mtf(cpd: ArrayLike, age_years: float, pigmentation: float) -> Angles:
    """Transfer function of CIE 135's total glare function."""
    a4 = (age_years / 70) ** 4

    def plane(nu: Angles) -> Angles:
        k = 2 * math.pi * nu
        sharp = 9.2e6 * 0.0046**2 * np.exp(-0.0046 * k) + 1.5e5 * 0.045**2 * np.exp(-0.045 * k)
        scatter = 400 * 0.1**2 * special.k0(0.1 * k)
        pigment = pigmentation * np.exp(-0.1 * k) * (1300 * 0.1**2 + 0.8 * 0.1 / k)
        printed = 2 * math.pi * ((1 - 0.08 * a4) * sharp + (1 + 1.6 * a4) * (scatter + pigment))
        return radial.SR_PER_DEG2 * printed / cie135_volume(age_years, pigmentation)

    return _transfer(cpd, plane, lambda deg: cie135(deg, age_years, pigmentation))


def ijspeert_mtf(cpd: ArrayLike, pupil_diameter_mm: float, age_years: float, straylight: float) -> Angles:
    """Transfer function of IJspeert's: Σ c·exp(−β·2πν) with ν in cycles per radian, 360 for ν in cycles per degree."""
    terms = _ijspeert_terms(pupil_diameter_mm, age_years, straylight)

    def plane(nu: Angles) -> Angles:
        return np.asarray(sum(share * np.exp(-360 * width * nu) for share, width in terms))

    return _transfer(cpd, plane, lambda deg: ijspeert(deg, pupil_diameter_mm, age_years, straylight))


def _transfer(cpd: ArrayLike, plane: Callable[[Angles], Angles], density: radial.Density) -> Angles:
    """The plane's closed form from PLANE_CPD on, the sphere's integral below."""
    frequencies = np.asarray(cpd, np.float64)
    result = np.array(plane(np.maximum(frequencies, PLANE_CPD)))
    low = frequencies < PLANE_CPD
    result[low] = radial.hankel(density, frequencies[low])
    return result
