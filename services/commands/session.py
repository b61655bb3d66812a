"""`entoptic session`: eye data and a scene in, a video and a report out."""

from __future__ import annotations

import dataclasses
import shutil
from datetime import datetime
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.markup import escape

from services.eye_data import SIMULATED_SECONDS, open_eyes
from services.options import (
    BudgetMs,
    Everything,
    Eyes,
    Fov,
    Fps,
    Head,
    Height,
    Live,
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
    WhichEyes,
    Width,
    Without,
)
from services.process import Stop, prepare_jax
from services.terminal import console


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
    eyes: WhichEyes = Eyes.LEFT,
    seed: Seed = 0,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; sessions/<time> unless given.")] = None,
    live: Live = False,
    head: Head = "look-around",
    settings: SettingsFile = None,
    budget_ms: BudgetMs = None,
    everything: Everything = False,
    without: Without = [],  # noqa: B006
    save: SaveOption = [Save.VIDEO],  # noqa: B006 - typer copies it
) -> None:
    """Render what a person would have perceived: eye data and a scene in, a video and a report out."""
    from services import report, simulated_light
    from services import session as sessions
    from services.results_folder import results_folder

    prepare_jax()
    from pipeline.scenes import open_scene
    from pipeline.scenes.head_path import open_head_path
    from services.settings import load, planned
    from tracker_bridge.sources import SIMULATED

    if recording == SIMULATED and seconds is None:
        seconds = SIMULATED_SECONDS
    # All input is looked at before anything is started or written.
    opened_scene = open_scene(scene, mean_luminance_cd_m2=mean_luminance)
    view = opened_scene.view_for(width, height, fov)
    open_head_path(head)
    perception = planned(load(settings), budget_ms, everything, without)
    source = open_eyes(recording, table_map, seconds, seed, None)
    if source.info.live and not live:
        raise sessions.SessionError(f"{source.info.name} measures at its own pace: add --live, or name a recording")
    for note in (*source.info.notes, *opened_scene.notes):
        console.print(f"• {escape(note)}")
    console.print(
        f"[b]{escape(source.info.name)}[/b] before [b]{escape(opened_scene.name)}[/b], "
        f"{view.width_px}×{view.height_px} px per eye"
    )
    final = out or Path("sessions") / f"{datetime.now():%Y-%m-%d_%H-%M-%S}"
    stop = Stop().on_signals()
    with results_folder(final) as folder:
        bridge_arguments = ["--source", recording, "--seed", str(seed), "--wait", "--tables", str(folder)]
        bridge_arguments += ["--pace", (Pace.RECORDED if live else Pace.READER).value]
        worker_arguments = ["--scene", scene, "--fps", str(fps), "--width", str(view.width_px)]
        worker_arguments += ["--height", str(view.height_px), "--fov", str(fov), "--eyes", eyes.value]
        worker_arguments += ["--head", head, "--out", str(folder), "--live" if live else "--offline"]
        if budget_ms is not None:
            worker_arguments += ["--budget-ms", str(budget_ms)]
        if everything:
            worker_arguments.append("--everything")
        for effect in without:
            worker_arguments += ["--without", effect]
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
            "perception": msgspec.to_builtins(perception, order="deterministic"),
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
