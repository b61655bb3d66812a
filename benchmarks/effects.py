"""Each effect on one eye's 1440×1600 frame, beside SciPy's convolution of the same frame."""

from __future__ import annotations

import jax
import numpy as np
import scipy.fft

from benchmarks.table import interleaved, show
from entoptic.pipeline import EyePose, Glare, GlareLevel, GlareModel, Observer, RenderState, View, perceive
from entoptic.pipeline.effects import acuity, night_colour, tone
from entoptic.pipeline.effects.encode import srgb_codes
from entoptic.pipeline.effects.glare import Sight, mixture, scatter
from entoptic.pipeline.measure import measure
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.scenes import Head, open_scene
from entoptic.services.process import prepare_jax
from entoptic.tracker_bridge.wire import Eye


def main(rounds: int = 15) -> None:
    """Prints the table."""
    prepare_jax()
    view, observer, eyes = View(1440, 1600, 104.0), Observer(), (Eye.LEFT,)
    scene = open_scene("night-street")
    frame = scene.frame(3.0, view, Head(), eyes)
    rgb = frame.rgb_cd_m2
    measured = measure(frame)[0]

    def glare(settings: Glare) -> object:
        kernel = mixture(settings.model, observer, Pose(5.1), 0.05, view.ppd_centre)
        sight = Sight(view, measured, (720.0, 800.0), kernel, observer, Pose(5.1), 0.05)
        return wait(scatter(rgb[0], sight, settings))

    shown = tone.aces(rgb, np.array([0.3]), 100.0)
    state = RenderState((0.05,))
    host = np.asarray(rgb[0])
    kernel = np.asarray(mixture(GlareModel.CIE, observer, Pose(5.1), 0.05, view.ppd_centre)[0][0].scatters)[0]
    sizes = [scipy.fft.next_fast_len(n + kernel.shape[1] - 1, real=True) for n in host.shape[1:]]
    transformed = scipy.fft.rfft2(kernel, s=sizes, workers=2)

    def convolve_with_scipy() -> np.ndarray:
        light = scipy.fft.rfft2(host, s=sizes, workers=2)
        return scipy.fft.irfft2(light * transformed, s=sizes, workers=2)[:, : host.shape[1], : host.shape[2]]

    wait = jax.block_until_ready
    scipy_name = "SciPy: 3-channel FFT convolution, whole frame"
    parts = {
        scipy_name: convolve_with_scipy,
        "night street, one eye": lambda: wait(scene.frame(3.0, view, Head(), eyes).rgb_cd_m2),
        "measure": lambda: measure(frame),
        "glare, wave veil": lambda: glare(Glare(level=GlareLevel.VEIL)),
        "glare, wave sources": lambda: glare(Glare(level=GlareLevel.SOURCES)),
        "glare, wave window": lambda: glare(Glare()),
        "glare, wave frame": lambda: glare(Glare(level=GlareLevel.FRAME)),
        "glare, spe frame": lambda: glare(Glare(GlareModel.SPE, GlareLevel.FRAME)),
        "acuity": lambda: wait(acuity.dark_acuity(rgb)),
        "tone": lambda: wait(tone.aces(rgb, np.array([0.3]), 100.0)),
        "night colour": lambda: wait(night_colour.night_tint(shown, np.array([0.5]))),
        "encode": lambda: np.asarray(srgb_codes(shown, 0.0)),
        "whole frame, every effect called for": lambda: perceive(
            frame, EyePose(pupil_mm=5.1), observer=observer, state=state
        ),
    }
    show("One eye, 1440×1600, float32", interleaved(parts, rounds), scipy_name)


if __name__ == "__main__":
    main()
