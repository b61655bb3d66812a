"""One HDR image, perceived."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from entoptic.pipeline import FrameError, Perceived
from entoptic.pipeline.budget import load as load_costs
from entoptic.pipeline.sinks.images import still_path, write_still
from entoptic.services.explain.subject import Subject
from entoptic.services.process import cache_folder


def run(seen: Subject, output: Path, console: Console) -> None:
    """Perceives the image, writes it and prints the plan. Raises FrameError."""
    display = seen.settings.display
    if output != (named := still_path(output, display)):
        raise FrameError(f"output {output}: for this display images are written as {named.suffix}; name it {named}")
    if not output.parent.is_dir():
        raise FrameError(f"output {output}: there is no folder {output.parent}; make it first")
    for note in seen.notes:
        console.print(f"• {escape(note)}")
    perceived = seen.perceived(load_costs(cache_folder()))
    write_still(output, perceived.image[0], display)
    console.print(_plan_table(perceived))
    console.print(f"pupil {perceived.pupil_mm[0]:.2f} mm, wrote [b]{escape(str(output))}[/b]", soft_wrap=True)


def _plan_table(perceived: Perceived) -> Table:
    table = Table("effect", "level", "why", "hides at most", "ms")
    for step in perceived.plan:
        milliseconds = perceived.milliseconds.get(step.effect)
        hides = f"{step.bound_code_values:.2g}" if step.bound_code_values else ""
        table.add_row(
            step.effect, step.level, step.reason, hides, "" if milliseconds is None else f"{milliseconds:.0f}"
        )
    return table
