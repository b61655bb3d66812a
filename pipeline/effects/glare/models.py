"""Which point-spread function glare uses, as a mixture of prepared components."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from entoptic.described import DescribedEnum
from entoptic.pipeline.effects.glare.kernel import Component, Formula, Mixture, Veil, component
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import analytic, flare_lines, light_spectra, radial, whole
from entoptic.pipeline.optics.aperture import Pose, legal_pupil_diameter_mm
from entoptic.pipeline.optics.flare_lines import Flare
from entoptic.pipeline.optics.monochromatic import monochromatic as monochromatic
from entoptic.pipeline.optics.moving_kernel import moving_kernel

GRID = 2048
"""Samples along the pupil plane: the least power of two that resolves the lens fibres."""
PUPIL_STEP_MM = 0.25
"""Kernels are computed at these diameters and blended in between: a pupil in motion costs no FFT of its plane."""

IJSPEERT_VEIL_MM = 4.0
"""The pupil whose veil stands for all. Engineering choice: a middling one."""


class GlareModel(DescribedEnum):
    """Which point-spread function."""

    WAVE = (
        "wave",
        "Wave optics of this observer's pupil plane, CIE 135 beyond its field and for what it cannot resolve.",
    )
    SPE = "spe", "Spencer 1995: age and adaptation."
    CIE = "cie", "CIE 135 (Vos 2003): age and pigmentation."
    IJSPEERT = "ijspeert", "IJspeert 1993: age, pigmentation and the live pupil."


def mixture(model: GlareModel, observer: Observer, pose: Pose, adapted_cd_m2: float, pixels_per_deg: float) -> Mixture:
    """The kernel of an observer's eye as it stands, in a view of so many pixels per degree in its middle."""
    match model:
        case GlareModel.WAVE if pose.lens_m is not None:
            # A deformed lens is never the same again.
            return ((_moving(observer, pose, pixels_per_deg), 1.0),)
        case GlareModel.WAVE if not rests(observer, pose):
            return ((_posed(observer, pose, pixels_per_deg), 1.0),)
        case GlareModel.WAVE:
            return tuple(
                (_resting(observer, pupil_diameter_mm, pixels_per_deg), weight)
                for pupil_diameter_mm, weight in pupil_steps(pose.pupil_diameter_mm)
            )
        case GlareModel.IJSPEERT:
            straylight = analytic.STRAYLIGHT[observer.iris]
            # Beyond 4.5° the pupil changes it by 1e-4: one veil serves all.
            veil = Veil(analytic.ijspeert, (IJSPEERT_VEIL_MM, observer.age_years, straylight))
            return tuple(
                (
                    formula_component(
                        analytic.ijspeert, (pupil_diameter_mm, observer.age_years, straylight), pixels_per_deg, veil
                    ),
                    weight,
                )
                for pupil_diameter_mm, weight in pupil_steps(pose.pupil_diameter_mm)
            )
        case GlareModel.CIE:
            pigmentation = analytic.PIGMENTATION[observer.iris]
            return ((formula_component(analytic.cie135, (observer.age_years, pigmentation), pixels_per_deg), 1.0),)
        case GlareModel.SPE:
            weights = analytic.spe_weights(adapted_cd_m2, observer.age_years)
            return tuple(
                (part, float(weight))
                for part, weight in zip(_spe_components(pixels_per_deg, observer.seed), weights, strict=True)
                if weight > 0
            )


def pupil_steps(pupil_diameter_mm: float) -> tuple[tuple[float, float], ...]:
    """The computed pupils around a diameter in mm with their weights: two, or the one that it is.

    Diameters outside 2–8 mm count as the nearest of these, NaN as 2 mm.
    """
    low, share = divmod(legal_pupil_diameter_mm(pupil_diameter_mm), PUPIL_STEP_MM)
    pairs = ((low * PUPIL_STEP_MM, 1 - share / PUPIL_STEP_MM), ((low + 1) * PUPIL_STEP_MM, share / PUPIL_STEP_MM))
    return tuple((step_mm, weight) for step_mm, weight in pairs if weight > 0)


def wave_component(
    observer: Observer,
    pose: Pose,
    pixels_per_deg: float,
    *,
    grid: int = GRID,
    wavelengths: int | None = None,
    multi_plane: bool = False,
    double: bool = False,
) -> Component:
    """The kernel of an observer's eye by wave optics, from the spectra of the frame's primaries.

    One function at 575 nm of a `grid` × `grid` pupil plane, in float64 if `double`, serves all `wavelengths`, by
    default as many as pixels of this size need.
    """
    psf = monochromatic(observer, pose, grid, vitreous_apart=multi_plane, double=double)
    nm, weights = light_spectra.primary_weights(wavelengths or light_spectra.wavelengths_for(pixels_per_deg))
    veil = cie_veil(observer)
    kernel, share = whole.wave_kernel(psf, nm, weights, pixels_per_deg, *veil.parameters, scatter=observer.scatter)
    return component(kernel, veil, share)


@functools.lru_cache(maxsize=2)
def reference_kernel(
    observer: Observer, pose: Pose, pixels_per_deg: float, wavelengths: int | None = None
) -> tuple[NDArray[np.float64], Veil, float]:
    """The same kernel with an FFT in float64 for each wavelength, its veil and the veil's share: tens of seconds."""
    nm, weights = light_spectra.primary_weights(wavelengths or light_spectra.wavelengths_for(pixels_per_deg))

    def light(wavelength_nm: float) -> NDArray[np.float64]:
        return monochromatic(observer, pose, GRID, wavelength_nm=wavelength_nm, double=True)

    veil = cie_veil(observer)
    kernel, share = whole.fresh_wave_kernel(
        light, GRID, nm, weights, pixels_per_deg, *veil.parameters, scatter=observer.scatter
    )
    return kernel, veil, share


def cie_veil(observer: Observer) -> Veil:
    """CIE 135 beyond the kernel, for this age and pigmentation."""
    return Veil(analytic.cie135, (observer.age_years, analytic.PIGMENTATION[observer.iris]))


def rests(observer: Observer, pose: Pose) -> bool:
    """Whether the eye stands as this observer's does at rest, but for the pupil."""
    return pose.parts_at_rest and pose.openness >= 1 and not pose.lashes and pose.defocus_d == observer.defocus_d


@functools.lru_cache(maxsize=2)
def _posed(observer: Observer, pose: Pose, pixels_per_deg: float) -> Component:
    """The kernel of an eye that holds still, but not at rest: squinting. It has the pupil's own diameter: in an eye in
    motion those at other diameters would never serve again."""
    return _moving(observer, pose, pixels_per_deg)


def _moving(observer: Observer, pose: Pose, pixels_per_deg: float) -> Component:
    """The kernel of an eye in motion, made for it alone."""
    nm, weights = light_spectra.primary_weights(light_spectra.wavelengths_for(pixels_per_deg))
    make = moving_kernel(observer, pose, pupil_steps(pose.pupil_diameter_mm))
    kernel, share = make(nm, weights, pixels_per_deg)
    return component(kernel, cie_veil(observer), share)


@functools.lru_cache(maxsize=25)
def _resting(observer: Observer, pupil_diameter_mm: float, pixels_per_deg: float) -> Component:
    """All that a pupil of 2–8 mm needs."""
    return wave_component(observer, Pose(pupil_diameter_mm, observer.defocus_d), pixels_per_deg)


@functools.lru_cache(maxsize=25)
def formula_component(
    function: Formula, parameters: tuple[float, ...], pixels_per_deg: float, veil: Veil | None = None
) -> Component:
    """The kernel of a formula and its veil, its own unless given, alike for all colours."""
    own = Veil(function, parameters)
    veil = own if veil is None else veil
    return component(_near(own, pixels_per_deg), veil, radial.hemisphere_volume(veil.density))


def _near(veil: Veil, pixels_per_deg: float) -> NDArray[np.float64]:
    """What of a formula the veil leaves to the kernel."""

    def near(deg: NDArray[np.float64]) -> NDArray[np.float64]:
        return veil.function(deg, *veil.parameters) * (1 - whole.veil_part(deg))

    radius = whole.kernel_radius_px(pixels_per_deg)
    return radial.pixel_integrated(near, pixels_per_deg, radius, radius)


@functools.lru_cache(maxsize=4)
def _spe_components(pixels_per_deg: float, seed: int) -> tuple[Component, ...]:
    """SPE's f0 … f3: the scattering with one set of flare lines, the halo with another and with its colours."""
    radius = whole.kernel_radius_px(pixels_per_deg)
    corona = flare_lines.flare_lines(seed, Flare.CORONA, radius, radius)
    scattering = []
    for function in (analytic.f1, analytic.f2):
        veil = Veil(function)
        kernel = flare_lines.with_flare_lines(_near(veil, pixels_per_deg), corona)
        scattering.append(component(kernel, veil, radial.hemisphere_volume(veil.density)))
    core = formula_component(analytic.f0, (), pixels_per_deg)
    return (core, *scattering, component(_halo(pixels_per_deg, seed), None, 0.0))


def _halo(pixels_per_deg: float, seed: int) -> NDArray[np.float64]:
    """f3 from the spectra of the frame's primaries to each channel, with its flare lines and its luminance kept."""
    radius = whole.kernel_radius_px(pixels_per_deg)
    nm, weights = light_spectra.primary_weights()
    halo = np.empty((3, 3, 2 * radius + 1, 2 * radius + 1))
    for o, i in np.ndindex(3, 3):

        def ring(deg: NDArray[np.float64], of: NDArray[np.float64] = weights[:, o, i]) -> NDArray[np.float64]:
            return np.asarray(sum(w * analytic.f3(deg, wavelength) for w, wavelength in zip(of, nm, strict=True)))

        halo[o, i] = radial.pixel_integrated(ring, pixels_per_deg, radius, radius)
    lines = flare_lines.flare_lines(seed, Flare.HALO, radius, radius)
    luminance = np.einsum("o,oijk->jk", np.array(LUMINANCE_WEIGHTS), halo)
    return halo * lines * float(luminance.sum() / (luminance * lines).sum())
