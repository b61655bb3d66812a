"""`entoptic cost`: what accuracy costs in time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from services.process import prepare_jax
from services.terminal import console

cost = typer.Typer(no_args_is_help=True)


@cost.callback()
def _effects() -> None:
    """Measure what accuracy costs in time, on this machine."""


@cost.command(epilog="Example:  entoptic cost glare --out cost --quick")
def glare(
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Tables (CSV, Markdown) and plots; earlier ones are replaced.")
    ] = Path("cost"),
    quick: Annotated[
        bool, typer.Option("--quick", help="Small frames and few settings, to see that it works; no figures to quote.")
    ] = False,
    rounds: Annotated[
        int | None, typer.Option(min=1, max=1000, help="Runs of each setting after the first; 5, or 2 with --quick.")
    ] = None,
) -> None:
    """Measure error and time of glare at each of its settings. Takes ten minutes; let the machine rest meanwhile."""
    prepare_jax()
    from pipeline.cost import glare as measured
    from services import cost as results
    from services.results_folder import results_folder

    effort = measured.QUICK if quick else measured.FULL
    count = effort.rounds if rounds is None else rounds
    with (
        results_folder(out) as folder,
        Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        ) as progress,
    ):
        bar = progress.add_task("", total=measured.steps(effort, count))

        def done(label: str) -> None:
            progress.update(bar, advance=1, description=label)

        found = measured.run(effort, count, done)
        text = results.write(folder, found.rows, found.corner, measured.notes(effort))
    console.print(text, markup=False, soft_wrap=True)
    console.print(f"results: [b]{escape(str(out.resolve()))}[/b]", soft_wrap=True)
