"""`entoptic session`: eye data and a scene in, a film and a report out."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer
from msgspec.structs import replace
from rich.markup import escape

from entoptic.services.command_line import options
from entoptic.services.config import EyesConfig, SettingsConfig, ViewConfig
from entoptic.services.eye_data import SIMULATED_SECONDS
from entoptic.services.process import INTERRUPTED, Stop, leave, prepare_jax
from entoptic.services.process_config import PageConfig
from entoptic.services.terminal import console

DIFFERENT = 1
"""The exit status of --again where frames differ by more than is promised."""


@options
def session(
    eyes: EyesConfig,
    view: ViewConfig,
    settings: SettingsConfig,
    page: PageConfig,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; sessions/<time> unless given.")] = None,
    live: Annotated[bool, typer.Option("--live", help="By the clock, dropping frames that come too late.")] = False,
    in_browser: Annotated[
        bool, typer.Option("--console", help="With --live: a page in a browser to watch it and change settings.")
    ] = False,
    again: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Render the frames of an earlier session's folder again, into --out, and say what differs. The same "
            "version on the same machine gives the same frames: if not, the exit status is 1.",
        ),
    ] = None,
) -> None:
    """Render what a person perceives: eye data and a scene in, a film and a report out.

    Without --live every frame of a recording is rendered, however long it takes; the same session gives the same
    frames. With --live all runs by the clock until Ctrl-C, or until the recording is over.
    """
    stop = Stop().on_signals()
    final = out or Path("sessions") / f"{datetime.now():%Y-%m-%d_%H-%M-%S}"
    prepare_jax(renders=not live)
    from entoptic.services import settings as all_settings
    from entoptic.services.session.watch import SessionError, StoppedError

    try:
        if again is not None:
            from entoptic.services.session import again as session_again

            as_promised = session_again.run(again, final, frozenset(view.save), stop, console)
            _print_where(final)
            leave(0 if as_promised else DIFFERENT)
        from entoptic.services.session_config import SessionConfig, open_session
        from entoptic.tracker_bridge.sources import SIMULATED

        if in_browser and not live:
            raise SessionError("--console shows a session that runs by the clock: add --live")
        if eyes.source == SIMULATED and view.seconds is None and not live:
            view = replace(view, seconds=SIMULATED_SECONDS)
        # All input is looked at before anything is started or written.
        opened = open_session(SessionConfig(eyes=eyes, view=view, settings=all_settings.of(settings)))
        if opened.source.info.live and not live:
            raise SessionError(f"{opened.source.info.name} measures at its own pace: add --live, or name a recording")
        for note in opened.notes:
            console.print(f"• {escape(note)}")
        console.print(
            f"[b]{escape(opened.source.info.name)}[/b] viewing [b]{escape(opened.scene.name)}[/b], "
            f"{opened.view.width_px}×{opened.view.height_px} px per eye"
        )
        if live:
            from entoptic.services.live import foreground
            from entoptic.services.live.web import Web

            leave(foreground.session(opened, final, Web(page) if in_browser else None, stop, console))
        from entoptic.services.session import offline

        outcome = offline.keep(opened, final, stop, console)
    except StoppedError as error:
        console.print(str(error))
        leave(INTERRUPTED)
    console.print(f"{outcome.frames} frames perceived, {outcome.eyes.states} eye states")
    _print_where(final)
    leave(INTERRUPTED if outcome.interrupted else 0)


def _print_where(final: Path) -> None:
    console.print(f"results: [b]{escape(str(final.resolve()))}[/b]", soft_wrap=True)
    console.print(f"look at: [b]{escape(str((final / 'report.html').resolve()))}[/b]", soft_wrap=True)
