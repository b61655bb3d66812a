"""What an effect is: the one class that renderer, planner, cost tables, settings and documents know.

An effect is one object. What a frame and an eye are comes to it in `EyeContext` (pipeline/eye_context.py), images in
`Picture`, what may stand in a frame's tiles in `TileRanges`. It has no state: what an eye remembers is handed in and
out.
"""

from __future__ import annotations

import abc
import dataclasses
import enum
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Generic, TypeVar

import msgspec
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.ranges import Change, Range

if TYPE_CHECKING:
    from entoptic.pipeline.effects.pointwise import Pointwise
    from entoptic.pipeline.eye_context import EyeContext

SettingsT = TypeVar("SettingsT", bound=msgspec.Struct)
MemoryT = TypeVar("MemoryT")

SKIPPED = "skipped"
"""The level of an effect that a frame does not call for."""

Milliseconds = Annotated[float, msgspec.Meta(ge=0.0, le=1e9)]


class Domain(enum.Enum):
    """What the images are that an effect makes."""

    SCENE = enum.auto()
    """Linear Rec.709 in cd/m²."""
    DISPLAY = enum.auto()
    """Linear Rec.709, 1 = the display's peak."""


class Cost(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Time of one effect at one level."""

    fixed_ms: Milliseconds
    """However small the frame."""
    ms_per_megapixel: Milliseconds
    """For each million pixels that it works on, all eyes' together."""

    def ms(self, megapixels: float) -> float:
        """Predicted time."""
        return self.fixed_ms + self.ms_per_megapixel * megapixels


@dataclasses.dataclass(frozen=True, eq=False)
class Picture:
    """All eyes' images on their way to the display."""

    image: Float[Array, "eye 3 y x"]
    """As the effects before left it, in the unit of the domain that it has reached."""
    scene: Float[Array, "eye 3 y x"]
    """Before tone mapping, in cd/m²; until then the same as `image`."""

    def after(self, image: Float[Array, "eye 3 y x"], domain: Domain) -> Picture:
        """With the image that an effect of this domain made."""
        return Picture(image, image if domain is Domain.SCENE else self.scene)


@dataclasses.dataclass(frozen=True, eq=False)
class TileRanges:
    """What may stand in each tile of one eye's image before an effect."""

    image: Range
    """In the unit of the domain that it has reached."""
    scene: Range
    """Before tone mapping, in cd/m²; until then the same as `image`."""


@dataclasses.dataclass(frozen=True, eq=False)
class TileChanges:
    """By how much that may differ from what full levels make of it."""

    image: Change
    scene: Change


class Effect(abc.ABC, Generic[SettingsT, MemoryT]):
    """One thing that an eye, or the display before it, does to a frame."""

    name: ClassVar[str]
    """The field's term: the settings' table, the plan's row, the option."""
    domain: ClassVar[Domain]
    """Of what `apply` makes. The first effect whose domain is DISPLAY maps tones; it takes cd/m²."""
    Settings: type[SettingsT]
    """Frozen, ranged, described: the file's table, the console's form, the documents' row."""
    Memory: type[MemoryT] | None = None
    """What one eye remembers from frame to frame; None: nothing."""
    optional: ClassVar[bool] = True
    """Whether a plan may leave it out."""
    seen_by_threshold: ClassVar[bool] = False
    """Whether a change in cd/m² below the eye's threshold counts as not seen (it must be one of the scene's light)."""
    needs_picture: ClassVar[bool] = False
    """Whether `pointwise` looks at the image, so that it begins a pass."""
    costs: Mapping[str, Cost]
    """Of each level, on two cores of a Xeon at 2.5 GHz: medians at 1440×1600."""

    def settings_of(self, effects: Any) -> SettingsT:
        """Its own table of all effects' settings."""
        settings: SettingsT = getattr(effects, self.name)
        return settings

    def is_on(self, settings: SettingsT) -> bool:
        """Whether the settings ask for it at all."""
        return True

    def check(self, settings: SettingsT) -> None:
        """Raises FrameError where a file that the settings name cannot be used."""
        return

    @abc.abstractmethod
    def full_level(self, settings: SettingsT) -> str:
        """What its level is called where nothing of it is left out."""

    def reduced_levels(self, settings: SettingsT) -> Sequence[str]:
        """The levels that may stand in for the full one, cheapest first."""
        return (SKIPPED,)

    def at_level(self, settings: SettingsT, level: str) -> SettingsT:
        """The settings whose full level is one of the reduced ones that run."""
        return settings

    def required(self, eyes: Sequence[EyeContext], settings: SettingsT) -> str | None:
        """Why it runs in full whatever the plan, where it does."""
        return None

    def remember(self, memory: MemoryT | None, eye: EyeContext, settings: SettingsT, dt_s: float) -> MemoryT | None:
        """What an eye remembers `dt_s` after `memory`, having spent that time viewing this frame; None: nothing."""
        return None

    def prepare(self, eye: EyeContext, settings: SettingsT) -> Any:
        """What is worked out once a frame and eye, before planning, and kept in `EyeContext.prepared`."""
        return None

    def cause(self, eyes: Sequence[EyeContext], settings: SettingsT, level: str) -> tuple[object, ...] | None:
        """All that decides what `apply` makes of an image beside the image; None: it is never worth comparing.

        Where image and cause are those of the frame before, its result serves again.
        """
        return None

    def affected_tiles(self, ranges: TileRanges, eye: EyeContext, settings: SettingsT) -> NDArray[np.bool_] | None:
        """(row, column): tiles that it may change at all; None: perhaps all. `apply` is given those of all eyes."""
        return None

    @abc.abstractmethod
    def apply(
        self,
        picture: Picture,
        eyes: Sequence[EyeContext],
        settings: SettingsT,
        level: str,
        tiles: NDArray[np.bool_] | None,
    ) -> Float[Array, "eye 3 y x"]:
        """The images after it, float32."""

    def left_out(self, picture: Picture, eyes: Sequence[EyeContext]) -> Float[Array, "eye 3 y x"]:
        """The images where it does not run: what it would have drawn of its own is not to be missed."""
        return picture.image

    def pointwise(
        self,
        picture: Picture,
        eyes: Sequence[EyeContext],
        settings: SettingsT,
        level: str,
        tiles: NDArray[np.bool_] | None,
    ) -> Pointwise | None:
        """The same, but for rounding, as a function of each pixel, that it may run with its neighbours in one pass.

        `picture` is what stands before the pass: what is worked out of it here must come from the first effect of a
        pass, and `needs_picture` says so. None: `apply` alone does it.
        """
        return None

    @abc.abstractmethod
    def bound(self, ranges: TileRanges, eye: EyeContext, settings: SettingsT, level: str) -> Change:
        """The most by which a reduced level differs from the full one, right behind it; rigorous."""

    @abc.abstractmethod
    def propagate(self, changes: TileChanges, ranges: TileRanges, eye: EyeContext, settings: SettingsT) -> Change:
        """What becomes of a change made before it; rigorous. `ranges` is what stands there without the change."""

    def ranges_after(self, ranges: TileRanges, hidden: Change, eye: EyeContext, settings: SettingsT) -> Range:
        """What may stand in a tile behind it, whether it ran or not; `hidden` is the bound of skipping it."""
        return ranges.image.widened(hidden)

    @abc.abstractmethod
    def reason(self, eye: EyeContext, settings: SettingsT) -> str:
        """The measured figures that decide whether it is called for, in words."""

    @abc.abstractmethod
    def oracle(self, picture: Picture, eye: EyeContext, settings: SettingsT) -> NDArray[np.float64]:
        """The image (3, y, x) that it ought to make of one eye's, in float64 NumPy, written from the paper.

        `picture` is that of one eye, and `eye` that eye. It shares no arithmetic with `apply`.
        """

    def truth_of(self, settings: SettingsT) -> SettingsT:
        """Settings for which this is the same have the same oracle: they are rivals, and others make other pictures."""
        return settings

    def accuracy(self, settings: SettingsT) -> float:
        """How far its full level is from the oracle at most: at 99 % of pixels, relative to the pixel and the 99th
        percentile of the image.
        """
        return 1e-5

    @abc.abstractmethod
    def variants(self) -> Mapping[str, SettingsT]:
        """The settings that cost tables compare, by name; the first is the default."""
