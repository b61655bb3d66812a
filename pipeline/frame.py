"""What the pipeline works on: absolute frames, the geometry they are seen with, the display and the observer."""

from __future__ import annotations

import dataclasses
import math
from typing import Annotated

import jax.numpy as jnp
import msgspec
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike, NDArray

from entoptic.described import DescribedEnum, described
from entoptic.errors import EntopticError

LUMINANCE_WEIGHTS = (0.2126, 0.7152, 0.0722)
"""Luminance of linear Rec.709 primaries with D65 white (ITU-R BT.709)."""

Pixels = Annotated[int, msgspec.Meta(ge=1, le=16384)]


class FrameError(EntopticError):
    """A frame, its geometry or a setting cannot be used: the message names the thing and the remedy."""


@dataclasses.dataclass(frozen=True)
class View:
    """A pinhole view: how pixels lie on the visual field of one eye."""

    width_px: int
    height_px: int
    fov_deg: float = 104.0
    """Horizontal field of view. 104° is the head-mounted display of LUI 5.3.2."""

    def __post_init__(self) -> None:
        if self.width_px < 1 or self.height_px < 1:
            raise FrameError(f"a frame of {self.width_px}×{self.height_px} pixels: width and height must be 1 or more")
        if not 1.0 <= self.fov_deg <= 175.0:
            raise FrameError(f"field of view {self.fov_deg:g}°: it must lie between 1° and 175°")

    @property
    def focal_px(self) -> float:
        """Distance of the image plane from the eye, in pixels."""
        return self.width_px / 2 / math.tan(math.radians(self.fov_deg) / 2)

    @property
    def ppd_centre(self) -> float:
        """Pixels per degree in the middle of the view; the mean, width/fov, is larger."""
        return math.radians(self.focal_px)

    def pixel_of(self, azimuth_deg: float, elevation_deg: float) -> tuple[float, float]:
        """Where a direction falls, as (x, y) px from the upper left corner; may lie outside the frame.

        Directions behind the image plane are taken as far out on their own side.
        """
        azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
        forward = max(math.cos(azimuth) * math.cos(elevation), 1e-3)
        right, up = math.sin(azimuth) * math.cos(elevation), math.sin(elevation)
        return (
            self.width_px / 2 + self.focal_px * right / forward,
            self.height_px / 2 - self.focal_px * up / forward,
        )


@dataclasses.dataclass(frozen=True)
class Cleaned:
    """How many components of a frame were bad on reading, and what became of them."""

    negative: int = 0
    """Set to 0."""
    nan: int = 0
    """Set to 0."""
    infinite: int = 0
    """Set to the largest finite component of the frame."""

    def __bool__(self) -> bool:
        return bool(self.negative or self.nan or self.infinite)

    def __str__(self) -> str:
        return f"{self.negative} negative, {self.nan} NaN, {self.infinite} infinite components"


@dataclasses.dataclass(frozen=True)
class Light:
    """A light of its own: far away, apart from the frame's pixels, with its own spectrum."""

    azimuth_deg: float
    """From the middle of the view to the right."""
    elevation_deg: float
    """Upwards."""
    illuminance_lx: float
    """At the eye, on a plane that faces the light: its luminance times its solid angle."""
    radius_deg: float = 0.0
    """Of its disc; 0 for a point."""
    spectrum: str = "D65"
    """Name of its spectral power distribution, or a file of one (optics/light_spectra.py). It gives the colour too."""

    def __post_init__(self) -> None:
        place = (self.azimuth_deg, self.elevation_deg)
        if not all(map(math.isfinite, (*place, self.illuminance_lx, self.radius_deg))):
            raise FrameError(f"a light at {place}°: direction, illuminance and radius must be finite numbers")
        if self.illuminance_lx < 0 or not 0 <= self.radius_deg <= 45:
            raise FrameError(
                f"a light of {self.illuminance_lx} lx and {self.radius_deg}°: give 0 lx or more, and 0 to 45°"
            )


@dataclasses.dataclass(frozen=True, eq=False)
class Surroundings:
    """Light from beyond a view's edges, in pieces, where the scene knows it: what the view shows is not in it."""

    towards: NDArray[np.float32]
    """Unit vectors of their middles (n, 3): right, down, ahead."""
    rgb_lx: NDArray[np.float32]
    """Illuminance of each, of red, green and blue (n, 3): its luminance times its solid angle, as it is seen."""
    steradians: NDArray[np.float32]
    """Their solid angles (n,)."""

    def outside_rad(self, view: View) -> NDArray[np.float32]:
        """How far beyond the nearest edge of a view each lies, (n,); negative within."""
        return outside_rad(self.towards, view)


def outside_rad(towards: NDArray[np.floating], view: View) -> NDArray[np.float32]:
    """How far beyond the edges of a view directions (n, 3) lie, in radians; negative within."""
    right, down, ahead = towards.T
    half = view.width_px / 2 / view.focal_px, view.height_px / 2 / view.focal_px
    beyond = [
        (np.abs(side) - ahead * edge) / math.hypot(1, edge) for side, edge in zip((right, down), half, strict=True)
    ]
    return np.arcsin(np.clip(np.maximum(*beyond), -1, 1)).astype(np.float32)


@dataclasses.dataclass(frozen=True)
class Frame:
    """What stands before the eyes: linear Rec.709 RGB (D65 white) in cd/m², one image an eye."""

    rgb_cd_m2: Float[Array, "eye 3 y x"]
    view: View
    cleaned: Cleaned = Cleaned()
    lights: tuple[Light, ...] = ()
    """Lights that the pixels do not show, drawn with their glare."""
    all_around_cd_m2: float | None = None
    """Mean luminance of all that surrounds the eye, by solid angle, where the scene knows it."""
    surroundings: Surroundings | None = None
    """What lies beyond the view's edges, where the scene knows it; else glare's settings say it."""

    @classmethod
    def from_rgb(cls, rgb: ArrayLike, fov_deg: float = 104.0, *, cd_m2_per_unit: float = 1.0) -> Frame:
        """A frame of one or two images that may come from anywhere: bad pixels are counted and cleaned.

        `rgb` has the shape (y, x, 3) as images are read, or (eye, 3, y, x) as frames are kept; `cd_m2_per_unit` scales
        it to absolute luminance. Raises FrameError for another shape, a scale that is not positive, or no finite pixel.
        """
        values = np.asarray(rgb, dtype=np.float32)
        if values.ndim == 3 and values.shape[2] == 3:
            values = values.transpose(2, 0, 1)[None]
        if values.ndim != 4 or values.shape[1] != 3 or values.shape[0] not in (1, 2):
            raise FrameError(f"an image of shape {values.shape}: it must be (y, x, 3) or (eye, 3, y, x), linear RGB")
        if not (math.isfinite(cd_m2_per_unit) and cd_m2_per_unit > 0):
            raise FrameError(f"{cd_m2_per_unit} cd/m² per unit: the scale must be a positive number")
        view = View(values.shape[3], values.shape[2], fov_deg)
        values, cleaned = clean(values)
        return cls(jnp.asarray(values * np.float32(cd_m2_per_unit)), view, cleaned)


def clean(values: np.ndarray) -> tuple[np.ndarray, Cleaned]:
    """An image without negative, NaN and infinite components, and how many there were. Any shape.

    Raises FrameError if no component is finite.
    """
    nan, infinite, negative = np.isnan(values), np.isinf(values), values < 0
    cleaned = Cleaned(int((negative & ~infinite).sum()), int(nan.sum()), int(infinite.sum()))
    if not cleaned:
        return values, cleaned
    finite = values[~(nan | infinite)]
    if finite.size == 0:
        raise FrameError("no pixel of the image is a finite number: it holds no picture")
    largest = max(float(finite.max()), 0.0)
    return np.where(nan | negative, 0, np.where(infinite, largest, values)).astype(values.dtype), cleaned


class Encoding(DescribedEnum):
    """What a display expects: primaries, transfer function, depth."""

    SRGB = "srgb", "Rec.709 primaries, sRGB transfer function, 8 bits."
    LINEAR = "linear", "Rec.709 primaries, linear, float32: 1 is the display's peak."
    DISPLAY_P3 = "display-p3", "P3 primaries with D65 white, sRGB transfer function, 8 bits."
    HDR10 = "hdr10", "Rec.2020 primaries, PQ (SMPTE ST 2084), 10 bits: absolute cd/m²."


class Display(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What shows the perceived frame."""

    peak_cd_m2: Annotated[
        float,
        described(
            "Luminance of full white. 100 is the studio reference; a brighter display shows middle grey at the same "
            "luminance and has more room above it, a dimmer one shows the same picture darker.",
            ge=1.0,
            le=20000.0,
            slider=(50.0, 2000.0),
        ),
    ] = 100.0
    black_cd_m2: Annotated[float, described("Luminance of full black.", ge=0.0, le=10.0)] = 0.0
    surround_cd_m2: Annotated[
        float,
        described(
            "Luminance of what surrounds the display: 0 in a headset or a dark room.",
            ge=0.0,
            le=10000.0,
            slider=(0.0, 500.0),
        ),
    ] = 0.0
    encoding: Encoding = Encoding.SRGB
