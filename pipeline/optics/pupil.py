"""How wide a pupil is, where no tracker measured it."""

from __future__ import annotations

import math

from entoptic.pipeline.frame import View


def watson_yellott_mm(luminance_cd_m2: float, field_deg2: float, age_years: float, *, binocular: bool = True) -> float:
    """Pupil diameter in mm after Watson & Yellott 2012 (eq. 21): light, field area, age and number of eyes.

    `luminance_cd_m2` ≥ 0 is the adapting field's, `field_deg2` > 0 its area. At 1 cd/m², 900 deg², age 45: 5.240 mm.
    """
    flux = luminance_cd_m2 * field_deg2 * (1.0 if binocular else 0.1)
    x = (flux / 846.0) ** 0.41
    standard_mm = 7.75 - 5.75 * x / (x + 2.0)
    return standard_mm + (age_years - 28.58) * (0.02132 - 0.009562 * standard_mm)


def expected_mm(view: View, adapted_cd_m2: float, age_years: float) -> float:
    """Pupil diameter in mm that Watson & Yellott expect of an eye adapted to a view, which is its adapting field."""
    field_deg2 = view.fov_deg * math.degrees(2 * math.atan(view.height_px / 2 / view.focal_px))
    return watson_yellott_mm(adapted_cd_m2, field_deg2, age_years)
