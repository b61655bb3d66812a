"""`entoptic worker`: renders what a bridge publishes."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from entoptic.services.options import (
    BudgetMs,
    Child,
    ClientKeysFolder,
    Everything,
    Eyes,
    Fov,
    Fps,
    Head,
    Height,
    Live,
    MeanLuminance,
    Save,
    SaveOption,
    SceneSpec,
    Seconds,
    SettingsFile,
    WhichEyes,
    Width,
    Without,
)
from entoptic.services.process import cache_folder, prepare_jax, process


def worker(
    states: Annotated[str, typer.Option(help="Where a bridge publishes eye states.")] = "",
    events: Annotated[str, typer.Option(help="Where it publishes events.")] = "",
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; with --live nothing is kept unless given.")
    ] = None,
    scene: SceneSpec = "night-street",
    mean_luminance: MeanLuminance = None,
    seconds: Seconds = None,
    fps: Fps = 24.0,
    width: Width = None,
    height: Height = None,
    fov: Fov = 104.0,
    eyes: WhichEyes = Eyes.LEFT,
    live: Live = False,
    head: Head = "look-around",
    settings: SettingsFile = None,
    budget_ms: BudgetMs = None,
    everything: Everything = False,
    without: Without = [],  # noqa: B006
    save: SaveOption = [Save.VIDEO],  # noqa: B006
    frames: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="With --live: publish frames there, tcp://127.0.0.1:*.")
    ] = None,
    control: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="With --live: be told there what to do, and run until stopped."),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="With --live: go on from this checkpoint if it is there, and keep it."),
    ] = None,
    keys: ClientKeysFolder = None,
    server_keys: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Keys for --frames and --control, from [b]entoptic keys[/b]."),
    ] = None,
    again: Annotated[Path | None, typer.Option(hidden=True)] = None,
    child: Child = False,
) -> None:
    """Render what a bridge publishes."""
    if again is None and not (states and events):
        raise typer.BadParameter("give the addresses that the bridge said, --states and --events")
    if out is None and (again is not None or not live):
        raise typer.BadParameter("give a folder for the results, --out")
    if not live and (frames or control or resume):
        raise typer.BadParameter("--frames, --control and --resume go with --live")
    with process(child) as (stop, log):
        prepare_jax()
        if again is not None:
            from entoptic.services.worker import again as render_again

            assert out is not None
            out.mkdir(parents=True, exist_ok=True)
            done = render_again.run(again, out, frozenset(save), stop, log)
            said = msgspec.to_builtins(done.summary)
            log.info("ended", **said, first_different=done.first_different, note=done.note)
            return
        from entoptic.pipeline.budget import SHIPPED
        from entoptic.pipeline.budget import load as load_costs
        from entoptic.pipeline.scenes import open_scene
        from entoptic.pipeline.scenes.head_path import open_head_path
        from entoptic.services import keys as key_files
        from entoptic.services.reader import StateReader
        from entoptic.services.settings import load, planned
        from entoptic.services.worker import offline as workers
        from entoptic.services.worker.checkpoint import Job
        from entoptic.services.worker.rendering import Rendering
        from entoptic.tracker_bridge.wire import Eye

        perception = planned(load(settings), budget_ms, everything, without)
        opened = open_scene(scene, mean_luminance_cd_m2=mean_luminance)
        path = open_head_path(head)
        view = opened.view_for(width, height, fov)
        chosen = {Eyes.LEFT: (Eye.LEFT,), Eyes.RIGHT: (Eye.RIGHT,), Eyes.BOTH: (Eye.LEFT, Eye.RIGHT)}[eyes]
        job = Job(scene, mean_luminance, view, fps, chosen, head)
        costs = load_costs(cache_folder()) if live else SHIPPED
        rendering = Rendering(opened, view, chosen, perception, costs)
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
        reader = StateReader(
            states, events, newest_only=live, keys=None if keys is None else key_files.load_client(keys)
        )
        try:
            if live:
                from entoptic.services.worker import live as live_worker

                how = live_worker.LiveWorkerSettings(
                    job, frozenset(save), out, seconds, resume, hosted=control is not None
                )
                server = None if server_keys is None else key_files.load_server(server_keys)
                summary = live_worker.run(
                    reader, rendering, path, how, stop, log, frames=frames, control=control, keys=server
                )
            else:
                assert out is not None
                summary = workers.run(reader, rendering, path, job, out, frozenset(save), seconds, stop, log)
        finally:
            reader.close()
        log.info("ended", **({} if summary is None else msgspec.to_builtins(summary)))
    if child:
        # All files and sockets are closed; the interpreter takes seconds to take compiled code apart.
        sys.stderr.flush()
        os._exit(0)
