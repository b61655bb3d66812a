"""A point of light as the retina gets it, for a display: light per steradian, its logarithm as lightness.

A point-spread function spans seven powers of ten and more, so its luminance is shown on a logarithmic scale, the same
for all pictures unless said otherwise; its chromaticity stays. What an sRGB display cannot show moves straight towards
white of the same luminance until it can.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
from jaxtyping import Float, UInt8
from numpy.typing import NDArray

from entoptic.pipeline.effects.encode import srgb_signal
from entoptic.pipeline.effects.glare.models import GlareModel
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import analytic, flare_lines, radial, spectrum
from entoptic.pipeline.optics.aperture import PUPIL_RANGE_MM, Pose
from entoptic.pipeline.optics.flare_lines import Flare
from entoptic.services.psf.subject import Subject


@dataclasses.dataclass(frozen=True)
class Scale:
    """From black to white, in powers of ten of the light per steradian."""

    low: float = -0.5
    high: float = 3.5

    def __str__(self) -> str:
        return f"{10**self.low:.2g} to {10**self.high:.4g} sr⁻¹, {self.high - self.low:g} decades"


SCALE = Scale()
"""Engineering choice: the veil at 4.5° is dark grey, the halo stands out, and the corona's brightest needles are
white."""


def radiance(subject: Subject, size_px: int, field_deg: float) -> Float[np.ndarray, "3 k k"]:
    """Linear RGB per steradian of a light of luminance 1, on a plane `field_deg` wide with the light in its middle.

    `size_px` is odd, so that the light lies in the middle of a pixel.
    """
    pixels_per_deg = size_px / field_deg
    if subject.model is GlareModel.SPE:
        return np.asarray(_spe(subject, size_px, pixels_per_deg) / math.radians(1 / pixels_per_deg) ** 2)
    light = _formula(_without_core(subject), size_px, pixels_per_deg)
    if subject.model is GlareModel.WAVE:
        nm, rgb = subject.light()
        weights = rgb * np.array([subject.core_share(float(at)) for at in nm])[:, None]
        # float32: half the time, and a picture has 256 steps.
        core = subject.core().astype(np.float32)
        light = light + np.asarray(spectrum.scaled_kernel(core, nm, weights, pixels_per_deg, radius_px=size_px // 2))
    return light / math.radians(1 / pixels_per_deg) ** 2


def _without_core(subject: Subject) -> Subject:
    """All of a subject that its formula depends on, so that pictures of one sheet need it once."""
    eye = subject.observer
    person = Observer(age_years=eye.age_years, iris=eye.iris, scatter=eye.scatter)
    pupil_diameter_mm = subject.pose.pupil_diameter_mm if subject.model is GlareModel.IJSPEERT else PUPIL_RANGE_MM[0]
    return dataclasses.replace(subject, observer=person, pose=Pose(pupil_diameter_mm))


@functools.lru_cache(maxsize=4)
def _formula(subject: Subject, size_px: int, pixels_per_deg: float) -> NDArray[np.float64]:
    nm, rgb = subject.light()

    def of_channel(deg: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(sum(weight * subject.formula(deg, float(at)) for weight, at in zip(weights, nm, strict=True)))

    radius = size_px // 2
    channels = (functools.partial(of_channel, weights=weights) for weights in rgb.T)
    return np.stack([radial.pixel_integrated(channel, pixels_per_deg, radius, radius) for channel in channels])


def _spe(subject: Subject, size_px: int, pixels_per_deg: float) -> NDArray[np.float64]:
    """SPE's core, and his corona and halo with the radial lines of each; its light is the formula's (SPE 3.2)."""
    nm, rgb = subject.light()
    weights = analytic.spe_weights(subject.adapted_cd_m2, subject.observer.age_years)
    radius = size_px // 2

    def over_pixels(density: radial.Density) -> NDArray[np.float64]:
        return radial.pixel_integrated(density, pixels_per_deg, radius, radius)

    def halo(deg: NDArray[np.float64], of: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(weights[3] * sum(w * analytic.f3(deg, float(at)) for w, at in zip(of, nm, strict=True)))

    white = rgb.sum(axis=0)[:, None, None]
    light: NDArray[np.float64] = white * over_pixels(lambda deg: np.asarray(weights[0] * analytic.f0(deg)))
    parts = {
        Flare.CORONA: white
        * over_pixels(lambda deg: np.asarray(weights[1] * analytic.f1(deg) + weights[2] * analytic.f2(deg))),
        Flare.HALO: np.stack([over_pixels(functools.partial(halo, of=of)) for of in rgb.T]),
    }
    for flare, part in parts.items():
        lines = flare_lines.flare_lines(subject.observer.seed, flare, radius, radius)
        luminance = np.einsum("c,cyx->yx", np.array(LUMINANCE_WEIGHTS), part)
        total = float((luminance * lines).sum())
        light = light + part * lines * (float(luminance.sum()) / total if total else 1.0)
    return light


def displayed(rgb_per_sr: Float[np.ndarray, "3 k k"], scale: Scale = SCALE) -> UInt8[np.ndarray, "k k 3"]:
    """sRGB code values."""
    to_luminance = np.array(LUMINANCE_WEIGHTS)
    luminance = np.maximum(np.einsum("c,cyx->yx", to_luminance, rgb_per_sr), 1e-30)
    lightness = np.clip((np.log10(luminance) - scale.low) / (scale.high - scale.low), 0, 1)
    grey = np.where(lightness <= 0.04045, lightness / 12.92, ((lightness + 0.055) / 1.055) ** 2.4)
    colour = (rgb_per_sr / luminance - 1) * grey
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(colour > 0, (1 - grey) / colour, np.where(colour < 0, -grey / colour, np.inf))
    linear = np.clip(grey + colour * np.minimum(room.min(axis=0), 1), 0, 1)
    return np.asarray(np.rint(srgb_signal(linear) * 255), np.uint8).transpose(1, 2, 0)
