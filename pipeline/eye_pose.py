"""How one eye looks at a frame: where, through which pupil, how far open, in which motion."""

from __future__ import annotations

import dataclasses
import math

from entoptic.pipeline.frame import FrameError
from entoptic.pipeline.optics.ocular_dynamics import SaccadeImpulse


@dataclasses.dataclass(frozen=True)
class EyePose:
    """How one eye looks at a frame."""

    azimuth_deg: float = 0.0
    """Direction of gaze from the middle of the view, to the right positive."""
    elevation_deg: float = 0.0
    """Upwards positive."""
    pupil_diameter_mm: float | None = None
    """Measured diameter; None for what Watson & Yellott expect of this light and age."""
    openness: float = 1.0
    """How far the lids are open, 0 to 1. It shapes glare where `ocular_dynamics.lids` is on."""
    saccade_impulses: tuple[SaccadeImpulse, ...] = ()
    """The turns of the eye since the frame before, saccades and microsaccades."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.azimuth_deg) and math.isfinite(self.elevation_deg)):
            raise FrameError(f"gaze ({self.azimuth_deg}, {self.elevation_deg})°: both angles must be finite numbers")
        if self.pupil_diameter_mm is not None and not 0.5 <= self.pupil_diameter_mm <= 12:
            raise FrameError(f"a pupil of {self.pupil_diameter_mm} mm: give 0.5 to 12 mm, or none to have it computed")
        if not 0 <= self.openness <= 1:
            raise FrameError(f"an openness of {self.openness}: it must lie between 0, closed, and 1, open")
