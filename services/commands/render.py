"""`entoptic render`: one HDR picture as a person perceives it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from entoptic.services.command_line import options
from entoptic.services.config import SettingsConfig, StillConfig
from entoptic.services.process import cache_folder, prepare_jax
from entoptic.services.terminal import console


@options
def render(
    image: Annotated[str, typer.Argument(help="HDR picture or panorama: .hdr or .exr.")],
    still: StillConfig,
    settings: SettingsConfig,
    output: Annotated[Path, typer.Option("--output", "-o", help="PNG file to write.")] = Path("perceived.png"),
    until: Annotated[
        str | None,
        typer.Option(
            metavar="EFFECT",
            help="Stop after this effect, as its name stands in the plan, and write the light there as EXR: linear "
            "Rec.709, float32, 1 = 1 cd/m². From tone mapping on that is the display's light.",
        ),
    ] = None,
) -> None:
    """Perceive one HDR image, and print the plan."""
    prepare_jax()
    from entoptic.pipeline.budget import load as load_costs
    from entoptic.pipeline.sinks.images import still_path, write_exr, write_still
    from entoptic.services import settings as all_settings
    from entoptic.services.explain import subject

    seen = subject.from_image(image, still, all_settings.of(settings))
    display = seen.settings.display
    subject.refuse_unwritable(output, ".exr" if until else still_path(output, display).suffix)
    for note in seen.notes:
        console.print(f"• {escape(note)}")
    costs = load_costs(cache_folder())
    if until:
        light, plan = seen.light_after(until, costs)
        write_exr(output, np.asarray(light[0]).transpose(1, 2, 0))
        step = plan[until]
        console.print(escape(f"{until} {step.level}: {step.reason}"))
        console.print(f"wrote [b]{escape(str(output))}[/b]: the light after {until}, 1 = 1 cd/m²", soft_wrap=True)
        return
    perceived = seen.perceived(costs)
    write_still(output, perceived.image[0], display)
    table = Table("effect", "level", "why", "hides at most", "ms")
    for step in perceived.plan:
        milliseconds = perceived.milliseconds.get(step.effect)
        hides = f"{step.bound_code_values:.2g}" if step.bound_code_values else ""
        took = "" if milliseconds is None else f"{milliseconds:.0f}"
        table.add_row(step.effect, step.level, step.reason, hides, took)
    console.print(table)
    console.print(f"pupil {perceived.pupil_diameter_mm[0]:.2f} mm, wrote [b]{escape(str(output))}[/b]", soft_wrap=True)
