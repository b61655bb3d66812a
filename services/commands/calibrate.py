"""`entoptic calibrate`: how far a person's pupils close and open."""

from __future__ import annotations

import contextlib
import enum
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from msgspec.structs import asdict
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from entoptic.services.command_line import options
from entoptic.services.config import CalibrationConfig, SourceConfig
from entoptic.services.eye_data import open_live_eyes
from entoptic.services.process import INTERRUPTED, Stop
from entoptic.services.terminal import console

if TYPE_CHECKING:
    from collections.abc import Iterable

    from entoptic.services.calibration.outcome import Outcome
    from entoptic.services.calibration.pupil_calibration import PupilCalibration
    from entoptic.tracker_bridge.source import Item


class DisplayKind(enum.StrEnum):
    """Where the screens are shown."""

    BROWSER = "browser"
    SOCKET = "socket"


@options
def calibrate(
    source: SourceConfig,
    config: CalibrationConfig,
    out: Annotated[Path, typer.Option(help="The pupil map to write; its plot lies beside it.")] = Path("pupil.toml"),
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
    from entoptic.services.calibration.display import Display, NoDisplay, SocketDisplay
    from entoptic.services.calibration.outcome import Concluded
    from entoptic.services.calibration.pupil_calibration import BEGIN_WORDS, PupilCalibration
    from entoptic.services.calibration.result import refuse_unwritable
    from entoptic.services.calibration.run import GREY_SHARE, Room, protocol_of
    from entoptic.services.ipc.requests import CalibratePupils
    from entoptic.tracker_bridge import bridge
    from entoptic.tracker_bridge.calibration import CalibrationError
    from entoptic.tracker_bridge.source import Source
    from entoptic.tracker_bridge.sources import SIMULATED
    from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedSettings
    from entoptic.tracker_bridge.sources.simulated.live import LiveEyes

    # All input is looked at before anybody has to look at anything.
    protocol = protocol_of(config)
    refuse_unwritable(out)
    if keys is not None and (fast or display is DisplayKind.BROWSER):
        raise CalibrationError("--keys are for a display program on another machine: add --display socket")
    simulated = source.source == SIMULATED
    if fast and not simulated:
        raise CalibrationError("--fast is for simulated eyes: a person's pupils take their time; leave it out")
    if simulated and source.table_map is not None:
        raise CalibrationError("simulated eyes take no --map: leave it out, or name a table as --source")
    room_cd_m2 = white_cd_m2 * GREY_SHARE
    opened: Source
    if fast:
        # Nobody pauses where nobody looks.
        seconds = repeats * (protocol.seconds + 1.0)
        settings = SimulatedSettings(seconds=seconds, seed=source.seed, luminance=((0.0, room_cd_m2),))
        opened = LiveEyes(settings)
    else:
        opened = open_live_eyes(source, str(room_cd_m2) if simulated else None)
    for note in opened.info.notes:
        console.print(f"• {escape(note)}")
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
        eyes = opened if isinstance(opened, LiveEyes) else None
        calibration = PupilCalibration(
            Room(screens, eyes, white_cd_m2, black_cd_m2),
            opened.info.name,
            scene_cd_m2=room_cd_m2,
            conclude=Concluded,
            plot_failed=keep_failed,
            own_time=fast,
        )
        request = CalibratePupils(str(out), **asdict(config))
        items = stack.enter_context(contextlib.closing(bridge.items_of(opened)))
        words, found = BEGIN_WORDS, False
        for number in range(1, repeats + 1):
            # What came of the last run stays in sight until the next one starts.
            if not (begun := calibration.begin(request, words)).done:
                raise CalibrationError(begun.reply)
            outcome = _follow(calibration, items, opened.info.name, protocol.seconds, stop)
            words, found = outcome.words, found or outcome.found is not None
            _print_outcome(outcome, f"run {number} of {repeats}" if repeats > 1 else None)
            if screens.unreadable:
                console.print(f"the display said something that cannot be read: {escape(screens.unreadable)}")
            if stop():
                raise typer.Exit(INTERRUPTED)
    if not found:
        console.print("no result: nothing was written")
        raise typer.Exit(1)
    console.print(f"results: [b]{escape(str(out.resolve()))}[/b]", soft_wrap=True)


def _follow(calibration: PupilCalibration, items: Iterable[Item], source: str, seconds: float, stop: Stop) -> Outcome:
    """Steps the run until it has an outcome. Raises SourceError that names the source if that ends before."""
    from entoptic.tracker_bridge.calibration import Stage
    from entoptic.tracker_bridge.events import SourceSilent
    from entoptic.tracker_bridge.source import SourceError, Tick

    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task("waiting for Start", total=seconds)
        for item in items:
            if stop():
                calibration.stop()
            calibration.step(item)
            if calibration.outcome is not None:
                return calibration.outcome
            if isinstance(item, SourceSilent):
                console.print(f"[red]the tracker is silent:[/red] {escape(item.reason)}", soft_wrap=True)
            elif isinstance(item, Tick) and (status := calibration.status()) is not None:
                shown = {Stage.READY: "waiting for Start", Stage.SHOWING: status["screen"]}
                description = shown.get(status["stage"], status["stage"])
                progress.update(bar, completed=status["seconds_done"], description=description)
    if not stop():
        raise SourceError(
            f"{source} ended before the calibration did: choose a source that goes on, or one that lasts {seconds:g} s "
            "and more"
        )
    calibration.stop()
    assert calibration.outcome is not None
    return calibration.outcome


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
