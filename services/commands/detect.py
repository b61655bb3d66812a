"""`entoptic detect`: the saccades, microsaccades and blinks in a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from entoptic.services.command_line import options
from entoptic.services.config import SourceConfig, TableMap
from entoptic.services.eye_data import open_eyes
from entoptic.services.terminal import console


@options
def detect(
    recording: Annotated[
        str,
        typer.Argument(
            help="Eye data: a folder recorded by Pupil Capture, an export of Pupil Player, or any .csv/.tsv table (see "
            "--map)."
        ),
    ],
    out: Annotated[Path, typer.Option(help="CSV file to write, one line an event.")] = Path("events.csv"),
    labels: Annotated[
        Path | None,
        typer.Option(help="CSV file with the true events: onset_s, offset_s and kind, or a simulation's truth.csv."),
    ] = None,
    table_map: TableMap = None,
    plot: Annotated[
        Path | None, typer.Option(help="PNG file to draw: peak velocity over amplitude, the main sequence.")
    ] = None,
) -> None:
    """Find saccades, microsaccades and blinks in a recording, by the code that finds them live."""
    from entoptic.services import detect as detection
    from entoptic.services.event_scores import error_text
    from entoptic.tracker_bridge.source import SourceError

    labelled = None if labels is None else detection.read_labels(labels)
    source = open_eyes(SourceConfig(source=recording, table_map=table_map))
    if source.info.live:
        raise SourceError(f"{recording} is live and does not end: record it first, then name the recording")
    found = detection.detect(source)
    detection.write_csv(out, found)
    kinds = [event.kind for event in found]
    at_blink = sum(event.at_blink is True for event in found)
    console.print(
        f"{kinds.count('microsaccade')} microsaccades, {kinds.count('saccade')} saccades, {kinds.count('blink')} "
        f"blinks of one eye; {at_blink} movements lie at a blink and may be the lid's",
        soft_wrap=True,
    )
    if labelled is not None:
        for name, scores in detection.score(found, labelled).items():
            console.print(
                f"{name}: {scores.found} found, {scores.labelled} labelled, precision {scores.precision:.3f}, "
                f"recall {scores.recall:.3f}, F1 {scores.f1:.3f}; onsets {error_text(scores.onset_errors_ms)} ms, "
                f"offsets {error_text(scores.offset_errors_ms)} ms",
                soft_wrap=True,
            )
        console.print("Errors: bias / median size / 90 % of the sizes. Movements at a blink are not scored.")
    if plot is not None:
        detection.plot_main_sequence(plot, found, source.info.name)
        console.print(f"plot: [b]{escape(str(plot.resolve()))}[/b]", soft_wrap=True)
    console.print(f"results: [b]{escape(str(out.resolve()))}[/b]", soft_wrap=True)
