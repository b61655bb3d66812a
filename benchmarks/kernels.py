"""Making a glare kernel, beside the same formulas in plain NumPy and SciPy."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import scipy.fft
import scipy.ndimage

from benchmarks.table import interleaved, show
from entoptic.pipeline.frame import View
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import aperture, diffraction, light_spectra, spectrum
from entoptic.services.process import prepare_jax

Sums = Callable[[], np.ndarray]


def sampled(psf: np.ndarray, nm: np.ndarray, weights: np.ndarray, ppd: float, radius: int) -> np.ndarray:
    """The papers' way: each wavelength looked up once in the middle of each pixel, bilinearly."""
    kernel = np.zeros((*weights.shape[1:], 2 * radius + 1, 2 * radius + 1))
    for wavelength, of in zip(nm, weights, strict=True):
        at = np.arange(-radius, radius + 1) / ppd / diffraction.bin_deg(wavelength) + len(psf) // 2
        rows, columns = np.meshgrid(at, at, indexing="ij")
        light = scipy.ndimage.map_coordinates(psf, [rows, columns], order=1)
        kernel += of[..., None, None] * light / (ppd * diffraction.bin_deg(wavelength)) ** 2
    return kernel


def written_out(psf: np.ndarray, nm: np.ndarray, weights: np.ndarray, ppd: float, radius: int) -> np.ndarray:
    """The exact formula in dense matrices: shares of samples in pixels from the left and the right."""
    kernel = np.zeros((*weights.shape[1:], 2 * radius + 1, 2 * radius + 1))
    for wavelength, of in zip(nm, weights, strict=True):
        sample = ppd * diffraction.bin_deg(wavelength)
        low = (np.arange(len(psf)) - len(psf) // 2 - 0.5) * sample
        pixel = (np.arange(2 * radius + 1) - radius - 0.5)[:, None]
        shares = np.clip(np.minimum(low + sample, pixel + 1) - np.maximum(low, pixel), 0, None) / sample
        shares = shares.astype(psf.dtype)
        kernel += of[..., None, None] * (shares @ psf @ shares.T)
    return kernel


def main(rounds: int = 9) -> None:
    """Prints the tables, and how far each way of summing is from the exact sum."""
    prepare_jax()
    for n, rgb_only in ((2048, False), (1024, True)):
        plane = aperture.pupil_plane(Observer(gratings=0 if rgb_only else 9000), aperture.Pose(5.0), n)
        host_plane, psf = np.asarray(plane), np.asarray(diffraction.point_spread(plane))
        sides = f"{n}×{n}"

        def plain_psf(of: np.ndarray = host_plane) -> np.ndarray:
            light = np.abs(scipy.fft.fftshift(scipy.fft.fft2(of, workers=2))) ** 2
            return np.asarray(light / light.sum())

        diffracted: dict[str, Callable[[], object]] = {
            f"SciPy: |FFT|² of a {sides} pupil plane": plain_psf,
            "here": functools.partial(diffraction.point_spread, plane),
        }
        show(f"Diffraction, {sides}", interleaved(diffracted, rounds), next(iter(diffracted)))

        if rgb_only:
            nm, weights = light_spectra.light_weights("D65")
            ppd, radius, title = 1 / diffraction.bin_deg(diffraction.WAVELENGTH_NM), n // 2, "its own samples, RGB"
        else:
            nm, weights = light_spectra.primary_weights()
            ppd = View(1440, 1600, 104.0).ppd_centre
            radius, title = spectrum.kernel_radius_px(n, ppd), f"pixels at {ppd:.2f} per degree, 3×3"
        task = (psf, nm, weights, ppd, radius)
        ways: dict[str, Sums] = {
            "SciPy: the papers' look-ups, one a pixel": functools.partial(sampled, *task),
            "NumPy: dense matrices": functools.partial(written_out, *task),
            "here: sparse matrices by rows": functools.partial(spectrum.scaled_kernel, *task[:4], radius_px=radius),
        }
        show(f"32 wavelengths over {title}", interleaved(ways, rounds), next(iter(ways)))
        exact = written_out(psf.astype(np.float64), nm, weights, ppd, radius)
        print("\n| | of the kernel's L2 norm off |\n|---|---:|")
        for name, way in ways.items():
            print(f"| {name} | {np.linalg.norm(way() - exact) / np.linalg.norm(exact):.1e} |")


if __name__ == "__main__":
    main()
