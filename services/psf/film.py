"""The point-spread function of an eye in which everything moves, as a film and as a strip of its frames."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
from jaxtyping import UInt8
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from entoptic.pipeline.observer import OcularDynamics
from entoptic.pipeline.optics import ocular_dynamics
from entoptic.pipeline.optics.ocular_dynamics import SaccadeImpulse
from entoptic.pipeline.sinks.video import film
from entoptic.services.psf import sheets
from entoptic.services.psf.picture import displayed, radiance
from entoptic.services.psf.plots import DPI, show
from entoptic.services.psf.subject import Subject

FPS = 24.0
SIDE_PX, FIELD_DEG = 481, 9.0
STRIP = 8
"""Frames on the strip."""
SACCADE_EVERY_S, SACCADE_DEG = 0.8, 6.0
"""Engineering choice: people make two to three a second; at this pace the vitreous is seen to come back in between.
6° is the standard deviation of each direction's turn."""
BLINK_EVERY_S, BLINK_FROM_S, BLINK_S = 4.0, 1.2, 0.35
"""A blink lasts 300–400 ms (Luidolt 2020, 5.2.1); people blink every 3 to 6 s. The first is at 1.2 s, so that a short
film has one."""
_SACCADE_STREAM = 0x7361


def write(folder: Path, subject: Subject, seconds: float, progress: Callable[[int, int], None]) -> None:
    """psf.mp4 and psf_film.png: all that can move does, but squinting, which holds the lids where they are.

    Each frame shows how the light that gets in is spread; how much that is, the lids and the pupil say.
    """
    everything = OcularDynamics(
        microfluctuations=True, lens=True, vitreous=True, lids=True, lashes=True, hippus=True, squint=False
    )
    observer = msgspec.structs.replace(subject.observer, ocular_dynamics=everything)
    count = max(round(seconds * FPS), 1)
    ruler = _ruler(SIDE_PX)
    on_strip = {round(k * (count - 1) / max(STRIP - 1, 1)) for k in range(STRIP)}
    strip: list[tuple[str, Subject]] = []
    saccades = np.random.default_rng([observer.seed, _SACCADE_STREAM])
    state, mean_mm = ocular_dynamics.at_rest(observer), subject.pose.pupil_diameter_mm
    with film(folder / "psf.mp4", (SIDE_PX, SIDE_PX), FPS) as video:
        for number in range(count):
            t_s = number / FPS
            pose = ocular_dynamics.pose_of(state, observer, mean_mm, openness_at(t_s), measured=False)
            now = dataclasses.replace(subject, observer=observer, pose=pose)
            image = displayed(radiance(now, SIDE_PX, FIELD_DEG))
            video.write(np.where(ruler > 0, ruler, image).astype(np.uint8))
            if number in on_strip:
                mm = pose.pupil_diameter_mm
                words = f"{t_s:.2f} s · {mm:.2f} mm · {pose.defocus_d:+.2f} D · lids {pose.openness:.0%}"
                strip.append((words, now))
            state = ocular_dynamics.step(state, observer, 1 / FPS, mean_mm, _impulses(t_s, saccades))
            progress(number + 1, count)
    half = (len(strip) + 1) // 2
    rows = tuple(row for row in (tuple(strip[:half]), tuple(strip[half:])) if row)
    title = f"An eye in motion, {count} frames: pupil, focus, lens, vitreous, lids and lashes move"
    sheets.write(folder / "psf_film.png", sheets.Sheet(title, rows))


def openness_at(t_s: float) -> float:
    """How far the lids are open: 1, but for blinks, which close twice as fast as they open."""
    share = ((t_s - BLINK_FROM_S) % BLINK_EVERY_S) / BLINK_S
    if share >= 1:
        return 1.0
    closed = share * 3 if share < 1 / 3 else (1 - share) * 1.5
    return 1.0 - closed * closed * (3 - 2 * closed)


def _impulses(t_s: float, saccades: np.random.Generator) -> tuple[SaccadeImpulse, ...]:
    """The turns of the eye until the next frame."""
    if int((t_s + 1 / FPS) / SACCADE_EVERY_S) == int(t_s / SACCADE_EVERY_S):
        return ()
    right_deg, up_deg = np.clip(saccades.normal(0, SACCADE_DEG, 2), -20, 20)
    return (SaccadeImpulse(float(right_deg), float(up_deg)),)


def _ruler(side_px: int) -> UInt8[np.ndarray, "k k 3"]:
    """Scale bar and rings on black, to be laid over every frame."""
    figure = Figure(figsize=(side_px / DPI, side_px / DPI), dpi=DPI)
    canvas = FigureCanvasAgg(figure)
    show(figure.add_axes((0, 0, 1, 1)), np.zeros((side_px, side_px, 3), np.uint8), FIELD_DEG, rings=True)
    canvas.draw()  # type: ignore[no-untyped-call]  # matplotlib annotates little of it
    drawn = canvas.buffer_rgba()  # type: ignore[no-untyped-call]  # as above
    return np.asarray(drawn)[..., :3].copy()
