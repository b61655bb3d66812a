"""`entoptic cost`: what accuracy costs in time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from entoptic.services.process import cache_folder, prepare_jax
from entoptic.services.terminal import console

cost = typer.Typer(invoke_without_command=True)

Out = Annotated[
    Path, typer.Option(metavar="FOLDER", help="Tables (CSV, Markdown) and plots; earlier ones are replaced.")
]
Quick = Annotated[
    bool, typer.Option("--quick", help="Small frames and few settings, to see that it works; no figures to quote.")
]


@cost.callback(epilog="Example:  entoptic cost --out cost")
def every_effect(
    context: typer.Context,
    out: Out = Path("cost"),
    quick: Quick = False,
    rounds: Annotated[
        int | None, typer.Option(min=1, max=1000, help="Runs after the first; 5 (7 to calibrate), or 1 with --quick.")
    ] = None,
    calibrate: Annotated[
        bool,
        typer.Option("--calibrate", help="Only time each level, and keep that for planning within a time budget."),
    ] = False,
) -> None:
    """Measure error and time of every effect at every setting, on this machine, and say which setting to take.

    Takes a quarter of an hour; let the machine rest meanwhile.
    """
    if context.invoked_subcommand is not None:
        return
    prepare_jax()
    if calibrate:
        _calibrate(quick, rounds)
        return
    from entoptic.pipeline.budget import device_name
    from entoptic.pipeline.cost import everything as measured
    from entoptic.services.cost.tables import write_everything
    from entoptic.services.results.folder import results_folder

    effort = measured.QUICK if quick else measured.FULL
    count = effort.rounds if rounds is None else rounds
    with results_folder(out) as folder, _progress(measured.steps(effort, count)) as done:
        text = write_everything(folder, measured.run(effort, count, done), device_name())
    _print(text, out)


def _calibrate(quick: bool, asked: int | None) -> None:
    from entoptic.pipeline.budget import save
    from entoptic.pipeline.cost import calibration

    sizes = calibration.SIZES[-1:] if quick else calibration.SIZES
    rounds = asked or (1 if quick else calibration.ROUNDS)
    with _progress(calibration.steps(sizes, rounds)) as done:
        model = calibration.run(sizes, rounds, lambda: done("calibrating"))
    path = save(model, cache_folder())
    for effect, levels in model.costs.items():
        for level, of_level in levels.items():
            console.print(
                f"{effect:13} {level:10} {of_level.fixed_ms:8.2f} ms + {of_level.ms_per_megapixel:8.2f} ms a megapixel",
                markup=False,
                highlight=False,
            )
    console.print(f"kept: [b]{escape(str(path))}[/b]", soft_wrap=True)


@cost.command(epilog="Example:  entoptic cost glare --out cost --quick")
def glare(
    out: Out = Path("cost"),
    quick: Quick = False,
    rounds: Annotated[
        int | None, typer.Option(min=1, max=1000, help="Runs of each setting after the first; 5, or 2 with --quick.")
    ] = None,
) -> None:
    """Measure error and time of glare at each of its settings. Takes ten minutes; let the machine rest meanwhile."""
    prepare_jax()
    from entoptic.pipeline.cost import glare as measured
    from entoptic.services.cost.tables import write_glare
    from entoptic.services.results.folder import results_folder

    effort = measured.QUICK if quick else measured.FULL
    count = effort.rounds if rounds is None else rounds
    with results_folder(out) as folder, _progress(measured.steps(effort, count)) as done:
        text = write_glare(folder, measured.run(effort, count, done), measured.notes(effort))
    _print(text, out)


def _print(text: str, out: Path) -> None:
    console.print(text, markup=False, soft_wrap=True)
    console.print(f"results: [b]{escape(str(out.resolve()))}[/b]", soft_wrap=True)


@contextmanager
def _progress(total: int) -> Iterator[Callable[[str], None]]:
    """A bar on a terminal; what it gives is told the label of each step that has ended."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task("", total=total)

        def done(label: str) -> None:
            progress.update(bar, advance=1, description=label)

        yield done
