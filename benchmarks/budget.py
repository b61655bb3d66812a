"""Frames within a budget: how many are in time, and what error is paid, beside the ladder's own front."""

from __future__ import annotations

import time

import jax.numpy as jnp
import numpy as np

from entoptic.pipeline import Effects, EyePose, Frame, Glare, GlareLevel, Perceived, Planning, View, perceive
from entoptic.pipeline.budget import SHIPPED, corrected
from entoptic.pipeline.cost.comparison import pareto
from entoptic.pipeline.scenes import Head, open_scene
from entoptic.services.process import prepare_jax
from entoptic.tracker_bridge.wire import Eye

BUDGETS_MS = (100.0, 33.0)
FRAMES, WARM_UP = 120, 20
PUPIL_MM = 5.1


def code_values(perceived: Perceived) -> np.ndarray:
    return perceived.image.astype(np.float64)


def main() -> None:
    """Prints both tables."""
    prepare_jax()
    view = View(1440, 1600, 104.0)
    scene = open_scene("night-street")
    frames = [scene.frame(3.0 + k / 4, view, Head(), (Eye.LEFT,)) for k in range(4)]
    truth = [perceive(frame, EyePose(pupil_mm=PUPIL_MM), planning=Planning(everything=True)) for frame in frames]

    print(
        "\n### The ladder, one eye, 1440×1600, night street\n\n"
        "| glare | acuity | night colour | ms | mean error, code values | on the front |\n|---|---|---|---:|---:|---|"
    )
    rungs = []
    for level in (None, GlareLevel.VEIL, GlareLevel.SOURCES, GlareLevel.WINDOW):
        for without in (set(), {"acuity"}, {"night_colour"}, {"acuity", "night_colour"}):
            left_out = frozenset(without | ({"glare"} if level is None else set()))
            effects = Effects() if level is None else Effects(glare=Glare(level=level))
            plan = Planning(everything=True, leave_out=left_out)
            rungs.append((level, without, effects, plan))
    points = []
    for _, _, effects, plan in rungs:
        times, errors = [], []
        for turn in range(5):
            k = turn % len(frames)
            begun = time.perf_counter()
            seen = perceive(frames[k], EyePose(pupil_mm=PUPIL_MM), effects=effects, planning=plan)
            times.append((time.perf_counter() - begun) * 1e3)
            errors.append(np.abs(code_values(seen) - code_values(truth[k])).mean())
        points.append((float(np.median(times[1:])), float(np.mean(errors))))
    front = set(pareto(points))
    for k, (level, without, _, _) in enumerate(rungs):
        on = ["" if effect in without else "yes" for effect in ("acuity", "night_colour")]
        print(
            f"| {'' if level is None else level.value} | {on[0]} | {on[1]} | {points[k][0]:.1f} | {points[k][1]:.2f} "
            f"| {'yes' if k in front else ''} |"
        )

    print(
        f"\n### Within a budget, the same frames, {FRAMES} of them after {WARM_UP}\n\n"
        "| budget ms | in time | median ms | 95 % within ms | mean error, code values | levels taken |\n"
        "|---:|---:|---:|---:|---:|---|"
    )
    for budget_ms in BUDGETS_MS:
        costs, state, times, errors, taken = SHIPPED, None, [], [], []
        for turn in range(WARM_UP + FRAMES):
            k = turn % len(frames)
            # A new array: a frame that did not change keeps its glare.
            frame = Frame(jnp.array(frames[k].rgb_cd_m2, copy=True), view)
            frame.rgb_cd_m2.block_until_ready()
            begun = time.perf_counter()
            seen = perceive(
                frame,
                EyePose(pupil_mm=PUPIL_MM),
                state=state,
                dt_s=1 / 24,
                planning=Planning(budget_ms=budget_ms),
                costs=costs,
            )
            took_ms = (time.perf_counter() - begun) * 1e3
            state, costs = seen.state, corrected(costs, seen.timings)
            if turn >= WARM_UP:
                times.append(took_ms)
                errors.append(np.abs(code_values(seen) - code_values(truth[k])).mean())
                taken.append(", ".join(f"{s.effect} {s.level}" for s in seen.plan if s.effect in LEAVABLE))
        most = max(set(taken), key=taken.count)
        print(
            f"| {budget_ms:g} | {np.mean(np.array(times) <= budget_ms):.0%} | {np.median(times):.1f} "
            f"| {np.percentile(times, 95):.1f} | {np.mean(errors):.2f} | {most} ({taken.count(most) / FRAMES:.0%}) |"
        )


LEAVABLE = ("glare", "acuity", "night_colour")

if __name__ == "__main__":
    main()
