"""A whole frame, 1440×1600, night street, everything called for: beside a convolution, and pfstools."""

from __future__ import annotations

import functools
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import scipy.fft

from benchmarks import pfstools
from benchmarks.table import interleaved, show
from entoptic.pipeline import Effects, EyePose, Frame, Glare, GlareLevel, Observer, Perceived, Planning, View, perceive
from entoptic.pipeline.effects.glare import mixture
from entoptic.pipeline.measure import measure
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.optics.whole import kernel_radius_px
from entoptic.pipeline.scenes import Head, open_scene
from entoptic.services.process import prepare_jax
from entoptic.tracker_bridge.wire import Eye

PUPIL_MM = 5.0
"""One that is computed: others are blended of two."""
STREET_S = 3.0
SMALL_PX = 64
EVERYTHING = Planning(everything=True)


def main(rounds: int = 9) -> None:
    """Prints the table, and what was planned."""
    prepare_jax()
    view, observer = View(1440, 1600, 104.0), Observer()
    frame = open_scene("night-street").frame(STREET_S, view, Head(), (Eye.LEFT,))
    host = np.asarray(frame.rgb_cd_m2[0])
    kernel = mixture(Glare().model, observer, Pose(PUPIL_MM), measure(frame)[0].mean_cd_m2, view.ppd_centre)

    def here(level: GlareLevel, planning: Planning) -> Perceived:
        # A frame without a state: of one that has not changed the last glare would serve again.
        return perceive(
            frame,
            EyePose(pupil_diameter_mm=PUPIL_MM),
            observer=observer,
            effects=Effects(glare=Glare(level=level)),
            planning=planning,
        )

    # What a convolution bloom costs at the least: a grey kernel, its transform at hand.
    grey = kernel[0][0].cells(view.ppd_centre, kernel_radius_px(view.ppd_centre), 1.0)[1, 1].astype(np.float32)
    sizes = [scipy.fft.next_fast_len(side + len(grey) - 1, real=True) for side in host.shape[1:]]
    transformed = scipy.fft.rfft2(grey, s=sizes, workers=2)

    def convolve_with_scipy() -> np.ndarray:
        light = scipy.fft.rfft2(host, s=sizes, workers=2)
        return np.asarray(
            scipy.fft.irfft2(light * transformed, s=sizes, workers=2)[:, : host.shape[1], : host.shape[2]]
        )

    plainly = "SciPy: 3-channel FFT convolution, whole frame"
    parts: dict[str, Callable[[], object]] = {
        plainly: convolve_with_scipy,
        **{
            f"here, everything, glare at {level.value}": functools.partial(here, level, EVERYTHING)
            for level in GlareLevel
        },
        "here, as planned": lambda: here(Glare().level, Planning()),
    }
    with tempfile.TemporaryDirectory() as folder:
        stream = Path(folder) / "frame.pfs"
        if absent := pfstools.missing():
            print(f"\nNo comparison with pfstools: {', '.join(absent)} not installed (Debian: pfstools).")
        else:
            print(f"\n{pfstools.version()}: each a process that reads the frame from a file and drops its result.")
            pfstools.as_pfs(host.transpose(1, 2, 0), stream)
            parts |= {name: functools.partial(pfstools.run_on, name, stream) for name in pfstools.OPERATORS}
        milliseconds = interleaved(parts, rounds)
    seen, planned = here(Glare().level, EVERYTHING), here(Glare().level, Planning())
    for name, each in (("Everything", seen), ("Planned", planned)):
        print(f"\n{name}: " + ", ".join(f"{step.effect} {step.level}" for step in each.plan))
        print(f"{name}, ms: " + ", ".join(f"{part} {ms:.0f}" for part, ms in each.milliseconds.items()))
    show("A whole frame, one eye, 1440×1600", milliseconds, plainly)
    host_alone()


def host_alone(frames: int = 240) -> None:
    """What the host takes: a film of frames so small that all else takes next to nothing, everything called for."""
    view, eye = View(SMALL_PX, SMALL_PX, 104.0), EyePose(pupil_diameter_mm=PUPIL_MM)
    still = open_scene("night-street").frame(STREET_S, view, Head(), (Eye.LEFT,))
    each_ms: dict[str, list[float]] = {}
    state = None
    for k in range(20 + frames):
        # A new array: a frame that did not change keeps its glare.
        frame = Frame(jnp.array(still.rgb_cd_m2, copy=True), view)
        begun = time.perf_counter()
        seen = perceive(frame, eye, state=state, dt_s=1 / 60)
        took_ms = (time.perf_counter() - begun) * 1e3
        state = seen.state
        if k >= 20:
            for part, ms in {"whole frame": took_ms, **seen.milliseconds}.items():
                each_ms.setdefault(part, []).append(ms)
    print(f"\n### The host alone, frames of {SMALL_PX}×{SMALL_PX} at 60 a second\n")
    print("| part | median ms | mean ms |\n|---|---:|---:|")
    for part, taken_ms in each_ms.items():
        print(f"| {part} | {np.median(taken_ms):.2f} | {np.mean(taken_ms):.2f} |")


if __name__ == "__main__":
    main()
