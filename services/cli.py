"""The program: its commands and its errors."""

from __future__ import annotations

import sys

import typer
from rich.markup import escape

from services.commands.bridge import bridge
from services.commands.calibrate import calibrate
from services.commands.capture import capture
from services.commands.console import console as console_command
from services.commands.console_server import console_server
from services.commands.cost import cost
from services.commands.detect import detect
from services.commands.explain import explain
from services.commands.keys import keys
from services.commands.psf import psf
from services.commands.render import render
from services.commands.report import report
from services.commands.session import session
from services.commands.simulate import simulate
from services.commands.status import status
from services.commands.tell import tell
from services.commands.worker import worker
from services.terminal import console

app = typer.Typer(
    help="Shows what a person would see: HDR frames in cd/m² and the state of a person's eyes go in, the frames as "
    "that person perceives them come out.",
    epilog="Start with:  entoptic session",
    no_args_is_help=True,
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
    (render, "render street.hdr --mean-luminance 0.5 --pupil-mm 6 --gaze 5,-2 -o seen.png"),
    (explain, "explain street.hdr --mean-luminance 0.5 --pupil-mm 6 -o explain.png"),
    (psf, "psf --pupil-mm 6 --age 60 --sheets --out my_eye"),
    (simulate, "simulate --seconds 30 --seed 3 --out simulated_recording"),
    (detect, "detect my_recording/ --out events.csv"),
    (calibrate, "calibrate --source capture --out my_pupil.toml"),
    (capture, "capture simulated --port 50020 --fault restart@10s"),
    (tell, 'tell tcp://127.0.0.1:5557 "start recording"'),
    (keys, "keys --out keys --client projector"),
):
    app.command(name=command.__name__, epilog=f"Example:  entoptic {example}")(command)
app.command(name="console-server", hidden=True)(console_server)
app.add_typer(cost, name="cost")


def main() -> None:
    """Runs a command; a known error is one line and exit status 1."""
    try:
        app()
    except Exception as error:
        if not isinstance(error, _known_errors()):
            raise
        console.print(f"[red]error:[/red] {escape(str(error))}", soft_wrap=True)
        sys.exit(1)


def _known_errors() -> tuple[type[Exception], ...]:
    from pipeline import FrameError
    from pipeline.optics import OpticsError
    from services.capture import CaptureError
    from services.console.access import ConsoleError
    from services.control import ControlError
    from services.keys import KeysError
    from services.live.takes import TakeError
    from services.reader import ReaderError
    from services.results.folder import ResultsFolderError
    from services.results.moments import MomentsError
    from services.results.session_file import SessionFileError
    from services.session.offline import SessionError
    from services.settings import SettingsError
    from tracker_bridge.access import OpenAddressError
    from tracker_bridge.calibration import CalibrationError
    from tracker_bridge.publisher import PortInUseError
    from tracker_bridge.pupil_map import PupilMapError
    from tracker_bridge.source import SourceError

    light = (FrameError, OpticsError)
    eyes = (CaptureError, SourceError, CalibrationError, PupilMapError)
    processes = (ReaderError, SessionError, SettingsError, PortInUseError, OpenAddressError, KeysError, ControlError)
    results = (MomentsError, ResultsFolderError, SessionFileError, TakeError, ConsoleError)
    return (*light, *eyes, *processes, *results)


if __name__ == "__main__":
    main()
