"""What lights of their own take: 1 to 1000 of them, with five spectra, moving and blinking over a dark sea.

Frames of 1440×1600 pixels, glare at its default level, one eye. Numbers of lights take turns, frame by frame; each has
its own way and blinks at its own rate, so that no frame is like another. Prints a table of wall time.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.table import interleaved, show
from entoptic.pipeline import EyePose, Frame, Light, Planning, RenderState, View, perceive

VIEW = View(1440, 1600, 104.0)
COUNTS = (0, 1, 10, 100, 1000)
ROUNDS = 12
EYE = EyePose(pupil_diameter_mm=6.0)
SPECTRA = ("D65", "LED-B3", "HP1", "FL2", "A")


def lights(count: int, t_s: float) -> tuple[Light, ...]:
    """Within 45° of the axis."""
    random = np.random.default_rng(7)
    azimuth, elevation = random.uniform(-44, 44, count), random.uniform(-10, 10, count)
    speed, period_s, phase = random.uniform(-3, 3, count), random.uniform(0.5, 4, count), random.uniform(0, 1, count)
    lit = (t_s / period_s + phase) % 1 < 0.7
    return tuple(
        Light(
            float(azimuth[k] + speed[k] * t_s),
            float(elevation[k]),
            1e-3 if lit[k] else 0.0,
            spectrum=SPECTRA[k % len(SPECTRA)],
        )
        for k in range(count)
    )


def frame_with(count: int) -> Callable[[], object]:
    """Renders the next frame each time that it is called."""
    random = np.random.default_rng(1)
    sea = jnp.asarray(np.float32(0.003 * random.uniform(0.5, 1.5, (1, 3, VIEW.height_px, VIEW.width_px))))
    turn = itertools.count()

    def render() -> object:
        frame = Frame(sea, VIEW, lights=lights(count, 0.1 * next(turn)))
        seen = perceive(frame, EYE, planning=Planning(everything=True), state=RenderState((0.01,)))
        return jax.block_until_ready(seen.linear)

    return render


if __name__ == "__main__":
    times = interleaved({f"{count} lights": frame_with(count) for count in COUNTS}, ROUNDS)
    show("Lights of their own, 1440×1600, one eye, everything on", times, "1 lights")
