"""The pictures of docs/adaptation.md: `python -m benchmarks.adaptation_plots docs`."""

from __future__ import annotations

import dataclasses
import functools
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from unittest import mock

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from entoptic.pipeline.effects import adaptation
from entoptic.pipeline.effects.adaptation import Adaptation, Bleaching, Course, Target, targets
from entoptic.pipeline.effects.adaptation.pigments import UNBLEACHED, threshold_in_the_dark_cd_m2
from entoptic.pipeline.frame import Frame, View
from entoptic.pipeline.measure import Measurement, luminance, measure
from entoptic.pipeline.scenes.discs import add_discs

VIEW = View(360, 400, 104.0)
RATE_HZ, LAMP_S = 60, 4.0
DARK_CD_M2, LAMP_CD_M2, LAMP_RADIUS_DEG = 0.05, 3e4, 0.15
"""A lamp of 0.3° over a dim street."""
WAYS = ((Target.LUI, Course.LUI), (Target.BAR_VIEW, Course.BAR))
HECHT_TD = (263.0, 1810.0, 3800.0, 19500.0, 39400.0, 400000.0)
"""Lights of Hecht, Haig & Chase 1937, before which an eye sat for two minutes."""


@dataclasses.dataclass(frozen=True)
class Seen:
    """A frame of the lamp's way."""

    tiles: Measurement
    samples: Measurement
    """The same with one pixel for each tile, in place of the mean."""


def main(folder: Path) -> None:
    """Draws the pictures."""
    _plot_lamp().savefig(folder / "adaptation-lamp.png", dpi=90)
    _plot_courses().savefig(folder / "adaptation-courses.png", dpi=90)
    _plot_dark().savefig(folder / "adaptation-dark.png", dpi=90)


def _plot_lamp() -> Figure:
    figure = Figure(figsize=(10, 5.6), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey="row")
    t_s = np.arange(int(LAMP_S * RATE_HZ)) / RATE_HZ
    for column, blinks in enumerate((False, True)):
        frames = crossing(blinks=blinks)
        for row, (target, course) in enumerate(WAYS):
            how, panel = Adaptation(target=target, course=course), axes[row][column]
            if target is Target.BAR_VIEW:
                panel.plot(t_s, exposures(frames, how, samples=True), lw=0.8, color="#999999", label="one pixel a tile")
            panel.plot(t_s, exposures(frames, how), color="#c8553d", label="means of tiles")
            panel.plot(t_s, exposures(frames, how, targets.LIMIT), color="#2a6fbb", label="means of tiles, robust")
            panel.set_title(f"target {target}, course {course}, {'blinking at 5 Hz' if blinks else 'steady'}", size=10)
            panel.set_ylabel("exposure / stops from 1/(cd/m²)" if column == 0 else "")
            panel.grid(alpha=0.3)
    axes[1][1].legend(frameon=False, fontsize=9, loc="lower left")
    figure.supxlabel("time / s: a lamp of 0.3° and 3e4 cd/m² crosses a view of 0.05 cd/m², 30° a second", fontsize=10)
    return figure


def _plot_courses() -> Figure:
    figure = Figure(figsize=(10, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    t_s = np.arange(0, 24, 1 / 24)
    for course, colour in zip(Course, ("#2a6fbb", "#999999", "#d99a1c", "#c8553d"), strict=True):
        how = Adaptation(course=course)
        eye, adapted, thresholds = adaptation.begin(0.01, how), [], []
        for t in t_s:
            eye = adaptation.step(eye, 1000.0 if 1 < t < 6 else 0.01, 1 / 24, how)
            adapted.append(eye.luminance_cd_m2)
            thresholds.append(eye.threshold_cd_m2(how))
        style = "--" if course is Course.OVERSHOOT else "-"
        left.semilogy(t_s, adapted, style, color=colour, label=course)
        right.semilogy(t_s, thresholds, style, color=colour, label=course)
    left.set_ylabel("adapted luminance / (cd/m²)")
    right.set_ylabel("threshold / (cd/m²)")
    for panel in (left, right):
        panel.grid(alpha=0.3)
    left.legend(frameon=False, title="course")
    figure.supxlabel(
        "time / s: 0.01 cd/m², from 1 s on 1000, from 6 s on 0.01 again, at 24 frames a second", fontsize=10
    )
    return figure


def _plot_dark() -> Figure:
    figure = Figure(figsize=(10, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    minutes = np.linspace(0, 40, 401)
    for trolands, shade in zip(HECHT_TD, np.linspace(0.75, 0.0, len(HECHT_TD)), strict=True):
        # Through a pupil of 2 mm, π mm².
        bleached = adaptation.step_pigments(UNBLEACHED, trolands / math.pi, 120.0, Bleaching.RUSHTON, 2.0)
        left.semilogy(
            minutes, _recovery(bleached, minutes, Bleaching.RUSHTON), color=str(shade), label=f"{trolands:g} td"
        )
    for luminance_cd_m2, shade in ((0.01, 0.75), (0.1, 0.5), (1.0, 0.3), (1000.0, 0.0)):
        bleached = adaptation.settled(luminance_cd_m2, Bleaching.PATTANAIK)
        recovery = _recovery(bleached, minutes, Bleaching.PATTANAIK)
        right.semilogy(minutes, recovery, color=str(shade), label=f"{luminance_cd_m2:g} cd/m²")
    left.set_ylabel("threshold / (cd/m²)")
    left.set_title("rushton, after two minutes of", size=10)
    right.set_title("pattanaik, after long in", size=10)
    for panel in (left, right):
        panel.set_xlabel("minutes in the dark")
        panel.legend(frameon=False, fontsize=8)
        panel.grid(alpha=0.3)
    return figure


def _recovery(bleached: adaptation.Pigments, minutes: np.ndarray, kind: Bleaching) -> list[float]:
    return [
        threshold_in_the_dark_cd_m2(adaptation.step_pigments(bleached, 0.0, 60 * t, kind), kind)
        for t in minutes.tolist()
    ]


def crossing(*, blinks: bool) -> list[Seen]:
    """The lamp from one side to the other, 30° a second; blinking at 5 Hz or not."""
    seen = []
    for t_s in np.arange(int(LAMP_S * RATE_HZ)) / RATE_HZ:
        lit = not blinks or (t_s * 5) % 1 < 0.5
        frame = _lamp(VIEW)(-60 + 30 * t_s, float(lit))
        tiles = measure(frame)[0]
        every = tiles.tile_px
        samples = np.asarray(luminance(frame.rgb_cd_m2[0]))[every // 2 :: every, every // 2 :: every]
        seen.append(Seen(tiles, dataclasses.replace(tiles, tile_mean_cd_m2=samples)))
    return seen


@functools.cache
def _lamp(view: View) -> Callable[[float, float], Frame]:
    """The lamp over the dark by its azimuth in degrees and its share of light."""
    dark = jnp.full((3, view.height_px, view.width_px), np.float32(DARK_CD_M2))
    radius_px = jnp.full(1, LAMP_RADIUS_DEG * view.ppd_centre)

    @jax.jit
    def draw(x_px: jax.Array, y_px: jax.Array, share: jax.Array) -> jax.Array:
        return add_discs(dark, x_px[None], y_px[None], radius_px, jnp.full((1, 3), LAMP_CD_M2 * share), 12)

    return lambda azimuth_deg, share: Frame(draw(*view.pixel_of(azimuth_deg, 3.0), share)[None], view)


def exposures(
    frames: Sequence[Seen], how: Adaptation, limit: float | None = None, *, samples: bool = False
) -> np.ndarray:
    """log2 of what luminances are multiplied by, frame after frame."""
    aims = [_target(seen.samples if samples else seen.tiles, how, limit) for seen in frames]
    eye, stops = adaptation.begin(aims[0], how), []
    for aim in aims:
        eye = adaptation.step(eye, aim, 1 / RATE_HZ, how)
        stops.append(math.log2(adaptation.exposure(eye.luminance_cd_m2)))
    return np.array(stops)


def _target(seen: Measurement, how: Adaptation, limit: float | None) -> float:
    if limit is None:
        return adaptation.target_cd_m2(seen, 0.0, 0.0, how)
    robust = Adaptation(target=how.target, robust=True)
    with mock.patch.object(targets, "LIMIT", limit):
        return adaptation.target_cd_m2(seen, 0.0, 0.0, robust)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
