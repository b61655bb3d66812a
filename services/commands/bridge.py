"""`entoptic bridge`: publishes a person's eyes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from entoptic.services.eye_data import open_eyes, open_live_eyes
from entoptic.services.options import BridgeKeysFolder, Child, Pace, Remote, Seconds, Seed, TableMap, UsbId
from entoptic.services.process import process
from entoptic.tracker_bridge.chain import Lane
from entoptic.tracker_bridge.sources.pupil_remote import DEFAULT_REMOTE


def bridge(
    source: Annotated[
        str,
        typer.Option(
            help="Eye data, as --recording of [b]entoptic session[/b]; or live: [b]capture[/b], [b]usb[/b], "
            "usb-simulated:RECORDING."
        ),
    ] = "simulated",
    table_map: TableMap = None,
    remote: Remote = DEFAULT_REMOTE,
    usb_id: UsbId = None,
    record_raw: Annotated[
        Path | None, typer.Option(help="File for all that a USB tracker sends; usb-file:PATH plays it.")
    ] = None,
    usb_fault: Annotated[
        list[str] | None, typer.Option(help="What goes wrong with a simulated USB tracker, like unplug@5s:2s.")
    ] = None,
    states: Annotated[
        str, typer.Option(help="Where eye states are published; * for a free port.")
    ] = "tcp://127.0.0.1:*",
    events: Annotated[str, typer.Option(help="Where events are published; * for a free port.")] = "tcp://127.0.0.1:*",
    replay: Annotated[
        str | None, typer.Option(help="Where lost events can be had again; a free port unless given.")
    ] = None,
    control: Annotated[
        str, typer.Option(help="Where [b]entoptic tell[/b] reaches this bridge; * for a free port.")
    ] = "tcp://127.0.0.1:*",
    keys: BridgeKeysFolder = None,
    lane: Annotated[
        Lane, typer.Option(help="States at once, or 50 ms later with blinks cut out more finely.")
    ] = Lane.LIVE,
    pupil_map: Annotated[Path | None, typer.Option(help="What diameters mean, from [b]entoptic calibrate[/b].")] = None,
    record: Annotated[
        Path | None, typer.Option(help="New folder for a recording of Pupil's form; survives a crash.")
    ] = None,
    pace: Annotated[
        Pace, typer.Option(help="By the recorded time, or as fast as the reader takes it.")
    ] = Pace.RECORDED,
    wait: Annotated[bool, typer.Option("--wait", help="Start when a reader has subscribed.")] = False,
    seconds: Seconds = None,
    seed: Seed = 0,
    luminance: Annotated[
        str | None, typer.Option(help="Light before a simulated eye: cd/m², or a CSV file t_s,cd_m2.")
    ] = None,
    live: Annotated[
        bool,
        typer.Option(
            "--live",
            help="As a part of a live session: recordings are played by the clock, simulated eyes have no end.",
        ),
    ] = False,
    begun_ns: Annotated[
        int | None,
        typer.Option(
            metavar="NS",
            help="When the source began, on the monotonic clock, for --live: it goes on where it is by now.",
        ),
    ] = None,
    screens: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Where pupil calibrations ask for their screens, for --live.")
    ] = None,
    answers: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Where the display of the screens answers, for --live.")
    ] = None,
    sees: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="A worker's frames: their light falls into simulated eyes, for --live."),
    ] = None,
    reader_keys: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Keys of a reader for --sees, if that worker has any.")
    ] = None,
    tables: Annotated[Path | None, typer.Option(help="Folder for states.csv and events.csv.")] = None,
    child: Child = False,
) -> None:
    """Publish a person's eyes: states at sample rate on one socket, events on another."""
    from entoptic.services import keys as key_files
    from entoptic.services.bridge import process as bridges
    from entoptic.tracker_bridge import pupil_map as pupil_maps
    from entoptic.tracker_bridge.sources import TrackerSettings

    _refuse_odd(live, begun_ns, screens, answers, sees, reader_keys)
    with process(child) as (stop, log):
        tracker = TrackerSettings(
            remote=remote, usb_id=usb_id, usb_faults=tuple(usb_fault or ()), record_raw=record_raw
        )
        session = None
        if live:
            eyes = open_live_eyes(source, table_map, seed, luminance, tracker, begun_ns)
            session = bridges.LiveBridgeSettings(
                screens_address=screens,
                answers_address=answers,
                sees_address=sees,
                reader_keys=None if reader_keys is None else key_files.load_client(reader_keys),
                goes_on=begun_ns is not None,
            )
        else:
            eyes = open_eyes(source, table_map, seconds, seed, luminance, tracker)
        bridges.run(
            eyes,
            bridges.BridgeSettings(
                states_address=states,
                events_address=events,
                replay_address=replay,
                control_address=control,
                keys=None if keys is None else key_files.load_server(keys),
                lane=lane,
                pupil_map=None if pupil_map is None else pupil_maps.read(pupil_map),
                real_time=pace is Pace.RECORDED,
                wait_for_reader=wait or pace is Pace.READER,
                seconds=seconds,
                tables=tables,
                recording=record,
                pupil_map_file=pupil_map,
                live=session,
            ),
            stop,
            log,
        )


def _refuse_odd(
    live: bool,
    begun_ns: int | None,
    screens: str | None,
    answers: str | None,
    sees: str | None,
    reader_keys: Path | None,
) -> None:
    """What goes with other options alone."""
    given = {"--begun-ns": begun_ns, "--screens": screens, "--answers": answers, "--sees": sees}
    for name, value in given.items():
        if value is not None and not live:
            raise typer.BadParameter("a live session alone has it: add --live, or leave it out", param_hint=name)
    if (screens is None) != (answers is None):
        raise typer.BadParameter("--screens and --answers are of use together alone", param_hint="--screens")
    if reader_keys is not None and sees is None:
        raise typer.BadParameter("they are for the worker that --sees names", param_hint="--reader-keys")
