"""Adaptation: what a frame's target costs, and what the limit on small bright lights does.

`python -m benchmarks.adaptation PANORAMA…` adds views of panoramas.
"""

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

from benchmarks.table import interleaved, show
from entoptic.pipeline.effects import adaptation
from entoptic.pipeline.effects.adaptation import Adaptation, Bleaching, Course, Target, targets
from entoptic.pipeline.frame import Frame, View
from entoptic.pipeline.measure import Measurement, luminance, measure
from entoptic.pipeline.scenes import Head, open_scene
from entoptic.pipeline.scenes.discs import add_discs
from entoptic.services.process import prepare_jax
from entoptic.tracker_bridge.wire import Eye

LIMITS = (10.0, 30.0, 100.0, 1000.0)
VIEW = View(360, 400, 104.0)
RATE_HZ, LAMP_S = 60, 4.0
DARK_CD_M2, LAMP_CD_M2, LAMP_RADIUS_DEG = 0.05, 3e4, 0.15
"""A lamp of 0.3° over a dim street."""
WAYS = ((Target.LUI, Course.LUI), (Target.BAR_VIEW, Course.BAR))


@dataclasses.dataclass(frozen=True)
class Seen:
    """A frame of the lamp's way."""

    tiles: Measurement
    samples: Measurement
    """The same with one pixel for each tile, in place of the mean."""


def main(rounds: int = 15) -> None:
    """Prints the tables."""
    prepare_jax()
    _show_times(rounds)
    _show_lamp()
    _show_views()


def _show_times(rounds: int) -> None:
    frame = open_scene("night-street").frame(3.0, View(1440, 1600, 104.0), Head(), (Eye.LEFT,))
    measured = measure(frame)[0]
    y = np.asarray(luminance(frame.rgb_cd_m2[0]), np.float64)

    def of_pixels() -> float:
        return float(np.exp(np.log(y + targets.FLOOR_CD_M2).mean()))

    parts: dict[str, Callable[[], object]] = {(numpy := "NumPy: geometric mean of all pixels, float64"): of_pixels}
    for target in Target:
        for robust in (False, True):
            how = Adaptation(target=target, robust=robust)
            name = f"target {target}{', robust' if robust else ''}"
            parts[name] = lambda how=how: adaptation.target_cd_m2(measured, 3.0, -2.0, how)  # type: ignore[misc]
    for kind in Bleaching:
        how = Adaptation(bleaching=kind)
        eye = adaptation.step(adaptation.begin(1e4, how), 0.01, 60.0, how)
        parts[f"step, bleaching {kind}"] = lambda how=how, eye=eye: adaptation.step(eye, 0.01, 0.01, how)  # type: ignore[misc]
    times = interleaved(parts, rounds)
    show("Adaptation of one eye, 1440×1600, night street", times, numpy)
    of_tiles = adaptation.target_cd_m2(measured, 0.0, 0.0, Adaptation(target=Target.KRI))
    print(f"\nGeometric mean of the night street: {of_pixels():.4g} of pixels, {of_tiles:.4g} of tiles.")


def _show_lamp() -> None:
    print("\n### A lamp crosses the view: stops of exposure\n")
    print("| target | course | limit | steady | 5 Hz | 5 Hz, within a blink |\n|---|---|---|---:|---:|---:|")
    crossings = [crossing(blinks=blinks) for blinks in (False, True)]
    for target, course in (*WAYS, (Target.KRI, Course.LUI)):
        how = Adaptation(target=target, course=course)
        rows = {"none": [exposures(seen, how) for seen in crossings]}
        if target is Target.BAR_VIEW:
            rows["none, one pixel a tile"] = [exposures(seen, how, samples=True) for seen in crossings]
        for limit in () if target is Target.KRI else LIMITS:
            rows[f"{limit:g}×"] = [exposures(seen, how, limit) for seen in crossings]
        for name, curves in rows.items():
            steady, blinking = curves
            spans = f"{np.ptp(steady):.2f} | {np.ptp(blinking):.2f} | {_within_a_blink(blinking):.3f}"
            print(f"| {target} | {course} | {name} | {spans} |")
    _show_borders()


def _within_a_blink(stops: np.ndarray) -> float:
    """The largest span within one period of 5 Hz, less what it rises or falls from its begin to its end."""
    period = RATE_HZ // 5
    return max(
        float(np.ptp(stops[at : at + period + 1] - np.linspace(stops[at], stops[at + period], period + 1)))
        for at in range(0, len(stops) - period, period)
    )


def _show_borders() -> None:
    """How much it matters where in its tiles a lamp stands."""
    view = View(1440, 1600, 104.0)
    places_deg = np.linspace(-1, 1, 41)
    for name, how in (("all of it", Adaptation()), ("robust", Adaptation(robust=True))):
        aims = [adaptation.target_cd_m2(measure(_lamp(view)(at, 1.0))[0], 0.0, 0.0, how) for at in places_deg.tolist()]
        print(f"\nOver two degrees of places at 1440×1600, {name}: {np.ptp(np.log2(aims)):.2f} stops")


def _show_views() -> None:
    print("\n### What a limit takes off the target `lui`, stops\n")
    print(f"| view | {' | '.join(f'{limit:g}×' for limit in LIMITS)} |\n|---|{'---:|' * len(LIMITS)}")
    for file in ("night-street", *sys.argv[1:]):
        scene = open_scene(file)
        for yaw_deg in (0.0,) if file == "night-street" else (0.0, 90.0, 180.0, 270.0):
            seen = measure(scene.frame(3.0, VIEW, Head(yaw_deg), (Eye.LEFT,)))[0]
            plain = _target(seen, Adaptation(), None)
            taken = [math.log2(plain / _target(seen, Adaptation(), limit)) for limit in LIMITS]
            print(f"| {Path(file).stem} {yaw_deg:g}° | {' | '.join(f'{stops:.2f}' for stops in taken)} |")


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
    main()
