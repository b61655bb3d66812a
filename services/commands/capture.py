"""`entoptic capture`: a stand-in for Pupil Capture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from entoptic.services.command_line import options
from entoptic.services.config import Seed, TableMap
from entoptic.services.process import process


@options
def capture(
    eyes: Annotated[
        str,
        typer.Argument(
            metavar="RECORDING", help="Eye data, as --recording of [b]entoptic session[/b]; simulated ones never end."
        ),
    ] = "simulated",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Of Pupil Remote; 0 for a free one.")] = 50020,
    host: Annotated[str, typer.Option(help="Address that clients connect to; 0.0.0.0 for all.")] = "127.0.0.1",
    table_map: TableMap = None,
    loop: Annotated[bool, typer.Option("--loop", help="A recording begins again at its end.")] = False,
    seconds: Annotated[float | None, typer.Option(min=0.001, help="How long; to the data's end unless given.")] = None,
    seed: Seed = 0,
    luminance: Annotated[
        str | None, typer.Option(help="Light before a simulated eye: cd/m², or a CSV file t_s,cd_m2.")
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            help="What goes wrong: NAME@START:DURATION with restart, silence, late=3s, duplicate, corrupt, backwards, "
            "drift=200ppm, timebase=+100s, stuck; may be given more than once."
        ),
    ] = None,
    recordings: Annotated[Path, typer.Option(help="Where recordings go that clients ask for.")] = Path("recordings"),
    child: Annotated[bool, typer.Option(hidden=True)] = False,
) -> None:
    """Stand in for Pupil Capture: its network API, with recorded or simulated eyes."""
    import msgspec

    from entoptic.services import simulated_light
    from entoptic.tracker_bridge.capture_twin.faults import read_fault
    from entoptic.tracker_bridge.capture_twin.playback import open_playback
    from entoptic.tracker_bridge.capture_twin.standin import StandIn, StandInSettings
    from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedSettings

    with process(child) as (stop, log):
        planned = tuple(read_fault(spec) for spec in fault or ())
        simulated = SimulatedSettings(seed=seed)
        if luminance is not None:
            simulated = msgspec.structs.replace(simulated, luminance=simulated_light.read(luminance))
        playback = open_playback(
            eyes, simulated=simulated, table_map=None if table_map is None else Path(table_map), loop=loop
        )
        settings = StandInSettings(port, recordings, host=host, seed=seed, faults=planned, seconds=seconds)
        StandIn(playback, settings, log).run(stop)
        log.info("ended")
