"""The result of a pupil calibration: a file, and what it makes of the diameters that a tracker gives.

The bridge's filter knows what a pupil can do in millimetres, so a map acts on both sides of it: `apply` before, which
gives a tracker's pixels the size of a pupil and leaves millimetres alone; and `map_state` after it, which maps what
the filter trusts onto 2 to 8 mm (Luidolt 2020, 5.2.1 ii). Mapped first, a pupil a little wider than before the black
screen would be wider than any pupil, and be refused; clamped as well, what a lid leaves of one would pass for one.
"""

from __future__ import annotations

import enum
import math
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from entoptic.errors import EntopticError
from entoptic.tracker_bridge.samples import Eye, EyeState, OneEyeState, PupilSample

Unit = Literal["mm", "px"]
WHITE_PX_AS_MM = 2.5
"""What an eye's pixels before the white screen are taken for, so that a filter knows a pupil. Engineering choice: then
a pupil that opens 3.6-fold, more than any does, is still no wider than the filter's 9 mm."""
LUI_MM = (2.0, 8.0)
"""The diameters before white and before black (Luidolt 2020, 5.2.1 ii)."""

Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
Diameter = Annotated[float, msgspec.Meta(gt=0.0, le=10_000.0)]


class PupilMapError(EntopticError):
    """A pupil map cannot be read or written: the message names the file and the remedy."""


class Use(enum.StrEnum):
    """What a bridge does with a map."""

    MAP = "map"
    """Diameters are mapped onto 2 to 8 mm."""
    CHECK = "check"
    """The tracker's millimetres stay as they are."""


class MappedWindow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One measured window of one eye, for the record."""

    screen: Literal["white", "black"]
    shown_s: float
    """When its screen was really shown, from the first screen."""
    from_s: float
    to_s: float
    value: Diameter
    valid_share: Share
    slope_mm_s: float


class EyeMap(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One eye's pupil, in the map's unit."""

    white: Diameter
    black: Diameter
    stretch: float
    """How many mm of LUI's 2 to 8 one (provisional) mm of this pupil becomes; 1 is a tracker that spans 6 mm itself."""
    windows: tuple[MappedWindow, ...] = ()


class PupilMap(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How far a person's pupils close and open, as one tracker sees them."""

    format: Literal[1]
    program: str
    """Which wrote it."""
    date: str
    """When, ISO 8601, UTC."""
    source: str
    display: str
    protocol: str
    unit: Unit
    use: Use
    display_uncertainty_ms: float | None = None
    """The times of the screens lie within ± this; None for a display whose clock needed no estimate."""
    right: EyeMap | None = None
    left: EyeMap | None = None

    def of(self, eye: Eye) -> EyeMap | None:
        """What was measured of one eye; None if that was not calibrated."""
        return self.right if eye is Eye.RIGHT else self.left

    def apply(self, sample: PupilSample) -> PupilSample:
        """The sample that the filter should see: pixels become provisional millimetres, millimetres stay.

        A sample of an eye that was not calibrated stays as it is; one without pixels says nothing of the diameter
        where the map is in pixels, since millimetres of its own would be none of these.
        """
        one = self.of(sample.eye)
        if self.unit == "mm" or one is None:
            return sample
        return in_provisional_mm(sample, one.white / WHITE_PX_AS_MM)

    def map_state(self, state: EyeState) -> EyeState:
        """A state made of such samples, its diameters on LUI's 2 to 8 mm if that is what the map is for."""
        if self.use is Use.CHECK:
            return state
        right, left = (self._map_eye(eye, state.of(eye)) for eye in Eye)
        return msgspec.structs.replace(state, right=right, left=left)

    def _map_eye(self, eye: Eye, state: OneEyeState) -> OneEyeState:
        if self.of(eye) is None:
            return state
        low, high = LUI_MM
        pupil_diameter_mm, measured_mm = (
            None if mm is None else self.mapped_mm(eye, mm) for mm in (state.pupil_diameter_mm, state.measured_mm)
        )
        if pupil_diameter_mm is not None:
            pupil_diameter_mm = min(max(pupil_diameter_mm, low), high)
        return msgspec.structs.replace(state, pupil_diameter_mm=pupil_diameter_mm, measured_mm=measured_mm)

    def mapped_mm(self, eye: Eye, filtered_mm: float) -> float:
        """A diameter from behind the filter on the line from LUI's 2 to 8 mm; beyond them too. For `map` alone."""
        one = self.of(eye)
        if one is None:
            return filtered_mm
        native = filtered_mm * (one.white / WHITE_PX_AS_MM if self.unit == "px" else 1.0)
        low, high = LUI_MM
        return low + (high - low) * (native - one.white) / (one.black - one.white)


def in_provisional_mm(sample: PupilSample, px_per_mm: float) -> PupilSample:
    """A sample with its pixels as millimetres, whatever millimetres it has of its own."""
    pupil_diameter_mm = None if sample.diameter_px is None else sample.diameter_px / px_per_mm
    return msgspec.structs.replace(sample, pupil_diameter_mm=pupil_diameter_mm)


def read(path: Path) -> PupilMap:
    """The map in a file. Raises PupilMapError."""
    try:
        found = msgspec.toml.decode(path.read_bytes(), type=PupilMap)
    except OSError as error:
        raise PupilMapError(f"pupil map {path}: {error.strerror}; make one with `entoptic calibrate`") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise PupilMapError(f"pupil map {path}: {error}; make a new one with `entoptic calibrate`") from None
    if fault := _fault(found):
        raise PupilMapError(f"pupil map {path}: {fault}; make a new one with `entoptic calibrate`")
    return found


def _fault(found: PupilMap) -> str | None:
    eyes = {eye.name.lower(): one for eye in Eye if (one := found.of(eye)) is not None}
    if not eyes:
        return "it holds neither [right] nor [left]"
    for name, one in eyes.items():
        # NaN and infinity pass the ranges of their fields.
        if not (math.isfinite(one.white) and math.isfinite(one.black) and one.white < one.black):
            return f"[{name}] white = {one.white:g} must be less than black = {one.black:g}"
    if found.unit == "px" and found.use is Use.CHECK:
        return 'unit = "px" needs use = "map", since pixels are no diameter'
    return None


_COMMENTS = {
    "unit": "of white, black and value: the tracker's own",
    "use": '"map": diameters become 2 to 8 mm; "check": the tracker\'s mm stay',
    "display_uncertainty_ms": "the times of the screens lie within ± this",
    "white": "diameter before the white screens",
    "black": "diameter before the black screen",
    "stretch": "mm of 2 to 8 for each mm of this pupil",
    "shown_s": "when the screen was really shown, from the first one",
    "from_s": "from here",
    "to_s": "to here it was measured",
    "valid_share": "of the window in which the pupil was tracked",
    "slope_mm_s": "how fast it still moved",
}


def text(pupil_map: PupilMap) -> str:
    """The file's text: TOML with a word on each figure."""
    lines = ["# How far a person's pupils close and open. Written by `entoptic calibrate`.", ""]
    _write(lines, pupil_map, "", dict(_COMMENTS))
    return "\n".join(lines) + "\n"


def _write(lines: list[str], record: msgspec.Struct, path: str, comments: dict[str, str]) -> None:
    """Each comment is used up by the first figure of its name."""
    fields = {name: getattr(record, name) for name in record.__struct_fields__}
    for name, value in fields.items():
        if value is None or isinstance(value, (msgspec.Struct, tuple)):
            continue
        comment = f"  # {comments.pop(name)}" if name in comments else ""
        lines.append(f"{name} = {_toml(value)}{comment}")
    for name, value in fields.items():
        if isinstance(value, msgspec.Struct):
            lines += ["", f"[{path}{name}]"]
            _write(lines, value, f"{path}{name}.", comments)
        elif isinstance(value, tuple):
            for one in value:
                lines += ["", f"[[{path}{name}]]"]
                _write(lines, one, f"{path}{name}.", comments)


def _toml(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4f}"
    # A JSON string is a TOML string but for DEL, which JSON leaves as it is.
    return msgspec.json.encode(value).decode().replace("\x7f", "\\u007f")
