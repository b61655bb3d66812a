"""What planning saves and keeps: frames as planned beside everything in full, and frames within a budget."""

from __future__ import annotations

import time

import jax.numpy as jnp
import numpy as np

from benchmarks.table import interleaved
from entoptic.pipeline import EyePose, Frame, Perceived, Planning, View, perceive
from entoptic.pipeline.budget import SHIPPED, corrected
from entoptic.pipeline.cost.scenes import SCENES, scene
from entoptic.pipeline.scenes import Head, open_scene
from entoptic.services.process import prepare_jax
from entoptic.tracker_bridge.wire import Eye

PUPIL_MM = {"bright room": 3.0, "sunny landscape": 2.2, "sun disc": 2.0}
"""Of the scenes that make it small; USUAL_PUPIL_MM else."""
USUAL_PUPIL_MM = 5.1
EVERYTHING = Planning(everything=True)
BUDGETS_MS = (100.0, 33.0)
FRAMES, WARM_UP = 120, 20


def main(rounds: int = 9, frames: int = FRAMES) -> None:
    """Prints both tables."""
    prepare_jax()
    skipping(rounds)
    budgets(frames)


def skipping(rounds: int) -> None:
    """Every scene of the cost tables, planned and in full; and the same without what glare takes in either."""
    print(
        "\n### Skipping, one eye, 1440×1600, kernel at hand\n\n"
        "| scene | planned ms | everything ms | share | outside glare, ms | | share | what is left out "
        "| bound, code values |\n|---|---:|---:|---:|---:|---:|---:|---|---:|"
    )
    for name in SCENES:
        frame, eye = scene(name, 1440, 1600).frame, EyePose(pupil_diameter_mm=PUPIL_MM.get(name, USUAL_PUPIL_MM))
        outside: dict[bool, list[float]] = {True: [], False: []}

        def seen(planning: Planning, frame: Frame = frame, eye: EyePose = eye) -> Perceived:
            return perceive(frame, eye, planning=planning)

        def timed(planning: Planning, outside: dict[bool, list[float]] = outside) -> None:
            parts = seen(planning).milliseconds
            outside[planning.everything].append(sum(ms for part, ms in parts.items() if part != "glare"))

        each_ms = interleaved({"planned": lambda: timed(Planning()), "all": lambda: timed(EVERYTHING)}, rounds)
        planned_ms, all_ms = (float(np.median(each)) for each in each_ms.values())
        planned_outside_ms, all_outside_ms = (float(np.median(outside[everything])) for everything in (False, True))
        plan = seen(Planning()).plan
        left = ", ".join(
            f"{step.effect} {step.level}"
            for step in plan
            if step.level != "off" and (step.bound_code_values or not step.runs)
        )
        print(
            f"| {name} | {planned_ms:.1f} | {all_ms:.1f} | {planned_ms / all_ms:.2f} | {planned_outside_ms:.1f} "
            f"| {all_outside_ms:.1f} | {planned_outside_ms / all_outside_ms:.2f} | {left} "
            f"| {plan.bound_code_values:.2g} |"
        )


def budgets(count: int) -> None:
    """How many frames of a night street are in time, and what error they pay beside everything in full."""
    view = View(1440, 1600, 104.0)
    street = open_scene("night-street")
    frames = [street.frame(3.0 + k / 4, view, Head(), (Eye.LEFT,)) for k in range(4)]
    eye = EyePose(pupil_diameter_mm=USUAL_PUPIL_MM)
    truth = [perceive(frame, eye, planning=EVERYTHING).image.astype(float) for frame in frames]
    print(
        f"\n### Within a budget, night street, {count} frames after {WARM_UP}\n\n"
        "| budget ms | in time | median ms | 95 % within ms | mean error, code values | levels taken |\n"
        "|---:|---:|---:|---:|---:|---|"
    )
    for budget_ms in BUDGETS_MS:
        costs, state = SHIPPED, None
        times, errors, taken = [], [], []
        for turn in range(WARM_UP + count):
            # A new array: a frame that did not change keeps its glare.
            frame = Frame(jnp.array(frames[turn % 4].rgb_cd_m2, copy=True), view)
            frame.rgb_cd_m2.block_until_ready()
            begun = time.perf_counter()
            seen = perceive(frame, eye, state=state, dt_s=1 / 24, planning=Planning(budget_ms=budget_ms), costs=costs)
            took_ms = (time.perf_counter() - begun) * 1e3
            state, costs = seen.state, corrected(costs, seen.timings)
            if turn >= WARM_UP:
                times.append(took_ms)
                errors.append(np.abs(seen.image.astype(float) - truth[turn % 4]).mean())
                taken.append(", ".join(f"{step.effect} {step.level}" for step in seen.plan if step.level != "off"))
        most = max(set(taken), key=taken.count)
        print(
            f"| {budget_ms:g} | {np.mean(np.array(times) <= budget_ms):.0%} | {np.median(times):.1f} "
            f"| {np.percentile(times, 95):.1f} | {np.mean(errors):.2f} | {most} ({taken.count(most) / count:.0%}) |"
        )


if __name__ == "__main__":
    main()
