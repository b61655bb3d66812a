"""Making a glare kernel, beside the same formulas in plain NumPy and SciPy and every other way to sum wavelengths."""

from __future__ import annotations

import functools
from collections.abc import Callable

import jax
import numpy as np
import scipy.fft
import scipy.ndimage
import scipy.sparse

from benchmarks.table import interleaved, show
from entoptic.pipeline.frame import View
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import aperture, diffraction, light_spectra, spectrum
from entoptic.services.process import prepare_jax

Sums = Callable[[], np.ndarray]
LOG_POLAR = ((512, 1024), (1024, 2048), (2048, 4096))


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


def by_table(psf: np.ndarray, nm: np.ndarray, weights: np.ndarray, ppd: float, radius: int) -> np.ndarray:
    """Exact too: a summed-area table in float64 and four look-ups a corner."""
    n = len(psf)
    table = np.zeros((n + 1, n + 1))
    for row in range(n):
        np.add(table[row, 1:], psf[row], out=table[row + 1, 1:])
    np.cumsum(table, axis=1, out=table)
    kernel = np.zeros((*weights.shape[1:], 2 * radius + 1, 2 * radius + 1))
    for wavelength, of in zip(nm, weights, strict=True):
        at = (np.arange(2 * radius + 2) - radius - 0.5) / (ppd * diffraction.bin_deg(wavelength)) + n // 2 + 0.5
        at = np.clip(at, 0, n)
        low = np.minimum(at.astype(int), n - 1)
        share = at - low
        rows = table[low] * (1 - share)[:, None] + table[low + 1] * share[:, None]
        corners = rows[:, low] * (1 - share) + rows[:, low + 1] * share
        kernel += of[..., None, None] * np.diff(np.diff(corners, axis=0), axis=1)
    return kernel


def pixel_edges(n: int, nm: float, ppd: float, radius: int) -> np.ndarray:
    """Where pixels end, in samples from the first one's lower edge."""
    edges = (np.arange(2 * radius + 2) - radius - 0.5) / (ppd * diffraction.bin_deg(nm)) + n // 2 + 0.5
    return np.asarray(np.clip(edges, 0, n))


def shares_of(edges: np.ndarray, n: int, kind: np.dtype[np.floating]) -> np.ndarray:
    """Of n samples (rows) in pixels (columns)."""
    low = np.arange(n)[:, None]
    return np.asarray(np.clip(np.minimum(edges[1:], low + 1) - np.maximum(edges[:-1], low), 0, None), kind)


def weighed(light: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Wavelengths summed to channels by one matrix product."""
    flat = weights.reshape(len(light), -1).T.astype(light.dtype) @ light.reshape(len(light), -1)
    return np.asarray(flat.reshape(*weights.shape[1:], *light.shape[1:]))


def by_columns_table(psf: np.ndarray, nm: np.ndarray, weights: np.ndarray, ppd: float, radius: int) -> np.ndarray:
    """Exact: running sums down the columns in float64, looked up at pixel edges; then a matrix product."""
    n = len(psf)
    table = np.zeros((n + 1, n))
    for row in range(n):
        np.add(table[row], psf[row], out=table[row + 1])
    light = np.empty((len(nm), 2 * radius + 1, 2 * radius + 1), psf.dtype)
    for index, wavelength in enumerate(nm):
        edges = pixel_edges(n, wavelength, ppd, radius)
        low = np.minimum(edges.astype(int), n - 1)
        at_edges = table[low]
        at_edges += (edges - low)[:, None] * psf[low]
        bands = np.maximum(np.diff(at_edges, axis=0), 0).astype(psf.dtype)
        np.matmul(bands, shares_of(edges, n, psf.dtype), out=light[index])
    return weighed(light, weights)


def by_reduceat(psf: np.ndarray, nm: np.ndarray, weights: np.ndarray, ppd: float, radius: int) -> np.ndarray:
    """Exact: rows of samples added up between pixel edges by np.add.reduceat; then a matrix product."""
    n = len(psf)
    light = np.empty((len(nm), 2 * radius + 1, 2 * radius + 1), psf.dtype)
    for index, wavelength in enumerate(nm):
        edges = pixel_edges(n, wavelength, ppd, radius)
        low = np.minimum(edges.astype(int), n - 1)
        cut = (edges - low).astype(psf.dtype)[:, None] * psf[low]
        whole = np.add.reduceat(psf, low, axis=0)[:-1]
        # Of an empty range reduceat gives the row itself.
        whole[low[1:] == low[:-1]] = 0
        np.matmul(whole + cut[1:] - cut[:-1], shares_of(edges, n, psf.dtype), out=light[index])
    return weighed(light, weights)


def bilinear(rows: np.ndarray, columns: np.ndarray, shape: tuple[int, int]) -> scipy.sparse.csr_array:
    """For each point the weights of the four cells around it; points outside have none. Rows wrap around."""
    low_row, low_column = np.floor(rows).astype(np.int64), np.floor(columns).astype(np.int64)
    points, cells, shares = [], [], []
    for down in (0, 1):
        for right in (0, 1):
            share = np.abs(1 - down - (rows - low_row)) * np.abs(1 - right - (columns - low_column))
            at = low_column + right
            inside = (at >= 0) & (at < shape[1])
            points.append(np.flatnonzero(inside))
            cells.append((((low_row + down) % shape[0]) * shape[1] + at)[inside])
            shares.append(share[inside])
    data = np.concatenate(shares).astype(np.float32)
    places = (np.concatenate(points), np.concatenate(cells))
    return scipy.sparse.csr_array((data, places), shape=(rows.size, shape[0] * shape[1]))


def log_polar(
    psf: np.ndarray, nm: np.ndarray, weights: np.ndarray, ppd: float, radius: int, cells: tuple[int, int]
) -> Sums:
    """One convolution along ln r: scaling by the wavelength is a shift there.

    Light is moved from samples into (azimuth, ln r) cells; a Fourier transform along ln r times that of each channel's
    weights; then on to pixels. Where pixels are wider than samples, each sample's light goes into the four cells around
    it, and each cell's into the pixel in which it lies; else both moves are bilinear look-ups of the density. They are
    matrices that depend on the geometry alone, and their making is not counted.
    """
    n, k = len(psf), 2 * radius + 1
    azimuths, radii = cells
    # Room at both ends for the shifts: a discrete Fourier transform's convolution comes round.
    low, high = np.log(0.1 * nm[0] / nm[-1]), np.log(n / np.sqrt(2) * nm[-1] / nm[0])
    step = (high - low) / radii
    shifts = np.exp(-2j * np.pi * np.fft.rfftfreq(radii)[:, None] * np.log(nm / diffraction.WAVELENGTH_NM) / step)
    spectrum_of = (shifts @ weights.reshape(len(nm), -1)).T.astype(np.complex64)
    sample_px = ppd * diffraction.bin_deg(diffraction.WAVELENGTH_NM)
    angle = np.repeat(np.arange(azimuths), radii) * 2 * np.pi / azimuths
    away = np.tile(np.exp(low + step * np.arange(radii)), azimuths)
    if sample_px < 0.5:
        y, x = (axis.ravel() - n // 2 for axis in np.indices((n, n)))
        column = (np.log(np.maximum(np.hypot(x, y), 0.1)) - low) / step
        inward = scipy.sparse.csr_array(bilinear(np.arctan2(y, x) / (2 * np.pi) * azimuths, column, cells).T)
        down, right = (np.rint(away * sample_px * of(angle)).astype(int) + radius for of in (np.sin, np.cos))
        inside = (down >= 0) & (down < k) & (right >= 0) & (right < k)
        places = ((down * k + right)[inside], np.flatnonzero(inside))
        outward = scipy.sparse.csr_array((np.ones(inside.sum(), np.float32), places), shape=(k * k, angle.size))
    else:
        cell_samples = step * 2 * np.pi / azimuths
        at_row, at_column = (away * of(angle) + n // 2 for of in (np.sin, np.cos))
        area = away**2 * cell_samples * ((at_row > 0) & (at_row < n - 1))
        looked_up = bilinear(at_row, at_column, (n, n))
        inward = scipy.sparse.csr_array(scipy.sparse.diags_array(area.astype(np.float32)) @ looked_up)
        down, right = (axis.ravel() - radius for axis in np.indices((k, k)))
        away = np.maximum(np.hypot(down, right) / sample_px, 0.1)
        density = 1 / (away**2 * cell_samples * sample_px**2)
        points = bilinear(np.arctan2(down, right) / (2 * np.pi) * azimuths, (np.log(away) - low) / step, cells)
        outward = scipy.sparse.csr_array(scipy.sparse.diags_array(density.astype(np.float32)) @ points)

    def run() -> np.ndarray:
        there = scipy.fft.rfft((inward @ psf.ravel()).reshape(cells), axis=1, workers=2)
        channels = [
            outward @ scipy.fft.irfft(there * of, radii, axis=1, workers=2).astype(np.float32).ravel()
            for of in spectrum_of
        ]
        return np.stack(channels).reshape(*weights.shape[1:], k, k)

    return run


def main(rounds: int = 9) -> None:
    """Prints the tables, and how far each way of summing is from the exact sum."""
    prepare_jax()
    for n, rgb_only in ((2048, False), (1024, True)):
        plane = aperture.pupil_plane(Observer(gratings=0 if rgb_only else 200), aperture.Pose(5.0), n)
        host_plane, psf = np.asarray(plane), np.asarray(diffraction.point_spread(plane))
        sides = f"{n}×{n}"

        def plain_psf(of: np.ndarray = host_plane) -> np.ndarray:
            light = np.abs(scipy.fft.fftshift(scipy.fft.fft2(of, workers=2))) ** 2
            return np.asarray(light / light.sum())

        diffracted: dict[str, Callable[[], object]] = {
            f"SciPy: |FFT|² of a {sides} pupil plane": plain_psf,
            "here": lambda of=plane: jax.block_until_ready(diffraction.point_spread(of)),
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
            "NumPy: summed-area table": functools.partial(by_table, *task),
            "NumPy: running sums down the columns, matrix product": functools.partial(by_columns_table, *task),
            "NumPy: reduceat, matrix product": functools.partial(by_reduceat, *task),
            "NumPy: dense matrices": functools.partial(written_out, *task),
            **{f"log-polar, {a} azimuths × {r}": log_polar(*task, (a, r)) for a, r in LOG_POLAR},
            "here: sparse matrices by rows": functools.partial(spectrum.scaled_kernel, *task[:4], radius_px=radius),
        }
        timed: dict[str, Callable[[], object]] = {**ways}
        show(f"32 wavelengths over {title}", interleaved(timed, rounds), next(iter(ways)))
        exact = written_out(psf.astype(np.float64), nm, weights, ppd, radius)
        print("\n| | of the kernel's L2 norm off |\n|---|---:|")
        for name, way in ways.items():
            print(f"| {name} | {np.linalg.norm(way() - exact) / np.linalg.norm(exact):.1e} |")


if __name__ == "__main__":
    main()
