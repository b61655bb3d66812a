"""What is just seen in the scene is just seen on the display (Ward 1994, Ferwerda 1996; BAR 8–10)."""

from __future__ import annotations

from entoptic.pipeline.display_light import seen_peak_cd_m2, viewer_cd_m2
from entoptic.pipeline.effects.adaptation import overshoot_threshold_cd_m2
from entoptic.pipeline.frame import Display
from entoptic.pipeline.threshold import cone_threshold_cd_m2, threshold_cd_m2


def coefficients(adapted_cd_m2: float, target_cd_m2: float, display: Display) -> tuple[float, float]:
    """L_d = gain·L + offset, L in cd/m², L_d a share of the display's peak.

    In the dark, or adapted, L_d = t_p(L_da)/t_m(L_wa)·L (BAR 9). While the eye adapts to more light its threshold
    overshoots, t* = t_m(target)²/t_m(L_wa) (BAR 8), and what has the target's luminance keeps the place that it will
    have (BAR 10): contrast is lost around it, dark parts are veiled. The offset is added as white light: scaling RGB
    by L_d/L has no value at a black pixel.
    """
    display_threshold = cone_threshold_cd_m2(viewer_cd_m2(display)) / seen_peak_cd_m2(display)
    now = overshoot_threshold_cd_m2(adapted_cd_m2, target_cd_m2)
    if target_cd_m2 <= adapted_cd_m2:
        return display_threshold / now, 0.0
    settled = threshold_cd_m2(target_cd_m2)
    return display_threshold / now, display_threshold * target_cd_m2 * (1 / settled - 1 / now)


def full_cd_m2(gain: float, offset: float) -> float:
    """The luminance from which on the display shows its peak."""
    return max(1 - offset, 0.0) / gain
