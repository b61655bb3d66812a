"""What commands are started with: records from which command lines and the console's form are made.

Paths are strings, relative to the folder in which a command is started. session_config.py puts these parts together.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import msgspec
from msgspec import Meta

from entoptic.described import described
from entoptic.tracker_bridge.calibration import SECONDS_RANGE
from entoptic.tracker_bridge.chain import LatencyMode
from entoptic.tracker_bridge.sources import SPECS
from entoptic.tracker_bridge.sources.pupil_core.remote import DEFAULT_REMOTE


class Eyes(StrEnum):
    """Which eyes are rendered."""

    LEFT = "left"
    RIGHT = "right"
    BOTH = "both"


class Save(StrEnum):
    """Forms in which perceived frames are kept."""

    VIDEO = "video"
    PNG = "png"
    EXR = "exr"


Address = Annotated[str, Meta(extra={"metavar": "ADDRESS"})]
Seconds = Annotated[
    float, described("How long; the whole recording unless given.", "Seconds", ge=0.001, first=True, option="--seconds")
]
MeanLuminance = Annotated[
    float,
    described(
        "Mean luminance in cd/m² of a scene whose file has no absolute scale.",
        "Mean luminance, cd/m²",
        ge=1e-9,
        le=1e9,
        option="--mean-luminance",
        metavar="CD_M2",
    ),
]
Pixels = Annotated[int, Meta(ge=1, le=16384)]
WidthPx = Annotated[
    Pixels,
    described("Pixels per eye; the scene's own unless given.", "Width of an image, px", first=True, option="--width"),
]
HeightPx = Annotated[
    Pixels,
    described("Pixels per eye; the scene's own unless given.", "Height of an image, px", first=True, option="--height"),
]
FovDeg = Annotated[
    float,
    described(
        "Horizontal field of view in degrees.",
        "Field of view, °",
        ge=1.0,
        le=175.0,
        first=True,
        option="--fov",
        metavar="DEG",
    ),
]
TableMap = Annotated[
    str | None,
    described(
        "TOML column map for a table: columns, units, decimal comma, eye, validity.",
        "Column map",
        option="--map",
        metavar="FILE",
    ),
]
WhiteS = Annotated[
    float, described("Of each white screen.", ge=SECONDS_RANGE[0], le=SECONDS_RANGE[1], option="--white-seconds")
]
BlackS = Annotated[
    float, described("Of the black screen.", ge=SECONDS_RANGE[0], le=SECONDS_RANGE[1], option="--black-seconds")
]
Seed = Annotated[int, described("Which simulated person.", "Simulated person", ge=0)]
ReaderKeys = Annotated[
    str | None,
    described("Keys of this reader, from entoptic keys, if the bridge has any.", metavar="FOLDER", option="--keys"),
]


class SourceConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Eye data."""

    source: Annotated[
        str,
        described(
            SPECS,
            "Eyes",
            option=("--source", "--recording"),
            first=True,
            list="sources",
        ),
    ] = "simulated"
    table_map: TableMap = None
    remote: Annotated[str, described("Where Pupil Remote listens, for capture.", "Capture's address")] = DEFAULT_REMOTE
    usb_id: Annotated[
        str | None, described("Which USB eye tracker; the first one unless given.", "USB device", metavar="VID:PID")
    ] = None
    seed: Seed = 0


class EyesConfig(SourceConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the state of the eyes comes from, and what is made of it."""

    usb_faults: Annotated[
        tuple[str, ...],
        described(
            "What goes wrong with a simulated USB tracker, like unplug@5s:2s. May be given more than once.",
            "Faults",
            option="--usb-fault",
        ),
    ] = ()
    pupil_map: Annotated[
        str | None,
        described(
            "What diameters mean: a file that a pupil calibration wrote.",
            "Pupil map",
            metavar="FILE",
            list="pupil maps",
        ),
    ] = None
    latency_mode: Annotated[
        LatencyMode, described("States at once, or 50 ms later with blinks cut out more finely.", "Latency mode")
    ] = LatencyMode.LIVE


class ViewConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is in front of the eyes, and how it is rendered and kept."""

    scene: Annotated[
        str,
        described(
            "What the eyes look at: night-street, a panorama or picture (.hdr, .exr), or a folder of pictures.",
            "Scene",
            first=True,
            list="scenes",
        ),
    ] = "night-street"
    mean_luminance_cd_m2: MeanLuminance | None = None
    eyes: Annotated[
        Eyes, described("Which eyes are rendered; both stand side by side.", "Rendered eyes", first=True)
    ] = Eyes.LEFT
    fps: Annotated[float, described("Frames per second.", "Frames a second", ge=0.1, le=1000.0, first=True)] = 24.0
    seconds: Seconds | None = None
    width_px: WidthPx | None = None
    height_px: HeightPx | None = None
    fov_deg: FovDeg = 104.0
    head: Annotated[
        str,
        described(
            "How the head moves: look-around, still, gaze (follows the eyes), or a CSV file with the columns "
            "t_s,yaw_deg,pitch_deg,roll_deg.",
            "Head",
        ),
    ] = "look-around"
    save: Annotated[
        tuple[Save, ...], described("How perceived frames are kept; may be given more than once.", "Frames are kept as")
    ] = (Save.VIDEO,)


class CalibrationProtocol(StrEnum):
    """Which screens are shown, and what is taken of them."""

    ROBUST = "robust"
    LUIDOLT = "luidolt"


class CalibrationConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How pupils are calibrated."""

    protocol: Annotated[
        CalibrationProtocol, described("White, black, white, medians; or the thesis's black, white, means.")
    ] = CalibrationProtocol.ROBUST
    white_s: WhiteS | None = None
    black_s: BlackS | None = None
    eyes: Annotated[Eyes, described("Leave an eye out that cannot be tracked.")] = Eyes.BOTH
    map_mm: Annotated[bool, described("Map a tracker's millimetres onto 2–8 mm too, as the thesis does.")] = False


class ObserverConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the settings of observer, display, plan and effects come from; services.settings.of makes them."""

    file: Annotated[
        str | None,
        described(
            "TOML file with [observer], [display], [plan] and a table for each effect; entoptic psf --save-observer "
            "writes one.",
            option="--settings",
            metavar="FILE",
        ),
    ] = None
    changes: Annotated[
        tuple[str, ...],
        described(
            "One setting, over the file's, like observer.age_years=60, or age_years=60 where no other has that name. "
            "May be given more than once.",
            option="--set",
            metavar="KEY=VALUE",
        ),
    ] = ()


class SettingsConfig(ObserverConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The same, with what is left out."""

    budget_ms: Annotated[
        float | None,
        described(
            "Time that a frame may take: the plan of least error that fits; overrides the settings.", metavar="MS"
        ),
    ] = None
    everything: Annotated[bool, described("Every effect in full, whether a frame calls for it or not.")] = False
    without: Annotated[
        tuple[str, ...], described("Leave an effect out. May be given more than once.", metavar="EFFECT")
    ] = ()


class StillConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How one picture is seen."""

    pupil_diameter_mm: (
        Annotated[
            float,
            described("Pupil diameter; computed from the light and the age unless given.", ge=0.5, le=12.0),
        ]
        | None
    ) = None
    gaze: Annotated[str, described("Direction of gaze in degrees, right and up.", metavar="X,Y")] = "0,0"
    adaptation: (
        Annotated[
            float,
            described("Luminance the eye is adapted to; the image's unless given.", ge=1e-6, le=1e9, metavar="CD_M2"),
        ]
        | None
    ) = None
    mean_luminance_cd_m2: MeanLuminance | None = None
    width_px: WidthPx | None = None
    height_px: HeightPx | None = None
    fov_deg: FovDeg = 104.0
    lights: Annotated[
        tuple[str, ...],
        described(
            "A light of its own with its glare: direction in degrees, illuminance at the eye, spectrum (D65, A, "
            "LED-B3, …, or a CSV file) and radius in degrees. May be given more than once.",
            option="--light",
            metavar="X,Y,LUX[,SPECTRUM[,RADIUS]]",
        ),
    ] = ()
