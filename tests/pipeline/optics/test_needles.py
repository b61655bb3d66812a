"""The corona's needles and the halo's rays: how strong they are, and what averages them out."""

import functools

import numpy as np
import pytest

from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.observer import Observer, ScatterShares
from entoptic.pipeline.optics import analytic, light_spectra, radial, whole
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.optics.diffraction import bin_deg
from entoptic.pipeline.optics.monochromatic import monochromatic

EYE = 30.0, 0.5
SMOOTH = Observer(scatter=ScatterShares(cornea=0.0, lens=0.0, vitreous=0.0))
PSF = functools.cache(monochromatic)


@functools.lru_cache(maxsize=4)
def white(
    pupil_diameter_mm: float, pixels_per_deg: float, count: int | None = None, observer: Observer = Observer()
) -> np.ndarray:
    """Luminance of a light of D65 in each pixel, of as many wavelengths as pixels of this size need."""
    count = light_spectra.wavelengths_for(pixels_per_deg) if count is None else count
    nm, rgb = light_spectra.light_weights("D65", count)
    luminance, psf = rgb @ np.array(LUMINANCE_WEIGHTS), PSF(observer, Pose(pupil_diameter_mm))
    return whole.wave_kernel(psf, nm, luminance, pixels_per_deg, *EYE, scatter=observer.scatter)[0]


def off_axis_deg(kernel: np.ndarray, pixels_per_deg: float) -> np.ndarray:
    y, x = (np.indices(kernel.shape) - len(kernel) // 2) / pixels_per_deg
    return np.asarray(np.hypot(x, y))


def in_ring(kernel: np.ndarray, pixels_per_deg: float, low_deg: float, high_deg: float) -> np.ndarray:
    """Pixels over the mean of all that lie as far out, to half a pixel."""
    away = off_axis_deg(kernel, pixels_per_deg)
    ring = (away > low_deg) & (away < high_deg)
    distance = np.rint(2 * away[ring] * pixels_per_deg).astype(int)
    means = np.bincount(distance, kernel[ring]) / np.maximum(np.bincount(distance), 1)
    return np.asarray(kernel[ring] / means[distance])


def contrast(kernel: np.ndarray, pixels_per_deg: float, low_deg: float, high_deg: float) -> float:
    return float(in_ring(kernel, pixels_per_deg, low_deg, high_deg).std())


def test_needles_stand_out_where_pixels_are_fine_and_average_out_where_they_are_wide() -> None:
    at = {ppd: contrast(white(3.0, ppd), ppd, 0.9, 1.1) for ppd in (60.0, 20.0, 5.0)}
    near = contrast(white(3.0, 60.0), 60.0, 0.45, 0.55)
    print(f"at 0.5° {near:.1%}, at 1° {at}")
    assert near >= 0.14
    assert at[60.0] > 1.3 * at[20.0] > 1.3 * 1.3 * at[5.0]
    assert at[5.0] < 0.05


def test_a_wide_pupil_has_finer_needles_that_average_out_more() -> None:
    narrow, wide = (contrast(white(mm, 60.0), 60.0, 0.45, 0.55) for mm in (3.0, 6.0))
    assert 0.06 < wide < 0.75 * narrow


def test_in_one_wavelength_the_particles_light_is_speckle_of_contrast_one() -> None:
    """Over a spectrum it is drawn out to needles; the retina's light and the taper's are smooth."""
    psf = PSF(Observer(gratings=0), Pose(5.0))
    away = off_axis_deg(psf, 1 / bin_deg(575.0))
    ring = psf[(away > 1.0) & (away < 1.01)]
    assert ring.std() / ring.mean() == pytest.approx(1, abs=0.05)


def test_the_retinas_light_is_smooth() -> None:
    textured, smooth = (contrast(white(3.0, 60.0, None, eye), 60.0, 0.45, 0.55) for eye in (Observer(), SMOOTH))
    assert smooth < 0.6 * textured


@pytest.mark.parametrize(
    "scatter",
    [ScatterShares(), ScatterShares(retina=0.0), ScatterShares(cornea=0.0, lens=1.0), SMOOTH.scatter],
    ids=["RIT", "no retina", "lens", "retina alone"],
)
def test_whatever_scatters_the_mean_is_cies(scatter: ScatterShares) -> None:
    """Of what fine particles and retina scatter: structures do theirs besides, RESOLVED of what RIT has for them."""
    bare = Observer(particles=0, cornea_cells=0, vitreous_particles=0, gratings=0, scatter=scatter)
    particles = scatter.cornea + scatter.lens + scatter.vitreous
    expected = 1 - 0.352 * particles / (particles + scatter.retina)
    kernel = white(4.0, 20.0, None, bare)
    away = off_axis_deg(kernel, 20.0)
    cie = radial.pixel_integrated(lambda deg: analytic.cie135(deg, *EYE), 20.0, len(kernel) // 2, len(kernel) // 2)
    for low, high in ((1.0, 1.5), (1.5, 2.5)):
        ring = (away > low) & (away < high)
        assert kernel[ring].sum() / cie[ring].sum() == pytest.approx(expected, abs=0.04), (low, high)


@pytest.mark.parametrize(
    ("part", "pose"),
    [
        ("lens", Pose(4.0, lens_m=np.full((17, 17), 3e-5) * np.linspace(0, 1, 17))),
        ("vitreous", Pose(4.0, vitreous_deg=(0.3, 0.0))),
    ],
)
def test_fine_particles_move_with_their_part(part: str, pose: Pose) -> None:
    bare = {"particles": 0, "cornea_cells": 0, "vitreous_particles": 0, "gratings": 0}
    changes = {}
    for one in ("cornea", "lens", "vitreous"):
        only = ScatterShares(**{**dict.fromkeys(("cornea", "lens", "vitreous"), 0.0), one: 0.5})
        still, moved = (monochromatic(Observer(**bare, scatter=only), at, 1024) for at in (Pose(4.0), pose))
        away = off_axis_deg(still, 1 / bin_deg(575.0))
        changes[one] = np.abs(moved - still)[away > 0.5].sum() / still[away > 0.5].sum()
    assert changes.pop(part) > 0.5
    assert max(changes.values()) < 5e-3


@pytest.mark.parametrize("pupil_diameter_mm", [4.0, 5.0, 6.0])
@pytest.mark.parametrize("pixels_per_deg", [10.0, 60.0])
def test_the_halo_is_a_closed_ring_of_fine_rays(pupil_diameter_mm: float, pixels_per_deg: float) -> None:
    kernel = white(pupil_diameter_mm, pixels_per_deg)
    of_ring = in_ring(kernel, pixels_per_deg, 2.8, 3.2)
    print(f"{pupil_diameter_mm} mm, {pixels_per_deg} px/°: contrast {of_ring.std():.2f}")
    assert 0.05 < of_ring.std() <= 0.4
    y, x = np.indices(kernel.shape) - len(kernel) // 2
    away = np.hypot(x, y) / pixels_per_deg
    ring = (away > 2.8) & (away < 3.2)
    sector = (np.degrees(np.arctan2(y, x))[ring] % 360 // 5).astype(int)
    around = np.bincount(sector, kernel[ring]) / np.bincount(sector)
    assert around.min() > 0.6 * around.mean(), "open"


@pytest.mark.parametrize("pixels_per_deg", [5.0, 10.0, 20.0, 35.0, 60.0])
def test_wavelengths_are_as_many_as_the_pixels_need(pixels_per_deg: float) -> None:
    """At the halo, where neighbouring copies lie furthest apart: against 128."""
    kernel, truth = (white(5.0, pixels_per_deg, count) for count in (None, 128))
    away = off_axis_deg(truth, pixels_per_deg)
    halo = (away > 2.5) & (away < 3.6)
    apart = kernel[halo] / truth[halo] - 1
    print(f"{pixels_per_deg}: {light_spectra.wavelengths_for(pixels_per_deg)} wavelengths, {apart.std():.2%}")
    assert np.sqrt((apart**2).mean()) < 0.01
    distance = np.rint(away[halo] * min(pixels_per_deg, 20.0)).astype(int)
    some = np.bincount(distance) > 0
    rings = np.bincount(distance, kernel[halo])[some] / np.bincount(distance, truth[halo])[some]
    assert np.abs(rings - 1).max() < 0.01
