"""Whose eye, how it stands, and the light it looks at."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare.models import GRID, GlareModel
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import analytic, light_spectra, spectrum, whole
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.optics.monochromatic import monochromatic

Angles = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Subject:
    """A point of light, and the eye that looks at it."""

    observer: Observer
    pose: Pose
    model: GlareModel = GlareModel.WAVE
    adapted_cd_m2: float = 0.01
    """Adaptation, for SPE alone."""
    spectrum: str = "D65"
    """Name of the light's spectrum or a CSV file of it (light_spectra.py)."""
    wavelengths: int = light_spectra.WAVELENGTHS

    @property
    def pigmentation(self) -> float:
        """CIE 135's factor p of this iris."""
        return analytic.PIGMENTATION[self.observer.iris]

    def light(self) -> tuple[Angles, Angles]:
        """Wavelengths in nm, and the linear RGB that each contributes to the light (wavelength, 3), luminance 1."""
        return light_spectra.light_weights(self.spectrum, self.wavelengths)

    def luminous(self) -> tuple[Angles, Angles]:
        """Wavelengths in nm, and the share of the light's luminance that each makes."""
        nm, rgb = self.light()
        luminance = rgb @ np.array(LUMINANCE_WEIGHTS)
        return nm, luminance / luminance.sum()

    def core(self) -> Angles:
        """Wave optics of this eye at 575 nm, tapered to its round field, sum 1."""
        # A deformed lens is never the same again.
        make = _core if self.pose.lens_m is None else _core.__wrapped__
        return make(self.observer, self.pose)

    def formula(self, deg: Angles, nm: float) -> Angles:
        """The model's density in sr⁻¹ at a wavelength; for the wave model, what does not come from its core."""
        age = self.observer.age_years
        match self.model:
            case GlareModel.WAVE:
                far = whole.veil_part(deg)
                near = whole.beyond_core(
                    deg, (nm,), (1.0,), GRID, age, self.pigmentation, scatter=self.observer.scatter
                )
                return near * (1 - far) + analytic.cie135(deg, age, self.pigmentation) * far
            case GlareModel.CIE:
                return analytic.cie135(deg, age, self.pigmentation)
            case GlareModel.IJSPEERT:
                straylight = analytic.STRAYLIGHT[self.observer.iris]
                return analytic.ijspeert(deg, self.pose.diameter_m * 1e3, age, straylight)
            case GlareModel.SPE:
                return analytic.spe(deg, self.adapted_cd_m2, age, nm)

    def core_share(self, nm: float) -> float:
        """How much of a wavelength's light wave optics accounts for."""
        if self.model is not GlareModel.WAVE:
            return 0.0
        return whole.shares(nm, GRID, self.observer.age_years, self.pigmentation, scatter=self.observer.scatter)[0]


@functools.lru_cache(maxsize=2)
def _core(observer: Observer, pose: Pose) -> Angles:
    return np.asarray(spectrum.tapered(monochromatic(observer, pose, GRID), whole.FIELD_TAPER), np.float64)
