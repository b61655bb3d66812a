"""Glare of one eye's 1440×1600 frame at each level that lays kernels over pixels, beside the same formula in SciPy."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import scipy.fft

from benchmarks.table import interleaved, show
from entoptic.pipeline import Frame, Observer, View
from entoptic.pipeline.effects.glare import lights, sources, veil, window
from entoptic.pipeline.effects.glare.lights import PointKernel
from entoptic.pipeline.effects.glare.models import GlareModel, mixture, monochromatic
from entoptic.pipeline.frame import Light
from entoptic.pipeline.measure import measure
from entoptic.pipeline.optics import analytic, light_spectra, whole
from entoptic.pipeline.optics.aperture import Pose
from entoptic.services.process import prepare_jax


def main(rounds: int = 15) -> None:
    """Prints the table."""
    prepare_jax()
    view, observer, pupil_mm, gaze_px = View(1440, 1600, 104.0), Observer(), 5.1, (720.0, 800.0)
    kernel = mixture(GlareModel.WAVE, observer, Pose(pupil_mm), 1.0, view.ppd_centre)
    radius = kernel[0][0].scatters.shape[2] // 2
    night = np.random.default_rng(0).random((3, 1600, 1440), np.float32)
    lamps = night.copy()
    lamps[:, 100::400, 100::400] = 1e6
    street = night.copy()
    street[:, 100::100, 100::100] = 1e6
    frames = {name: jnp.asarray(frame) for name, frame in (("night", night), ("lamps", lamps), ("street", street))}
    about = {name: measure(Frame(frame[None], view))[0] for name, frame in frames.items()}

    # The same in SciPy: falloff, three FFTs each way and nine products, of a kernel already transformed.
    size = window.window_of(view, radius)
    corner = 800 - size.rows // 2, 720 - size.columns // 2
    seen = slice(corner[0], corner[0] + size.rows), slice(corner[1], corner[1] + size.columns)
    away = np.hypot(*np.mgrid[-size.rows / 2 + 0.5 : size.rows / 2, -size.columns / 2 + 0.5 : size.columns / 2])
    share = window.falloff(away / size.reach_px).astype(np.float32)

    def host_kernel(rows: int, columns: int) -> tuple[list[np.ndarray], list[float]]:
        padded = np.zeros((len(kernel), 3, 3, rows, columns), np.float32)
        side = 2 * radius + 1
        padded[..., :side, :side] = [np.asarray(part.scatters) for part, _ in kernel]
        rolled = np.roll(padded, (-radius, -radius), (3, 4))
        return list(scipy.fft.rfft2(rolled, workers=2)), [np.float32(weight) for _, weight in kernel]

    stays = np.asarray(
        sum(w * (np.asarray(part.stays) + np.eye(3) * part.veil_share) for part, w in kernel), np.float32
    )

    def plainly(light: np.ndarray, parts: list[np.ndarray], weights: list[float], shape: tuple[int, int]) -> np.ndarray:
        of_light = scipy.fft.rfft2(light, s=shape, workers=2)
        blend = sum(weight * part for weight, part in zip(weights, parts, strict=True))
        product = np.einsum("oiuv,iuv->ouv", blend, of_light)
        spread = scipy.fft.irfft2(product, s=shape, workers=2)[:, : light.shape[1], : light.shape[2]]
        return np.tensordot(stays - np.eye(3, dtype=np.float32), light, 1) + spread

    of_window = host_kernel(size.fft_rows, size.fft_columns)
    full = window.frame_window(view, radius)
    of_frame = host_kernel(full.fft_rows, full.fft_columns)

    def scipy_window() -> np.ndarray:
        result = night.copy()
        result[:, *seen] += plainly(night[:, *seen] * share, *of_window, (size.fft_rows, size.fft_columns))
        return result

    def scipy_frame() -> np.ndarray:
        return night + plainly(night, *of_frame, (full.fft_rows, full.fft_columns))

    @functools.cache
    def of_spectrum(name: str) -> lights.LightMixture:
        nm, weights = light_spectra.light_weights(name)
        rgb, _ = whole.wave_kernel(
            monochromatic(observer, Pose(5.0)),
            nm,
            weights,
            lights.SUBPIXELS * view.ppd_centre,
            observer.age_years,
            analytic.PIGMENTATION[observer.iris],
        )
        return ((PointKernel(rgb), 1.0),)

    shore = [Light(float(azimuth), 1.0, 1e-4, 0.02) for azimuth in np.linspace(-40, 40, 10)]
    wait = jax.block_until_ready

    def glared(name: str) -> jax.Array:
        return window.glare_window(frames[name], view, kernel, gaze_px, about[name])

    parts = {
        "SciPy: window": scipy_window,
        "window": lambda: wait(glared("night")),
        "window, 16 lamps too bright for float32": lambda: wait(glared("lamps")),
        "window, 210 lamps too bright for float32": lambda: wait(glared("street")),
        "veil": lambda: wait(veil.veil_change(frames["night"], view, kernel)),
        "window and veil": lambda: wait(
            window.glare_window(
                frames["night"],
                view,
                kernel,
                gaze_px,
                about["night"],
                onto=frames["night"] + veil.veil_change(frames["night"], view, kernel),
            )
        ),
        "sources, 16 pixels": lambda: wait(sources.glare_sources(frames["lamps"], kernel, about["lamps"])[0]),
        "sources, 128 pixels": lambda: wait(sources.glare_sources(frames["street"], kernel, about["street"])[0]),
        "10 lights of their own": lambda: wait(lights.draw_lights(frames["night"], shore, view, of_spectrum)),
        "SciPy: whole frame": scipy_frame,
        "frame": lambda: wait(window.glare_frame(frames["night"], view, kernel, about["night"])),
    }
    apart = np.abs(scipy_window() - np.asarray(glared("night"))).max()
    print(f"\nLargest difference between SciPy's window and ours, of light up to 1 cd/m²: {apart:.1e}")
    show("Glare of one eye, 1440×1600, 3×3 kernel of two pupils, float32", interleaved(parts, rounds), "SciPy: window")


if __name__ == "__main__":
    main()
