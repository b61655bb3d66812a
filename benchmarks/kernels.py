"""Making a glare kernel, beside the same formula in plain NumPy and SciPy."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import scipy.fft
import scipy.ndimage

from benchmarks.table import interleaved, show
from pipeline import Observer, View
from pipeline.optics import aperture, diffraction, spectrum
from services.process import prepare_jax


def main(rounds: int = 9) -> None:
    """Prints the table."""
    prepare_jax()
    n, pixels_per_deg = 2048, View(1440, 1600, 104.0).ppd_centre
    structure = aperture.eye_structure(Observer(), n)
    plane = aperture.pupil_plane(structure, jnp.float32(5e-3), n)
    psf = diffraction.point_spread(plane)
    host_plane, host_psf = np.asarray(plane), np.asarray(psf)
    nm, weights = spectrum.rgb_of_white()
    radius = spectrum.kernel_radius_px(n, pixels_per_deg)
    offsets_deg = np.arange(-radius, radius + 1) / pixels_per_deg

    def plain_psf() -> np.ndarray:
        return np.abs(scipy.fft.fftshift(scipy.fft.fft2(host_plane, workers=2))) ** 2

    def plain_rgb() -> np.ndarray:
        kernel = np.zeros((3, 2 * radius + 1, 2 * radius + 1))
        for wavelength, rgb in zip(nm, weights, strict=True):
            at = offsets_deg / diffraction.bin_deg(wavelength) + n // 2
            rows, columns = np.meshgrid(at, at, indexing="ij")
            sampled = scipy.ndimage.map_coordinates(host_psf, [rows, columns], order=1)
            kernel += rgb[:, None, None] * sampled * (diffraction.WAVELENGTH_NM / wavelength) ** 2
        return kernel

    parts = {
        "SciPy: |FFT|² of the pupil plane": plain_psf,
        "monochromatic point-spread function": lambda: jax.block_until_ready(diffraction.point_spread(plane)),
        "SciPy: 32 wavelengths, sampled once a pixel": plain_rgb,
        "RGB kernel, 32 wavelengths, integrated over pixels": lambda: jax.block_until_ready(
            spectrum.rgb_kernel(psf, pixels_per_deg)
        ),
    }
    show(f"A kernel from a {n}×{n} pupil plane", interleaved(parts, rounds), "SciPy: |FFT|² of the pupil plane")


if __name__ == "__main__":
    main()
