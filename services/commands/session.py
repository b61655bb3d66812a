"""`entoptic session`: eye data and a scene in, a film and a report out."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.markup import escape

from entoptic.services.eye_data import SIMULATED_SECONDS
from entoptic.services.live.choice import DEFAULT_FPS, SessionChoice
from entoptic.services.options import (
    BudgetMs,
    ConsoleHost,
    ConsoleNames,
    ConsolePort,
    ConsoleToken,
    Everything,
    Eyes,
    EyeSource,
    Fov,
    Fps,
    Head,
    Height,
    LaneOption,
    Live,
    MeanLuminance,
    PupilMapFile,
    Remote,
    Save,
    SaveOption,
    SceneSpec,
    Seconds,
    Seed,
    SettingsFile,
    TableMap,
    UsbFaults,
    UsbId,
    WhichEyes,
    Width,
    Without,
)
from entoptic.services.process import INTERRUPTED, Stop, prepare_jax
from entoptic.services.terminal import console
from entoptic.tracker_bridge.chain import Lane
from entoptic.tracker_bridge.sources.pupil_remote import DEFAULT_REMOTE


def session(
    source: EyeSource = "simulated",
    table_map: TableMap = None,
    remote: Remote = DEFAULT_REMOTE,
    usb_id: UsbId = None,
    usb_fault: UsbFaults = [],  # noqa: B006 - typer copies it
    pupil_map: PupilMapFile = None,
    lane: LaneOption = Lane.LIVE,
    scene: SceneSpec = "night-street",
    mean_luminance: MeanLuminance = None,
    seconds: Seconds = None,
    fps: Fps = DEFAULT_FPS,
    width: Width = None,
    height: Height = None,
    fov: Fov = 104.0,
    eyes: WhichEyes = Eyes.LEFT,
    seed: Seed = 0,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; sessions/<time> unless given.")] = None,
    live: Live = False,
    page: Annotated[
        bool, typer.Option("--console", help="With --live: a page in a browser to watch it and change settings.")
    ] = False,
    host: ConsoleHost = "127.0.0.1",
    port: ConsolePort = 8080,
    token: ConsoleToken = None,
    allow_host: ConsoleNames = [],  # noqa: B006
    again: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Render the frames of an earlier session's folder again, into --out."),
    ] = None,
    head: Head = "look-around",
    settings: SettingsFile = None,
    budget_ms: BudgetMs = None,
    everything: Everything = False,
    without: Without = [],  # noqa: B006
    save: SaveOption = [Save.VIDEO],  # noqa: B006
) -> None:
    """Render what a person perceives: eye data and a scene in, a film and a report out.

    Without --live every frame of a recording is rendered, however long it takes; the same session gives the same
    frames. With --live all runs by the clock until Ctrl-C, or until the recording is over.
    """
    from entoptic.services.session.offline import SessionError

    stop = Stop().on_signals()
    final = out or Path("sessions") / f"{datetime.now():%Y-%m-%d_%H-%M-%S}"
    if again is not None:
        from entoptic.services.session import again as session_again

        with _told_if_stopped():
            session_again.run(again, final, save, stop, console)
        _say_where(final)
        return
    prepare_jax(renders=False)
    from entoptic.services.live.checked import check
    from entoptic.services.settings import load, planned
    from entoptic.tracker_bridge.sources import SIMULATED

    if source == SIMULATED and seconds is None and not live:
        seconds = SIMULATED_SECONDS
    if page and not live:
        raise SessionError("--console shows a session that runs by the clock: add --live")
    choice = SessionChoice(
        source=source,
        table_map=None if table_map is None else str(table_map),
        remote=None if remote == DEFAULT_REMOTE else remote,
        usb_id=usb_id,
        usb_fault=tuple(usb_fault),
        pupil_map=None if pupil_map is None else str(pupil_map),
        lane=lane.value,
        seed=seed,
        seconds=seconds,
        scene=scene,
        mean_luminance=mean_luminance,
        fps=fps,
        width=width,
        height=height,
        fov=fov,
        eyes=eyes,
        head=head,
        save=tuple(save),
        settings=msgspec.to_builtins(planned(load(settings), budget_ms, everything, without), order="deterministic"),
    )
    # All input is looked at before anything is started or written.
    checked = check(choice)
    if checked.source.info.live and not live:
        raise SessionError(f"{checked.source.info.name} measures at its own pace: add --live, or name a recording")
    for note in checked.notes:
        console.print(f"• {escape(note)}")
    view = checked.view
    console.print(
        f"[b]{escape(checked.source.info.name)}[/b] before [b]{escape(checked.scene.name)}[/b], "
        f"{view.width_px}×{view.height_px} px per eye"
    )
    if live:
        from entoptic.services.live import attended
        from entoptic.services.live.web import Web

        web = Web(host, port, token, names=tuple(allow_host)) if page else None
        raise typer.Exit(attended.session(checked, final, web, stop, console))
    from entoptic.services.session import offline as sessions

    with _told_if_stopped():
        outcome = sessions.keep(checked, final, stop, console)
    console.print(f"{outcome.worker.get('frames', 0)} frames perceived, {outcome.bridge.get('states', 0)} eye states")
    _say_where(final)
    if outcome.interrupted:
        raise typer.Exit(INTERRUPTED)


@contextlib.contextmanager
def _told_if_stopped() -> Iterator[None]:
    from entoptic.services.session.offline import StoppedError

    try:
        yield
    except StoppedError as error:
        console.print(str(error))
        raise typer.Exit(INTERRUPTED) from None


def _say_where(final: Path) -> None:
    console.print(f"results: [b]{escape(str(final.resolve()))}[/b]", soft_wrap=True)
    console.print(f"look at: [b]{escape(str((final / 'report.html').resolve()))}[/b]", soft_wrap=True)
