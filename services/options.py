"""The options that several commands share."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from entoptic.tracker_bridge.chain import Lane


class Eyes(StrEnum):
    """Which eyes are rendered."""

    LEFT = "left"
    RIGHT = "right"
    BOTH = "both"


class Pace(StrEnum):
    """How fast a bridge publishes."""

    RECORDED = "recorded"
    READER = "reader"


class Save(StrEnum):
    """Forms in which perceived frames are kept."""

    VIDEO = "video"
    PNG = "png"
    EXR = "exr"


EyeSource = Annotated[
    str,
    typer.Option(
        "--source",
        "--recording",
        help="Eye data: [b]simulated[/b], a folder recorded by Pupil Capture, an export of Pupil Player, any "
        ".csv/.tsv table (see --map), or usb-file:PATH; with --live also [b]capture[/b], [b]usb[/b] and "
        "usb-simulated:RECORDING.",
    ),
]
TableMap = Annotated[
    Path | None,
    typer.Option("--map", help="TOML column map for a table: columns, units, decimal comma, eye, validity."),
]
SceneSpec = Annotated[
    str,
    typer.Option(
        help="What stands before the eyes: [b]night-street[/b], a panorama or picture (.hdr, .exr), or a folder "
        "of pictures."
    ),
]
MeanLuminance = Annotated[
    float | None,
    typer.Option(
        metavar="CD_M2", min=1e-9, max=1e9, help="Mean luminance of a scene whose file has no absolute scale."
    ),
]
Seconds = Annotated[float | None, typer.Option(min=0.001, help="How long; the whole recording unless given.")]
Fps = Annotated[float, typer.Option(min=0.1, max=1000, help="Frames per second.")]
Width = Annotated[int | None, typer.Option(min=1, max=16384, help="Pixels per eye; the scene's own unless given.")]
Height = Annotated[int | None, typer.Option(min=1, max=16384, help="Pixels per eye; the scene's own unless given.")]
Fov = Annotated[float, typer.Option(metavar="DEG", min=1, max=175, help="Horizontal field of view.")]
WhichEyes = Annotated[Eyes, typer.Option(help="Which eyes are rendered; both stand side by side.")]
Live = Annotated[
    bool, typer.Option("--live/--offline", help="By the clock, dropping frames; or every frame by recorded time.")
]
Seed = Annotated[int, typer.Option(min=0, help="Which simulated person.")]
Head = Annotated[
    str,
    typer.Option(
        help="How the head moves: [b]look-around[/b], still, gaze (follows the eyes), or a CSV file with the columns "
        "t_s,yaw_deg,pitch_deg,roll_deg."
    ),
]
SettingsFile = Annotated[
    Path | None,
    typer.Option(
        "--settings",
        help=r"TOML file with \[observer], \[display], \[plan] and a table for each effect; [b]entoptic psf "
        "--save-observer[/b] writes one.",
    ),
]
SaveOption = Annotated[
    list[Save], typer.Option("--save", help="How perceived frames are kept; may be given more than once.")
]
PupilMm = Annotated[
    float | None,
    typer.Option(min=0.5, max=12, help="Pupil diameter; computed from the light and the age unless given."),
]
Gaze = Annotated[str, typer.Option(metavar="X,Y", help="Direction of gaze in degrees, right and up.")]
AdaptedTo = Annotated[
    float | None,
    typer.Option(metavar="CD_M2", min=1e-6, max=1e9, help="Luminance the eye is adapted to; the image's unless given."),
]
Age = Annotated[float | None, typer.Option(min=1, max=120, help="Years; overrides the settings file.")]
OwnLights = Annotated[
    list[str],
    typer.Option(
        metavar="X,Y,LUX[,SPECTRUM[,RADIUS]]",
        help="A light of its own with its glare: direction in degrees, illuminance at the eye, spectrum (D65, A, "
        "LED-B3, …, or a CSV file) and radius in degrees. May be given more than once.",
    ),
]
BudgetMs = Annotated[
    float | None,
    typer.Option(
        min=0.1, max=1e6, help="Time that a frame may take: the plan of least error that fits; overrides the settings."
    ),
]
Everything = Annotated[
    bool, typer.Option("--everything", help="Every effect in full, whether a frame calls for it or not.")
]
Without = Annotated[
    list[str],
    typer.Option(
        metavar="EFFECT",
        help="Leave an effect out: glare, acuity, rod_noise, night_colour, afterimage. May be given more than once.",
    ),
]
BridgeKeysFolder = Annotated[
    Path | None,
    typer.Option(
        "--keys", metavar="FOLDER", help="Keys of this bridge, from [b]entoptic keys[/b]; needed off loopback."
    ),
]
ClientKeysFolder = Annotated[
    Path | None,
    typer.Option(
        "--keys", metavar="FOLDER", help="Keys of this reader, from [b]entoptic keys[/b], if the bridge has any."
    ),
]
Remote = Annotated[str, typer.Option(help="Where Pupil Remote listens, for [b]capture[/b].")]
UsbFaults = Annotated[
    list[str], typer.Option("--usb-fault", help="What goes wrong with a simulated USB tracker, like unplug@5s:2s.")
]
LaneOption = Annotated[
    Lane, typer.Option("--lane", help="States at once, or 50 ms later with blinks cut out more finely.")
]
PupilMapFile = Annotated[
    Path | None, typer.Option("--pupil-map", help="What diameters mean, from [b]entoptic calibrate[/b].")
]
ConsoleHost = Annotated[
    str, typer.Option(help="Where the console's page is served; another than 127.0.0.1 needs a --token.")
]
ConsolePort = Annotated[int, typer.Option("--port", min=0, max=65535, help="Of the console's page; 0 for any.")]
ConsoleToken = Annotated[
    str | None,
    typer.Option("--token", help="What a browser must show, or a file that holds it; needed beyond this machine."),
]
ConsoleNames = Annotated[
    list[str],
    typer.Option("--allow-host", metavar="NAME", help="Another name of this machine. May be given more than once."),
]
UsbId = Annotated[
    str | None, typer.Option(metavar="VID:PID", help="Which USB eye tracker; the first one unless given.")
]
Child = Annotated[bool, typer.Option(hidden=True)]
