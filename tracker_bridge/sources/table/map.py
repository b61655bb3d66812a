"""Column maps: TOML files that say what the columns of a table mean.

A map for a tracker that writes both eyes on one line:

    name = "My tracker"                 # for messages
    delimiter = "\\t"                    # "," (default), ";" or "\\t"
    decimal = ","                       # "." (default), "," or "either"
    missing = ["", "-1"]                # cells without a value; default "", "NaN", "nan", "NA"
    where = { Sensor = "Eye Tracker" }  # only lines with these cells; default all
    time = { column = "Timestamp", unit = "us" }                          # s, ms, us, ns

    [right]                             # and the same under [left]; each key may be left out
    diameter = { column = "Pupil right", unit = "mm" }                    # mm, um, m, px
    openness = { column = "Lid right", unit = "mm" }                      # fraction, percent, mm, px
    confidence = { column = "Quality right", unit = "percent" }           # fraction, percent
    validity = { column = "Valid right", valid = ["1"] }
    gaze = { kind = "vector", right = "X", up = "Y", forward = "Z", signs = [1, -1, -1] }
    # or   { kind = "angles", azimuth = "H", elevation = "V", unit = "deg", signs = [1, -1] }        # deg, rad
    # or   { kind = "screen", x = "GX", y = "GY", width = 1920, height = 1080, width_mm = 530.0, height_mm = 300.0,
    #        distance_mm = 650.0, origin = "top left" }                   # "bottom left", "centre"

    [both]                              # the direction of both eyes together; also confidence, validity
    gaze = { kind = "vector", right = "GX", up = "GY", forward = "GZ" }   # signs default to 1

A table with one line per eye has `eye = { column = "eye", right = ["R"], left = ["L"] }` and `[each]` in place of
`[right]` and `[left]`.
"""

from __future__ import annotations

import importlib.resources
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.cells import MISSING

Sign = Literal[1, -1]
ExtentOwn = Annotated[float, msgspec.Meta(ge=1e-6, le=1e6)]
ExtentMm = Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A part of a map: a key that it does not know is an error, never ignored."""


class TimeColumn(_Strict, frozen=True):
    """When a line was measured."""

    column: str
    unit: Literal["s", "ms", "us", "ns"]


class DiameterColumn(_Strict, frozen=True):
    """The pupil's diameter; px do not make a diameter in mm."""

    column: str
    unit: Literal["mm", "um", "m", "px"]


class OpennessColumn(_Strict, frozen=True):
    """How far the lids are apart; lengths are divided by what this eye has when it is wide open."""

    column: str
    unit: Literal["fraction", "percent", "mm", "px"]


class ConfidenceColumn(_Strict, frozen=True):
    """How sure the tracker is."""

    column: str
    unit: Literal["fraction", "percent"]


class ValidityColumn(_Strict, frozen=True):
    """Whether the tracker calls its measurement valid: the cells that mean so."""

    column: str
    valid: tuple[str, ...]


class EyeColumn(_Strict, frozen=True):
    """Which eye a line is about: the cells that mean so; other lines are left out."""

    column: str
    right: tuple[str, ...]
    left: tuple[str, ...]


class VectorGaze(_Strict, frozen=True, tag_field="kind", tag="vector"):
    """A direction as a vector of any length: the columns along its three axes, each with its sign."""

    right: str
    up: str
    forward: str
    signs: tuple[Sign, Sign, Sign] = (1, 1, 1)


class AngleGaze(_Strict, frozen=True, tag_field="kind", tag="angles"):
    """A direction as two angles, to the right and upwards where the signs are 1."""

    azimuth: str
    elevation: str
    unit: Literal["deg", "rad"]
    signs: tuple[Sign, Sign] = (1, 1)


class ScreenGaze(_Strict, frozen=True, tag_field="kind", tag="screen"):
    """A direction as a place on a flat screen whose centre is straight ahead of the head, square to the view."""

    x: str
    y: str
    width: ExtentOwn
    """Of the screen, in the columns' own unit: pixels, mm, or 1."""
    height: ExtentOwn
    width_mm: ExtentMm
    height_mm: ExtentMm
    distance_mm: ExtentMm
    """From the eyes to the screen's centre."""
    origin: Literal["top left", "bottom left", "centre"] = "top left"
    """Where x and y are 0; y runs down from the top left, up from the others."""


Gaze = VectorGaze | AngleGaze | ScreenGaze


class GazeChannels(_Strict, frozen=True):
    """What a table says of both eyes together."""

    gaze: Gaze
    confidence: ConfidenceColumn | None = None
    validity: ValidityColumn | None = None


class EyeChannels(_Strict, frozen=True):
    """What a table says of one eye."""

    diameter: DiameterColumn | None = None
    openness: OpennessColumn | None = None
    gaze: Gaze | None = None
    confidence: ConfidenceColumn | None = None
    validity: ValidityColumn | None = None


class TableMap(_Strict, frozen=True):
    """What the columns of a table mean."""

    name: str
    time: TimeColumn
    delimiter: Literal[",", ";", "\t"] = ","
    decimal: Literal[".", ",", "either"] = "."
    """What stands before the decimals; "either" is for programs that follow the language of the computer."""
    missing: tuple[str, ...] = MISSING
    where: dict[str, str] = {}
    eye: EyeColumn | None = None
    right: EyeChannels | None = None
    left: EyeChannels | None = None
    each: EyeChannels | None = None
    both: GazeChannels | None = None

    def columns(self) -> tuple[str, ...]:
        """Every column that the map names, each once."""
        return tuple(dict.fromkeys([*self.where, *_columns_of(self)]))


def _columns_of(part: msgspec.Struct) -> Iterator[str]:
    if isinstance(part, VectorGaze):
        yield from (part.right, part.up, part.forward)
    elif isinstance(part, AngleGaze):
        yield from (part.azimuth, part.elevation)
    elif isinstance(part, ScreenGaze):
        yield from (part.x, part.y)
    else:
        for field in part.__struct_fields__:
            value = getattr(part, field)
            if field == "column":
                yield value
            elif isinstance(value, msgspec.Struct):
                yield from _columns_of(value)


def read_table_map(path: Path) -> TableMap:
    """The map in a TOML file. Raises SourceError that names the file and the key at fault."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SourceError(f"column map {path} cannot be read: {error}. Check its name, or write one") from None
    return _parsed(text, str(path))


def shipped_maps() -> dict[str, TableMap]:
    """The maps that come with the program, by the name of their file without ending."""
    files = importlib.resources.files(__package__) / "maps"
    found = sorted((file for file in files.iterdir() if file.name.endswith(".toml")), key=lambda file: file.name)
    return {file.name.removesuffix(".toml"): _parsed(file.read_text(encoding="utf-8"), file.name) for file in found}


def _parsed(text: str, name: str) -> TableMap:
    try:
        table_map = msgspec.toml.decode(text, type=TableMap)
    except msgspec.DecodeError as error:
        raise SourceError(f"column map {name}: {error}. `tracker_bridge/sources/table/map.py` shows all keys") from None
    if (table_map.eye is None) is not (table_map.each is None):
        raise SourceError(f"column map {name}: `eye` and `[each]` need each other: give both or neither")
    if table_map.each is not None and (table_map.right is not None or table_map.left is not None):
        raise SourceError(f"column map {name}: a line is about one eye (`[each]`) or about both, not so and so")
    if all(part is None for part in (table_map.right, table_map.left, table_map.each, table_map.both)):
        raise SourceError(f"column map {name}: it maps no eye; add `[right]`, `[left]`, `[each]` or `[both]`")
    return table_map
