"""What skipping saves: frames as planned beside the same frames with everything in full."""

from __future__ import annotations

import numpy as np

from benchmarks.table import interleaved
from entoptic.pipeline import EyePose, Perceived, Planning, perceive
from entoptic.pipeline.cost.scenes import SCENES, scene
from entoptic.services.process import prepare_jax

PUPIL_MM = {"bright room": 3.0, "sunny landscape": 2.2, "sun disc": 2.0}
"""Of the scenes that make it small; 5.1 mm else."""


def main(rounds: int = 9) -> None:
    """Prints the table."""
    prepare_jax()
    print(
        "\n### Skipping, one eye, 1440×1600, kernel at hand\n\n"
        "| scene | planned ms | everything ms | share | what is left out | bound, code values |\n"
        "|---|---:|---:|---:|---|---:|"
    )
    for name in SCENES:
        frame = scene(name, 1440, 1600).frame
        eye = EyePose(pupil_mm=PUPIL_MM.get(name, 5.1))

        def seen(planning: Planning, frame=frame, eye=eye) -> Perceived:
            return perceive(frame, eye, planning=planning)

        ways = {"planned": lambda: seen(Planning()), "all": lambda: seen(Planning(everything=True))}
        for run in ways.values():
            run()
        times = {way: float(np.median(each)) for way, each in interleaved(ways, rounds).items()}
        plan = seen(Planning()).plan
        left = ", ".join(f"{step.effect} {step.level}" for step in plan if step.bound_code_values or not step.runs)
        print(
            f"| {name} | {times['planned']:.1f} | {times['all']:.1f} | {times['planned'] / times['all']:.2f} | {left} "
            f"| {plan.bound_code_values:.2g} |"
        )


if __name__ == "__main__":
    main()
