"""The commands, their options and their errors."""

from __future__ import annotations

import contextlib
import dataclasses
import shutil
import sys
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer
from rich.console import Console
from rich.markup import escape

from services.options import (
    Child,
    Eyes,
    Fov,
    Fps,
    Head,
    Height,
    MeanLuminance,
    Pace,
    Recording,
    Save,
    SaveOption,
    SceneSpec,
    Seconds,
    Seed,
    SettingsFile,
    TableMap,
    Width,
)
from services.process import Stop, prepare_jax, start_logging

if TYPE_CHECKING:
    from structlog.typing import FilteringBoundLogger

    from tracker_bridge.samples import Source

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
console = Console(stderr=True, highlight=False)

SIMULATED_SECONDS = 4.8
"""How long a simulated recording is unless told otherwise."""


@app.command(
    epilog="Example:  entoptic session --recording my_recording/ --scene room.hdr --mean-luminance 120 --out seen"
)
def session(
    recording: Recording = "simulated",
    table_map: TableMap = None,
    scene: SceneSpec = "night-street",
    mean_luminance: MeanLuminance = None,
    seconds: Seconds = None,
    fps: Fps = 24.0,
    width: Width = None,
    height: Height = None,
    fov: Fov = 104.0,
    eyes: Annotated[Eyes, typer.Option(help="Which eyes are rendered; both stand side by side.")] = Eyes.LEFT,
    seed: Seed = 0,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; sessions/<time> unless given.")] = None,
    live: Annotated[
        bool, typer.Option("--live/--offline", help="By the clock, dropping frames; or every frame by recorded time.")
    ] = False,
    head: Head = "look-around",
    settings: SettingsFile = None,
    save: SaveOption = [Save.VIDEO],  # noqa: B006 - typer copies it
) -> None:
    """Render what a person would have perceived: eye data and a scene in, a video and a report out."""
    from services import report, simulated_light
    from services import session as sessions

    prepare_jax()
    from pipeline.scenes import open_scene
    from pipeline.scenes.head_path import open_head_path
    from services.settings import load
    from tracker_bridge.sources import SIMULATED

    if recording == SIMULATED and seconds is None:
        seconds = SIMULATED_SECONDS
    # All input is looked at before anything is started or written.
    opened_scene = open_scene(scene, mean_luminance_cd_m2=mean_luminance)
    view = opened_scene.view_for(width, height, fov)
    open_head_path(head)
    load(settings)
    source = _open_source(recording, table_map, seconds, seed, None)
    for note in (*source.info.notes, *opened_scene.notes):
        console.print(f"• {escape(note)}")
    console.print(
        f"[b]{escape(source.info.name)}[/b] before [b]{escape(opened_scene.name)}[/b], "
        f"{view.width_px}×{view.height_px} px per eye"
    )
    final = out or Path("sessions") / f"{datetime.now():%Y-%m-%d_%H-%M-%S}"
    stop = Stop().on_signals()
    with sessions.results_folder(final) as folder:
        bridge_arguments = ["--source", recording, "--seed", str(seed), "--wait", "--tables", str(folder)]
        bridge_arguments += ["--pace", (Pace.RECORDED if live else Pace.READER).value]
        worker_arguments = ["--scene", scene, "--fps", str(fps), "--width", str(view.width_px)]
        worker_arguments += ["--height", str(view.height_px), "--fov", str(fov), "--eyes", eyes.value]
        worker_arguments += ["--head", head, "--out", str(folder), "--live" if live else "--offline"]
        for form in save:
            worker_arguments += ["--save", form.value]
        if table_map is not None:
            bridge_arguments += ["--map", str(table_map)]
        if mean_luminance is not None:
            worker_arguments += ["--mean-luminance", str(mean_luminance)]
        if settings is not None:
            worker_arguments += ["--settings", str(settings)]
            shutil.copy(settings, folder / "settings.toml")
        if seconds is not None:
            bridge_arguments += ["--seconds", str(seconds)]
            worker_arguments += ["--seconds", str(seconds)]
        if recording == SIMULATED:
            light = folder / "scene_luminance.csv"
            simulated_light.write(light, simulated_light.of_scene(opened_scene, view, head, seconds or 0.0))
            bridge_arguments += ["--luminance", str(light)]
        outcome = sessions.run(bridge_arguments, worker_arguments, stop, console)
        summary = {
            "recording": source.info.name,
            "scene": opened_scene.name,
            "notes": [*source.info.notes, *opened_scene.notes],
            "view": dataclasses.asdict(view),
            "fps": fps,
            "eyes": eyes.value,
            "mode": "live" if live else "offline",
            "seed": seed,
            "interrupted": outcome.interrupted,
            "bridge": outcome.bridge,
            "worker": outcome.worker,
        }
        (folder / sessions.SUMMARY).write_bytes(msgspec.json.format(msgspec.json.encode(summary), indent=2))
        report.write(folder)
    worker = outcome.worker
    console.print(
        f"{worker.get('frames', 0)} frames perceived, {worker.get('dropped_frames', 0)} dropped, "
        f"{outcome.bridge.get('states', 0)} eye states"
    )
    console.print(f"results: [b]{escape(str(final.resolve()))}[/b]", soft_wrap=True)
    console.print(f"look at: [b]{escape(str((final / 'report.html').resolve()))}[/b]", soft_wrap=True)
    if outcome.interrupted:
        raise typer.Exit(130)


@app.command(
    epilog="Example:  entoptic bridge --source my_recording/ --states tcp://127.0.0.1:5555 --events tcp://127.0.0.1:5556"
)
def bridge(
    source: Annotated[str, typer.Option(help="Eye data, as --recording of [b]entoptic session[/b].")] = "simulated",
    table_map: TableMap = None,
    states: Annotated[
        str, typer.Option(help="Where eye states are published; * for a free port.")
    ] = "tcp://127.0.0.1:*",
    events: Annotated[str, typer.Option(help="Where events are published; * for a free port.")] = "tcp://127.0.0.1:*",
    pace: Annotated[
        Pace, typer.Option(help="By the recorded time, or as fast as the reader takes it.")
    ] = Pace.RECORDED,
    wait: Annotated[bool, typer.Option("--wait", help="Start when a reader has subscribed.")] = False,
    seconds: Seconds = None,
    seed: Seed = 0,
    luminance: Annotated[
        str | None, typer.Option(help="Light before a simulated eye: cd/m², or a CSV file t_s,cd_m2.")
    ] = None,
    tables: Annotated[Path | None, typer.Option(help="Folder for states.csv and events.csv.")] = None,
    child: Child = False,
) -> None:
    """Publish a person's eyes: states at sample rate on one socket, events on another."""
    from services import bridge as bridges

    stop = Stop().on_signals()
    if child:
        stop.with_parent()
    log = start_logging(as_json=child)
    with _failures_logged(log, child):
        opened = _open_source(source, table_map, seconds, seed, luminance)
        bridges.run(
            opened,
            bridges.BridgeSettings(
                states_address=states,
                events_address=events,
                real_time=pace is Pace.RECORDED,
                wait_for_reader=wait or pace is Pace.READER,
                seconds=seconds,
                tables=tables,
            ),
            stop,
            log,
        )


@app.command(epilog="Example:  entoptic worker --states tcp://127.0.0.1:5555 --events tcp://127.0.0.1:5556 --out seen")
def worker(
    states: Annotated[str, typer.Option(help="Where a bridge publishes eye states.")],
    events: Annotated[str, typer.Option(help="Where it publishes events.")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    scene: SceneSpec = "night-street",
    mean_luminance: MeanLuminance = None,
    seconds: Seconds = None,
    fps: Fps = 24.0,
    width: Width = None,
    height: Height = None,
    fov: Fov = 104.0,
    eyes: Annotated[Eyes, typer.Option(help="Which eyes are rendered; both stand side by side.")] = Eyes.LEFT,
    live: Annotated[
        bool, typer.Option("--live/--offline", help="By the clock, dropping frames; or every frame by recorded time.")
    ] = False,
    head: Head = "look-around",
    settings: SettingsFile = None,
    save: SaveOption = [Save.VIDEO],  # noqa: B006
    child: Child = False,
) -> None:
    """Render what a bridge publishes."""
    stop = Stop().on_signals()
    if child:
        stop.with_parent()
    log = start_logging(as_json=child)
    with _failures_logged(log, child):
        prepare_jax()
        from pipeline.scenes import open_scene
        from pipeline.scenes.head_path import open_head_path
        from services import worker as workers
        from services.reader import StateReader
        from services.settings import load
        from tracker_bridge.wire import Eye

        perception = load(settings)
        opened = open_scene(scene, mean_luminance_cd_m2=mean_luminance)
        path = open_head_path(head)
        view = opened.view_for(width, height, fov)
        chosen = {Eyes.LEFT: (Eye.LEFT,), Eyes.RIGHT: (Eye.RIGHT,), Eyes.BOTH: (Eye.LEFT, Eye.RIGHT)}[eyes]
        out.mkdir(parents=True, exist_ok=True)
        reader = StateReader(states, events, newest_only=live)
        try:
            job = workers.WorkerSettings(view, fps, chosen, live, seconds, out, frozenset(save))
            summary = workers.run(reader, opened, path, job, perception, stop, log)
        finally:
            reader.close()
        log.info("ended", **msgspec.to_builtins(summary))


@app.command(epilog="Example:  entoptic render street.hdr --mean-luminance 0.5 --pupil-mm 6 --gaze 5,-2 -o seen.png")
def render(
    image: Annotated[Path, typer.Argument(help="HDR picture or panorama: .hdr or .exr.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="PNG file to write.")] = Path("perceived.png"),
    pupil_mm: Annotated[
        float | None,
        typer.Option(min=0.5, max=12, help="Pupil diameter; computed from the light and the age unless given."),
    ] = None,
    gaze: Annotated[str, typer.Option(metavar="X,Y", help="Direction of gaze in degrees, right and up.")] = "0,0",
    adaptation: Annotated[
        float | None,
        typer.Option(
            metavar="CD_M2", min=1e-6, max=1e9, help="Luminance the eye is adapted to; the image's unless given."
        ),
    ] = None,
    age: Annotated[float | None, typer.Option(min=1, max=120, help="Years; overrides the settings file.")] = None,
    fov: Fov = 104.0,
    display_peak: Annotated[
        float | None, typer.Option(metavar="CD_M2", min=1, max=20000, help="Peak luminance of the display.")
    ] = None,
    mean_luminance: MeanLuminance = None,
    width: Width = None,
    height: Height = None,
    settings: SettingsFile = None,
) -> None:
    """Perceive one HDR image."""
    prepare_jax()
    from pipeline import Looking
    from services import render as renders
    from services.settings import load

    loaded = load(settings)
    changes = {} if age is None else {"age_years": age}
    loaded = msgspec.structs.replace(loaded, observer=msgspec.structs.replace(loaded.observer, **changes))
    if display_peak is not None:
        display = msgspec.structs.replace(loaded.display, peak_cd_m2=display_peak)
        loaded = msgspec.structs.replace(loaded, display=display)
    renders.run(
        image,
        output,
        loaded,
        Looking(*_direction(gaze), pupil_mm),
        adaptation,
        fov,
        mean_luminance,
        (width, height),
        console,
    )


@app.command(epilog="Example:  entoptic simulate --seconds 30 --seed 3 --out simulated_recording")
def simulate(
    out: Annotated[Path, typer.Option(help="Folder to write: a Pupil recording, and truth.csv beside it.")],
    seconds: Annotated[float, typer.Option(min=0.1, max=3600, help="How long.")] = 30.0,
    seed: Seed = 0,
    luminance: Annotated[str, typer.Option(help="Light before the eyes: cd/m², or a CSV file t_s,cd_m2.")] = "100",
) -> None:
    """Write a simulated recording with its truth: gaze, microsaccades, blinks, pupils."""
    from tracker_bridge.sources.pupil_writer import write_recording
    from tracker_bridge.sources.simulated import SimulatedEyes

    source = _open_source("simulated", None, seconds, seed, luminance)
    assert isinstance(source, SimulatedEyes)
    write_recording(source, out)
    source.write_truth_csv(out / "truth.csv")
    console.print(f"results: [b]{escape(str(out.resolve()))}[/b]", soft_wrap=True)


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
    from services.reader import BridgeSilentError
    from services.session import SessionError
    from services.settings import SettingsError
    from tracker_bridge.bridge import PortInUseError
    from tracker_bridge.samples import SourceError

    return (FrameError, OpticsError, BridgeSilentError, SessionError, SettingsError, PortInUseError, SourceError)


@contextlib.contextmanager
def _failures_logged(log: FilteringBoundLogger, child: bool) -> Iterator[None]:
    """Tells the parent, which cannot see an exception, why this process ends."""
    try:
        yield
    except Exception as error:
        if not child:
            raise
        log.error("failed", error=str(error) or type(error).__name__)
        sys.exit(1)


def _open_source(spec: str, table_map: Path | None, seconds: float | None, seed: int, luminance: str | None) -> Source:
    from services import simulated_light
    from tracker_bridge.sources import open_source
    from tracker_bridge.sources.simulated import SimulatedSettings

    simulated = SimulatedSettings(seconds=seconds or SIMULATED_SECONDS, seed=seed)
    if luminance is not None:
        simulated = msgspec.structs.replace(simulated, luminance=simulated_light.read(luminance))
    return open_source(spec, table_map=table_map, simulated=simulated)


def _direction(text: str) -> tuple[float, float]:
    try:
        azimuth_deg, elevation_deg = (float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is no direction: give two angles in degrees, like 5,-2", param_hint="--gaze"
        ) from None
    return azimuth_deg, elevation_deg


if __name__ == "__main__":
    main()
