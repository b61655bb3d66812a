"""`entoptic simulate`: a simulated recording with its truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from entoptic.services.command_line import options
from entoptic.services.config import Seed, SourceConfig
from entoptic.services.eye_data import open_eyes
from entoptic.services.terminal import console


@options
def simulate(
    out: Annotated[Path, typer.Option(help="Folder to write: a Pupil recording, and truth.csv beside it.")],
    seconds: Annotated[float, typer.Option(min=0.1, max=3600, help="How long.")] = 30.0,
    seed: Seed = 0,
    luminance: Annotated[str, typer.Option(help="Light before the eyes: cd/m², or a CSV file t_s,cd_m2.")] = "100",
) -> None:
    """Write a simulated recording with its truth: gaze, microsaccades, blinks, pupils."""
    from entoptic.tracker_bridge.sources.pupil_core.recorder import write_recording
    from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes

    source = open_eyes(SourceConfig(seed=seed), seconds, luminance)
    assert isinstance(source, SimulatedEyes)
    write_recording(source, out)
    source.write_truth_csv(out / "truth.csv")
    console.print(f"results: [b]{escape(str(out.resolve()))}[/b]", soft_wrap=True)
