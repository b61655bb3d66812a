"""`entoptic calibrate`: how far a person's pupils close and open."""

from __future__ import annotations

import contextlib
import enum
import functools
import itertools
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table

from entoptic.services.command_line import options
from entoptic.services.config import SourceConfig
from entoptic.services.eye_data import open_eyes
from entoptic.services.process import Stop
from entoptic.services.terminal import console

if TYPE_CHECKING:
    from entoptic.services.calibration.outcome import Outcome
    from entoptic.services.calibration.run import CalibrationRun
    from entoptic.tracker_bridge.source import Item


class ProtocolName(enum.StrEnum):
    """Which screens."""

    ROBUST = "robust"
    LUIDOLT = "luidolt"


class DisplayKind(enum.StrEnum):
    """Where the screens are shown."""

    BROWSER = "browser"
    SOCKET = "socket"


class CalibratedEyes(enum.StrEnum):
    """Which eyes must succeed."""

    BOTH = "both"
    LEFT = "left"
    RIGHT = "right"


@options
def calibrate(
    source: SourceConfig,
    out: Annotated[Path, typer.Option(help="The pupil map to write; its plot lies beside it.")] = Path("pupil.toml"),
    protocol: Annotated[
        ProtocolName, typer.Option(help="White, black, white, medians; or the thesis's black, white, means.")
    ] = ProtocolName.ROBUST,
    display: Annotated[
        DisplayKind, typer.Option(help="A page in a browser, or your own program on two ZeroMQ sockets.")
    ] = DisplayKind.BROWSER,
    host: Annotated[str, typer.Option(help="Where the page is served; 0.0.0.0 for other machines.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Of the page; 0 for any.")] = 8720,
    commands: Annotated[str, typer.Option(help="Where screens are asked for (PUB).")] = "tcp://127.0.0.1:*",
    answers: Annotated[str, typer.Option(help="Where displays answer (PULL).")] = "tcp://127.0.0.1:*",
    keys: Annotated[
        Path | None, typer.Option(help="The bridge's keys, for a display program on another machine.")
    ] = None,
    white_seconds: Annotated[float | None, typer.Option(help="Of each white screen.")] = None,
    black_seconds: Annotated[float | None, typer.Option(help="Of the black screen.")] = None,
    eyes: Annotated[CalibratedEyes, typer.Option(help="Leave an eye out that cannot be tracked.")] = (
        CalibratedEyes.BOTH
    ),
    map_mm: Annotated[
        bool, typer.Option("--map-mm", help="Map a tracker's millimetres onto 2–8 mm too, as the thesis does.")
    ] = False,
    repeats: Annotated[int, typer.Option(min=1, max=20, help="Runs; the newest valid one is kept.")] = 1,
    fast: Annotated[bool, typer.Option("--fast", help="Simulated eyes alone: no display, and no waiting.")] = False,
    keep_failed: Annotated[
        bool, typer.Option("--keep-failed", help="Write the plot of a failed run, as NAME.failed.png.")
    ] = False,
    white_cd_m2: Annotated[
        float, typer.Option(min=0.01, max=1e5, help="The white screen's light, for simulated eyes.")
    ] = 200.0,
    black_cd_m2: Annotated[
        float, typer.Option(min=1e-6, max=1e5, help="The black screen's light, for simulated eyes.")
    ] = 0.05,
) -> None:
    """Find out how far a person's pupils close and open, before white and black screens."""
    from entoptic.services import keys as key_files
    from entoptic.services.calibration import run as calibrates
    from entoptic.services.calibration.display import Display, NoDisplay, SocketDisplay
    from entoptic.services.calibration.outcome import Job, conclude
    from entoptic.services.calibration.result import refuse_unwritable
    from entoptic.tracker_bridge.calibration import CalibrationError
    from entoptic.tracker_bridge.source import Source
    from entoptic.tracker_bridge.sources import SIMULATED
    from entoptic.tracker_bridge.sources.simulated.live import SimulatedLiveEyes

    # All input is looked at before anybody has to look at anything.
    chosen = calibrates.protocol_of(protocol.value, white_seconds, black_seconds)
    refuse_unwritable(out)
    if keys is not None and (fast or display is DisplayKind.BROWSER):
        raise CalibrationError("--keys are for a display program on another machine: add --display socket")
    simulated = source.source == SIMULATED
    if fast and not simulated:
        raise CalibrationError("--fast is for simulated eyes: a person's pupils take their time; leave it out")
    opened: Source
    if simulated:
        if source.table_map is not None:
            raise CalibrationError("simulated eyes take no --map: leave it out, or name a table as --source")
        # Nobody pauses where nobody looks.
        seconds = repeats * (chosen.seconds + 1.0) if fast else calibrates.LONGEST_S
        room_cd_m2 = white_cd_m2 * calibrates.GREY_SHARE
        opened = calibrates.simulated_eyes(source.seed, room_cd_m2, paced=not fast, seconds=seconds)
    else:
        opened = open_eyes(source)
    for note in opened.info.notes:
        console.print(f"• {escape(note)}")
    wanted, ids = calibrates.eyes_of(eyes.value), itertools.count(1)
    stop = Stop().on_signals()
    with ExitStack() as stack:
        screens: Display
        if fast:
            screens = NoDisplay()
        else:
            name = "page in a browser" if display is DisplayKind.BROWSER else "program on the sockets"
            server_keys = None if keys is None else key_files.load_server(keys)
            screens = SocketDisplay(commands, answers, name, keys=server_keys)
            stack.callback(screens.close)
            if display is DisplayKind.BROWSER:
                from entoptic.services.calibration.page import LOOPBACK, PageServer

                server = PageServer(screens.commands_address, screens.answers_address, host, port)
                stack.callback(server.close)
                console.print(f"open [b]{server.url}[/b] on the display, fill it, and press Start")
                if host not in LOOPBACK:
                    console.print("[yellow]everybody on that network can open the page[/yellow]")
            else:
                console.print(
                    f"screens are asked for at [b]{screens.commands_address}[/b], answers are awaited at "
                    f'[b]{screens.answers_address}[/b]; the display starts with {{"request": "start"}}'
                )
        room = calibrates.Room(
            screens, opened if isinstance(opened, SimulatedLiveEyes) else None, white_cd_m2, black_cd_m2
        )
        items = stack.enter_context(contextlib.closing(calibrates.items_now(opened)))
        kept: Outcome | None = None
        for number in range(1, repeats + 1):
            with Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                TimeRemainingColumn(),
                console=console,
                transient=True,
                disable=not console.is_terminal,
            ) as progress:
                bar = progress.add_task("waiting for Start", total=chosen.seconds)
                run = calibrates.CalibrationRun(chosen, room, wanted, ids)
                show = functools.partial(_show_progress, progress, bar, run)
                recorded = calibrates.follow(run, items, opened.info.name, stop, on_item=show)
            outcome = conclude(
                Job(recorded, str(out), opened.info.name, screens.name, screens.uncertainty_ns, map_mm, keep_failed)
            )
            kept = outcome if outcome.found is not None else kept
            _print_outcome(outcome, f"run {number} of {repeats}" if repeats > 1 else None)
            if isinstance(screens, SocketDisplay) and screens.unreadable:
                console.print(f"the display said something that cannot be read: {escape(screens.unreadable)}")
            screens.tell(outcome.words, again=number < repeats)
            if stop():
                raise typer.Exit(130)
    if kept is None:
        console.print("no result: nothing was written")
        raise typer.Exit(1)
    console.print(f"results: [b]{escape(str(out.resolve()))}[/b]", soft_wrap=True)


def _show_progress(progress: Progress, bar: TaskID, run: CalibrationRun, item: Item, now_ns: int) -> None:
    from entoptic.tracker_bridge.calibration import Stage
    from entoptic.tracker_bridge.events import SourceSilent
    from entoptic.tracker_bridge.source import Tick

    if isinstance(item, SourceSilent):
        console.print(f"[red]the tracker is silent:[/red] {escape(item.reason)}", soft_wrap=True)
    if isinstance(item, Tick):
        words = {Stage.READY: "waiting for Start", Stage.SHOWING: run.screen.value}
        description = words.get(run.stage, run.stage.value)
        progress.update(bar, completed=run.seconds_done(now_ns), description=description)


def _print_outcome(outcome: Outcome, title: str | None) -> None:
    from entoptic.tracker_bridge.pupil_map import Use

    if outcome.found is None:
        if title is not None:
            console.print(title)
        for problem in outcome.problems:
            console.print(f"[red]{problem.name}[/red]: {escape(problem.detail)}", soft_wrap=True)
        for remedy in dict.fromkeys(problem.remedy for problem in outcome.problems):
            console.print(f"  → {escape(remedy)}", soft_wrap=True)
    else:
        table = Table(title=title, title_justify="left")
        diameters = (f"{what} / {outcome.found.unit}" for what in ("white", "black", "span"))
        for heading in ("eye", *diameters, "tracked", "moving / mm/s", "stretch"):
            table.add_column(heading, justify="left" if heading == "eye" else "right")
        for name, one in outcome.eyes.items():
            shown = ("{:.2f}", "{:.2f}", "{:.2f}", "{:.0%}", "{:.2f}", "×{:.2f}")
            values = (one.white, one.black, one.span, one.tracked_share, one.slope_mm_s, one.stretch)
            table.add_row(name, *(form.format(value) for form, value in zip(shown, values, strict=True)))
        console.print(table)
        if outcome.found.use is Use.CHECK:
            console.print("the tracker's own millimetres are kept; --map-mm would stretch them onto 2–8 mm")
    if outcome.plot is not None:
        console.print(f"plot: [b]{escape(str(Path(outcome.plot).resolve()))}[/b]", soft_wrap=True)
