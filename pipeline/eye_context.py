"""One eye viewing one image: all that effects, planning and cost tables get to know of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from entoptic.pipeline.effects.adaptation.state import Adapted
from entoptic.pipeline.eye_pose import EyePose
from entoptic.pipeline.frame import Display, Frame, Light, View
from entoptic.pipeline.measure import Measurement
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics.aperture import Pose

if TYPE_CHECKING:
    from entoptic.pipeline.effects import Effects


@dataclasses.dataclass(frozen=True, eq=False)
class EyeContext:
    """One eye viewing one image of a frame."""

    frame: Frame
    image: int
    """Which of the frame's images it sees."""
    pose: EyePose
    """Where it looks, as it was told."""
    measured: Measurement
    """What the image contains."""
    observer: Observer
    display: Display
    effects: Effects
    """Settings of all effects."""
    time_s: float
    """Since the first frame, 0 or more."""
    adapted: Adapted
    pupil_diameter_mm: float
    """The diameter that is seen through, mm."""
    aperture: Pose
    """How pupil, lens, vitreous and lids stand."""
    memory: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """What it remembers, by effect."""
    prepared: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """What effects prepared for this frame, by effect."""

    @property
    def view(self) -> View:
        """The frame's."""
        return self.frame.view

    @property
    def lights(self) -> tuple[Light, ...]:
        """The frame's lights of their own."""
        return self.frame.lights

    @property
    def adapted_cd_m2(self) -> float:
        """The luminance that it sees as if it were adapted to it."""
        return self.adapted.luminance_cd_m2

    @property
    def target_cd_m2(self) -> float:
        """The luminance that tone mapping takes for its target (`Adapted.tone_target_cd_m2`)."""
        return self.adapted.tone_target_cd_m2(self.effects.adaptation)

    @property
    def gaze_px(self) -> tuple[float, float]:
        """(x, y) from the upper left corner; may lie outside the frame."""
        return self.view.pixel_of(self.pose.azimuth_deg, self.pose.elevation_deg)
