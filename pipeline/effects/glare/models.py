"""Which point-spread function glare uses, as a mixture of prepared parts."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, uniform_filter

from entoptic.described import DescribedEnum
from entoptic.pipeline.effects.glare.kernel import Formula, Mixture, Part, Veil
from entoptic.pipeline.effects.glare.passing import Passing
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import analytic, flare_lines, light_spectra, moving_kernel, radial, whole
from entoptic.pipeline.optics.aperture import Pose, legal_pupil_diameter_mm
from entoptic.pipeline.optics.flare_lines import Flare
from entoptic.pipeline.optics.monochromatic import monochromatic as monochromatic
from entoptic.pipeline.optics.moving_kernel import Kernel, Rest

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
    """The function of an observer's eye as it stands, for a view of so many pixels per degree in its middle."""
    match model:
        case GlareModel.WAVE:
            return wave_mixture(observer, pose, pixels_per_deg)
        case GlareModel.IJSPEERT:
            straylight = analytic.STRAYLIGHT[observer.iris]
            # Beyond 4.5° the pupil changes it by 1e-4: one veil serves all.
            veil = Veil(analytic.ijspeert, (IJSPEERT_VEIL_MM, observer.age_years, straylight))
            return tuple(
                (formula_part(analytic.ijspeert, (mm, observer.age_years, straylight), veil), weight)
                for mm, weight in pupil_steps(pose.pupil_diameter_mm)
            )
        case GlareModel.CIE:
            return ((formula_part(analytic.cie135, (observer.age_years, analytic.PIGMENTATION[observer.iris])), 1.0),)
        case GlareModel.SPE:
            weights = analytic.spe_weights(adapted_cd_m2, observer.age_years)
            return tuple(
                (part, float(weight))
                for part, weight in zip(_spe_parts(pixels_per_deg, observer.seed), weights, strict=True)
                if weight > 0
            )


def wave_mixture(observer: Observer, pose: Pose, pixels_per_deg: float, spectrum: str | None = None) -> Mixture:
    """The function by wave optics, of light with this spectrum, (3, 1), or of the frame's primaries, (3, 3)."""
    if not rests(observer, pose):
        return _moving(observer, pose, pixels_per_deg, spectrum)
    return tuple(
        (_resting(observer, mm, pixels_per_deg, spectrum), weight) for mm, weight in pupil_steps(pose.pupil_diameter_mm)
    )


def pupil_steps(pupil_diameter_mm: float) -> tuple[tuple[float, float], ...]:
    """The computed pupils around a diameter in mm with their weights: two, or the one that it is.

    Diameters outside 2–8 mm count as the nearest of these, NaN as 2 mm.
    """
    low, share = divmod(legal_pupil_diameter_mm(pupil_diameter_mm), PUPIL_STEP_MM)
    pairs = ((low * PUPIL_STEP_MM, 1 - share / PUPIL_STEP_MM), ((low + 1) * PUPIL_STEP_MM, share / PUPIL_STEP_MM))
    return tuple((step_mm, weight) for step_mm, weight in pairs if weight > 0)


def rests(observer: Observer, pose: Pose) -> bool:
    """Whether the eye stands as this observer's does at rest, but for the pupil."""
    return pose.parts_at_rest and pose.openness >= 1 and not pose.lashes and pose.defocus_d == observer.defocus_d


def cie_veil(observer: Observer) -> Veil:
    """CIE 135 beyond a part's cells, for this age and pigmentation."""
    return Veil(analytic.cie135, (observer.age_years, analytic.PIGMENTATION[observer.iris]))


def _moving(observer: Observer, pose: Pose, pixels_per_deg: float, spectrum: str | None) -> Mixture:
    """Of an eye that is not at rest: those at rest nearest to it, and what it adds to them."""
    at_rest = moving_kernel.rests(observer, pose, pupil_steps(pose.pupil_diameter_mm), pixels_per_deg)
    # A deformed lens is never the same again; an eye that squints holds still.
    change = _change if pose.lens_m is not None else _posed
    return (
        *(
            (_near(observer, rest.pupil_diameter_mm, rest.focus_d, pixels_per_deg, spectrum), rest.weight)
            for rest in at_rest
        ),
        (change(observer, pose, tuple(at_rest), pixels_per_deg, spectrum), 1.0),
    )


def _change(
    observer: Observer, pose: Pose, at_rest: Sequence[Rest], pixels_per_deg: float, spectrum: str | None
) -> Part:
    kernel = moving_kernel.change_kernel(observer, pose, at_rest, pixels_per_deg)
    part = _wave_part(kernel, observer, pixels_per_deg, spectrum)
    return Passing(part.cells, None, part.colour)


_posed = functools.lru_cache(maxsize=4)(_change)


@functools.lru_cache(maxsize=64)
def _near(
    observer: Observer, pupil_diameter_mm: float, focus_d: float, pixels_per_deg: float, spectrum: str | None
) -> Part:
    """Of an eye at rest that others move away from."""
    kernel = moving_kernel.resting_kernel(observer, pupil_diameter_mm, focus_d)
    return _wave_part(kernel, observer, pixels_per_deg, spectrum)


@functools.lru_cache(maxsize=64)
def _resting(observer: Observer, pupil_diameter_mm: float, pixels_per_deg: float, spectrum: str | None) -> Part:
    """All that a pupil of 2–8 mm needs, for two spectra and more."""
    return wave_part(observer, Pose(pupil_diameter_mm, observer.defocus_d), pixels_per_deg, spectrum=spectrum)


def wave_part(
    observer: Observer,
    pose: Pose,
    pixels_per_deg: float,
    *,
    spectrum: str | None = None,
    grid: int = GRID,
    wavelengths: int | None = None,
    multi_plane: bool = False,
    double: bool = False,
    fresh: bool = False,
) -> Part:
    """By wave optics: one function at 575 nm of a `grid` × `grid` pupil plane, in float64 if `double`, serves all
    `wavelengths`, by default as many as pixels of this size need. With `fresh` each has an FFT of its own, in float64.
    """

    def light(wavelength_nm: float) -> NDArray[np.float64]:
        return monochromatic(observer, pose, grid, wavelength_nm=wavelength_nm, double=True)

    def cells(
        nm: NDArray[np.float64],
        weights: NDArray[np.float64],
        pixels_per_deg: float,
        *,
        radius_px: int | None = None,
        wider: float = 1.0,
    ) -> tuple[NDArray[np.float64], float]:
        eye = cie_veil(observer).parameters
        reach: dict[str, Any] = {"radius_px": radius_px, "wider": wider, "scatter": observer.scatter}
        if fresh:
            return whole.fresh_wave_kernel(light, grid, nm, weights, pixels_per_deg, *eye, **reach)
        psf = _function(observer, pose, grid, multi_plane, double)
        return whole.wave_kernel(psf, nm, weights, pixels_per_deg, *eye, **reach)

    return _wave_part(cells, observer, pixels_per_deg, spectrum, wavelengths)


@functools.lru_cache(maxsize=2)
def _function(observer: Observer, pose: Pose, grid: int, multi_plane: bool, double: bool) -> NDArray[np.floating]:
    """Kept while a part is prepared, which takes it several times."""
    return monochromatic(observer, pose, grid, vitreous_apart=multi_plane, double=double)


def _wave_part(
    kernel: Kernel, observer: Observer, pixels_per_deg: float, spectrum: str | None, wavelengths: int | None = None
) -> Part:
    count = wavelengths or light_spectra.wavelengths_for(pixels_per_deg)
    nm, weights = (
        light_spectra.primary_weights(count) if spectrum is None else light_spectra.light_weights(spectrum, count)
    )

    def cells(per_deg: float, radius: int, wider: float) -> NDArray[np.float64]:
        found, _ = kernel(nm, weights, per_deg, radius_px=radius, wider=wider)
        return found if spectrum is None else found[:, None]

    return Part(cells, cie_veil(observer), None if spectrum is None else weights.sum(axis=0))


@functools.lru_cache(maxsize=32)
def formula_part(function: Formula, parameters: tuple[float, ...], veil: Veil | None = None) -> Part:
    """Of a formula and its veil, its own unless given, alike for all colours."""
    return Part(functools.partial(_formula_cells, function, parameters), veil or Veil(function, parameters))


def _formula_cells(
    function: Formula, parameters: tuple[float, ...], per_deg: float, radius: int, wider: float
) -> NDArray[np.float64]:
    def near(deg: NDArray[np.float64]) -> NDArray[np.float64]:
        return function(deg, *parameters) * (1 - whole.veil_part(deg, wider))

    return radial.pixel_integrated(near, per_deg, radius, radius)[None, None]


@functools.lru_cache(maxsize=4)
def _spe_parts(pixels_per_deg: float, seed: int) -> tuple[Part, ...]:
    """SPE's f0 … f3: the scattering with one set of flare lines, the halo with another and with its colours."""

    def with_flare(
        cells: Callable[[float, int, float], NDArray[np.float64]], flare: Flare
    ) -> Callable[..., NDArray[np.float64]]:
        def with_lines(per_deg: float, radius: int, wider: float) -> NDArray[np.float64]:
            lines = _lines(seed, flare, pixels_per_deg, per_deg, radius)
            return flare_lines.with_flare_lines(cells(per_deg, radius, wider), lines)

        return with_lines

    scattering = [
        Part(with_flare(functools.partial(_formula_cells, function, ()), Flare.CORONA), Veil(function))
        for function in (analytic.f1, analytic.f2)
    ]
    return formula_part(analytic.f0, ()), *scattering, Part(with_flare(_halo_cells, Flare.HALO), None)


def _lines(seed: int, flare: Flare, pixels_per_deg: float, per_deg: float, radius: int) -> NDArray[np.float64]:
    """Flare lines, drawn on pixels, over cells of any size."""
    size_px = pixels_per_deg / per_deg
    reach = math.ceil(radius * size_px) + 2
    lines = flare_lines.flare_lines(seed, flare, reach, reach)
    if size_px > 1:
        lines = uniform_filter(lines, round(size_px))
    at = np.arange(-radius, radius + 1) * size_px + reach
    return np.asarray(map_coordinates(lines, np.meshgrid(at, at, indexing="ij"), order=1))


def _halo_cells(per_deg: float, radius: int, wider: float) -> NDArray[np.float64]:
    """f3 from the spectra of the frame's primaries to each channel, its luminance kept."""
    nm, weights = light_spectra.primary_weights()
    halo = np.empty((3, 3, 2 * radius + 1, 2 * radius + 1))
    for o, i in np.ndindex(3, 3):

        def ring(deg: NDArray[np.float64], of: NDArray[np.float64] = weights[:, o, i]) -> NDArray[np.float64]:
            return np.asarray(sum(w * analytic.f3(deg, wavelength) for w, wavelength in zip(of, nm, strict=True)))

        halo[o, i] = radial.pixel_integrated(ring, per_deg, radius, radius)
    return halo
