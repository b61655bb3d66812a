"""`entoptic worker`: renders what a bridge publishes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
import typer

from services.options import (
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
from services.process import cache_folder, prepare_jax, process


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
    eyes: WhichEyes = Eyes.LEFT,
    live: Live = False,
    head: Head = "look-around",
    settings: SettingsFile = None,
    budget_ms: BudgetMs = None,
    everything: Everything = False,
    without: Without = [],  # noqa: B006
    save: SaveOption = [Save.VIDEO],  # noqa: B006
    keys: ClientKeysFolder = None,
    child: Child = False,
) -> None:
    """Render what a bridge publishes."""
    with process(child) as (stop, log):
        prepare_jax()
        from pipeline.budget import SHIPPED
        from pipeline.budget import load as load_costs
        from pipeline.scenes import open_scene
        from pipeline.scenes.head_path import open_head_path
        from services import keys as key_files
        from services import worker as workers
        from services.reader import StateReader
        from services.settings import load, planned
        from tracker_bridge.wire import Eye

        perception = planned(load(settings), budget_ms, everything, without)
        opened = open_scene(scene, mean_luminance_cd_m2=mean_luminance)
        path = open_head_path(head)
        view = opened.view_for(width, height, fov)
        chosen = {Eyes.LEFT: (Eye.LEFT,), Eyes.RIGHT: (Eye.RIGHT,), Eyes.BOTH: (Eye.LEFT, Eye.RIGHT)}[eyes]
        out.mkdir(parents=True, exist_ok=True)
        client = None if keys is None else key_files.load_client(keys)
        reader = StateReader(states, events, newest_only=live, keys=client)
        try:
            job = workers.WorkerSettings(view, fps, chosen, live, seconds, out, frozenset(save))
            costs = load_costs(cache_folder()) if live else SHIPPED
            summary = workers.run(reader, opened, path, job, perception, stop, log, costs)
        finally:
            reader.close()
        log.info("ended", **msgspec.to_builtins(summary))
