"""What each process is started with: by its command line, or by the process that starts it (child.py)."""

from __future__ import annotations

from typing import Annotated

import msgspec

from entoptic.described import described
from entoptic.services.config import Address, EyesConfig, ReaderKeys, Seconds


class BridgeConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How a source is published."""

    eyes: EyesConfig = EyesConfig()
    states: Annotated[Address, described("Where eye states are published; * for a free port.")] = "tcp://127.0.0.1:*"
    events: Annotated[Address, described("Where events are published; * for a free port.")] = "tcp://127.0.0.1:*"
    replay: Annotated[
        Address | None, described("Where lost events can be had again; a free port of the events' host unless given.")
    ] = None
    control: Annotated[Address, described("Where entoptic tell reaches this bridge; * for a free port.")] = (
        "tcp://127.0.0.1:*"
    )
    keys: Annotated[
        str | None, described("Keys of this bridge, from entoptic keys; needed off loopback.", metavar="FOLDER")
    ] = None
    record: Annotated[
        str | None, described("New folder for a recording of Pupil's form; survives a crash.", metavar="FOLDER")
    ] = None
    record_raw: Annotated[
        str | None, described("File for all that a USB tracker sends; usb-file:PATH plays it.", metavar="FILE")
    ] = None
    seconds: Seconds | None = None
    luminance: Annotated[str | None, described("Light before a simulated eye: cd/m², or a CSV file t_s,cd_m2.")] = None
    live: Annotated[
        bool, described("As a part of a live session: recordings are played by the clock, simulated eyes have no end.")
    ] = False
    begun_ns: Annotated[
        int | None,
        described(
            "When the source began, on the monotonic clock, for --live: it goes on where it is by now.", metavar="NS"
        ),
    ] = None
    screens: Annotated[
        Address | None, described("Where pupil calibrations ask a display for their screens, for --live.")
    ] = None
    answers: Annotated[Address | None, described("Where that display answers, for --live.")] = None
    sees: Annotated[
        Address | None, described("A worker's frames: their light falls into simulated eyes, for --live.")
    ] = None
    reader_keys: Annotated[
        str | None, described("Keys of a reader for --sees, if that worker has any.", metavar="FOLDER")
    ] = None


class WorkerLinks(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Whom a worker hears, and who hears it."""

    states: Annotated[Address, described("Where a bridge publishes eye states.")]
    events: Annotated[Address, described("Where it publishes events.")]
    out: Annotated[
        str | None, described("Folder for a recording from the first frame on; none unless given.", metavar="FOLDER")
    ] = None
    frames: Annotated[Address | None, described("Publish frames there, like tcp://127.0.0.1:*.")] = None
    control: Annotated[Address | None, described("Be told there what to do, and run until stopped.")] = None
    resume: Annotated[
        str | None, described("Go on from this checkpoint if it is there, and keep it.", metavar="FILE")
    ] = None
    keys: ReaderKeys = None
    server_keys: Annotated[
        str | None, described("Keys for --frames and --control, from entoptic keys.", metavar="FOLDER")
    ] = None


class PageConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the console's page is served."""

    host: Annotated[str, described("Where the console's page is served; another than 127.0.0.1 needs a --token.")] = (
        "127.0.0.1"
    )
    port: Annotated[int, described("Of the console's page; 0 for any.", ge=0, le=65535)] = 8080
    token: Annotated[
        str | None, described("What a browser must show, or a file that holds it; needed beyond this machine.")
    ] = None
    names: Annotated[
        tuple[str, ...],
        described("Another name of this machine. May be given more than once.", option="--allow-host", metavar="NAME"),
    ] = ()


class FoldersConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the console finds and keeps things."""

    root: Annotated[str, described("Folder of the sessions.", metavar="FOLDER")] = "sessions"
    observers: Annotated[str, described("Folder where settings are saved.", metavar="FOLDER")] = "observers"
    inputs: Annotated[str | None, described("Folder of scenes and recordings to choose from.", metavar="FOLDER")] = None


class PageLinks(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Whom the console's server hears: the program that runs sessions, or a bridge and a worker by themselves."""

    host_control: Annotated[Address | None, described("Control of the program that runs sessions.")] = None
    states: Annotated[Address | None, described("Where a bridge publishes eye states.")] = None
    events: Annotated[Address | None, described("Where it publishes events.")] = None
    bridge: Annotated[Address | None, described("Its control.")] = None
    screens: Annotated[Address | None, described("Where it asks for the screens of pupil calibrations.")] = None
    answers: Annotated[Address | None, described("Where it is answered.")] = None
    frames: Annotated[Address | None, described("Where a worker publishes frames.")] = None
    worker: Annotated[Address | None, described("Its control.")] = None
    keys: Annotated[
        str | None, described("This reader's keys, where bridge and worker have some.", metavar="FOLDER")
    ] = None
    worker_keys: Annotated[str | None, described("Those for the worker, where they are others.", metavar="FOLDER")] = (
        None
    )
    no_token: Annotated[bool, described("Ask for none: where the port is reached from this machine alone.")] = False


class ServerConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How the console's server runs."""

    page: PageConfig = PageConfig()
    folders: FoldersConfig = FoldersConfig()
    links: PageLinks = PageLinks()
