"""The program: its commands and its errors."""

from __future__ import annotations

import sys
from typing import Annotated

import typer
from rich.markup import escape

from entoptic import __version__
from entoptic.errors import EntopticError
from entoptic.services.commands.bridge import bridge
from entoptic.services.commands.calibrate import calibrate
from entoptic.services.commands.capture import capture
from entoptic.services.commands.console import console as console_command
from entoptic.services.commands.console_server import console_server
from entoptic.services.commands.cost import cost
from entoptic.services.commands.detect import detect
from entoptic.services.commands.explain import explain
from entoptic.services.commands.keys import keys
from entoptic.services.commands.psf import psf
from entoptic.services.commands.render import render
from entoptic.services.commands.report import report
from entoptic.services.commands.session import session
from entoptic.services.commands.simulate import simulate
from entoptic.services.commands.status import status
from entoptic.services.commands.tell import tell
from entoptic.services.commands.worker import worker
from entoptic.services.terminal import console

app = typer.Typer(
    help="Shows what a person would see: HDR frames in cd/m² and the state of a person's eyes go in, the frames as "
    "that person perceives them come out.",
    epilog="Start with:  entoptic session",
    no_args_is_help=True,
    invoke_without_command=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command, example in (
    (session, "session --recording my_recording/ --scene room.hdr --mean-luminance 120 --out seen"),
    (console_command, "console --root sessions"),
    (status, "status"),
    (report, "report sessions/2026-01-31_10-00-00.partial"),
    (bridge, "bridge --source my_recording/ --states tcp://127.0.0.1:5555 --events tcp://127.0.0.1:5556"),
    (worker, "worker --states tcp://127.0.0.1:5555 --events tcp://127.0.0.1:5556 --out seen"),
    (render, "render street.hdr --mean-luminance 0.5 --pupil-diameter-mm 6 --gaze 5,-2 -o seen.png"),
    (explain, "explain street.hdr --mean-luminance 0.5 --pupil-diameter-mm 6 -o explain.png"),
    (psf, "psf --pupil-diameter-mm 6 --set age_years=60 --sheets --out my_eye"),
    (simulate, "simulate --seconds 30 --seed 3 --out simulated_recording"),
    (detect, "detect my_recording/ --out events.csv"),
    (calibrate, "calibrate --source capture --out my_pupil.toml"),
    (capture, "capture simulated --port 50020 --fault restart@10s"),
    (tell, 'tell tcp://127.0.0.1:5557 "start tracker recording"'),
    (keys, "keys --out keys --client projector"),
):
    app.command(name=command.__name__, epilog=f"Example:  entoptic {example}")(command)


@app.callback()
def _program(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.", is_eager=True)] = False,
) -> None:
    if version:
        console.print(f"entoptic {__version__}")
        raise typer.Exit


app.command(name="console-server", hidden=True)(console_server)
app.add_typer(cost, name="cost")


def main() -> None:
    """Runs a command; a known error is one line and exit status 1."""
    try:
        app()
    except EntopticError as error:
        console.print(f"[red]error:[/red] {escape(str(error))}", soft_wrap=True)
        sys.exit(1)
