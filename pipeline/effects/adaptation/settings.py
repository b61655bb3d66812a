"""Which way an eye adapts."""

from __future__ import annotations

import enum
from typing import Annotated

import msgspec

GAZE_SD_DEG = 10.0
"""Standard deviation of the weight around the gaze. Engineering choice: LUI gives none; 10° weighs the macula and its
surround, and lets a lamp in the periphery count little."""

Left = Annotated[float, msgspec.Meta(ge=1e-6, le=0.999)]


class Target(enum.StrEnum):
    """What an eye adapts to."""

    LUI = "lui"
    """The mean under a Gaussian around the gaze (LUI §5.1)."""
    KRI = "kri"
    """The geometric mean of the whole frame, wherever the eye looks (KRI 4.15)."""
    BAR_SCENE = "bar-scene"
    """The mean of the whole frame, or of a panorama: BAR's first method."""
    BAR_VIEW = "bar-view"
    """The mean under 1 − 4d² around the middle of the view: BAR's second and third methods (BAR 5–6)."""


class Course(enum.StrEnum):
    """How an eye gets there."""

    LUI = "lui"
    """Exponential, between the cones' 0.1 s and the rods' 0.4 s (LUI 5.2–5.4, KRI 4.16)."""
    INSTANT = "instant"
    """At once: BAR's first and second methods."""
    BAR = "bar"
    """Exponential, faster to light than to dark (BAR 7)."""
    OVERSHOOT = "overshoot"
    """The same, and on the way to light the threshold overshoots (BAR 7–8), which the tone operator `ward` shows."""


class Bleaching(enum.StrEnum):
    """What strong light does to the pigments, for half an hour."""

    OFF = "off"
    """Nothing: adaptation is over in seconds."""
    PATTANAIK = "pattanaik"
    """Constants of Pattanaik 2000, after Hunt: they also stand for what saturates rods in the light."""
    RUSHTON = "rushton"
    """Measured bleaching alone (Rushton & Henry 1968), with log thresholds that rise with it (Rushton 1965)."""


class Adaptation(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an eye adapts to, and how."""

    target: Target = Target.LUI
    course: Course = Course.LUI
    gaze_sd_deg: Annotated[float, msgspec.Meta(ge=1.0, le=90.0)] = GAZE_SD_DEG
    """Standard deviation of target `lui`'s weight."""
    left_after_1_s_to_light: Left = 0.1
    """BAR's p, for courses `bar` and `overshoot`: the share of the way that is left after a second where it grows
    lighter."""
    left_after_1_s_to_dark: Left = 0.5
    """The same where it grows darker."""
    robust: bool = False
    """Small bright lights count for no more than 30 times the geometric mean, so that one that enters, leaves or blinks
    does not make the whole frame flicker."""
    bleaching: Bleaching = Bleaching.OFF


DEFAULT = Adaptation()
