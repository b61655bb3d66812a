"""Which way an eye adapts."""

from __future__ import annotations

from typing import Annotated

import msgspec

from entoptic.described import DescribedEnum, described

GAZE_SD_DEG = 10.0
"""Standard deviation of the weight around the gaze. Engineering choice: LUI gives none; 10° weighs the macula and its
surround, and lets a lamp in the periphery count little."""

Left = Annotated[float, msgspec.Meta(ge=1e-6, le=0.999)]


class Target(DescribedEnum):
    """What an eye adapts to."""

    LUI = "lui", "The mean under a Gaussian around the gaze (LUI 5.1)."
    KRI = "kri", "The geometric mean of the whole frame, wherever the eye looks (KRI 4.15)."
    BAR_SCENE = "bar-scene", "The mean of the whole frame, or of a panorama: BAR's first method."
    BAR_VIEW = (
        "bar-view",
        "The mean under 1 − 4d² around the middle of the view: BAR's second and third methods (BAR 5–6).",
    )


class Course(DescribedEnum):
    """How an eye gets there."""

    LUI = "lui", "Exponential, between the cones' 0.1 s and the rods' 0.4 s (LUI 5.2–5.4, KRI 4.16)."
    INSTANT = "instant", "At once: BAR's first and second methods."
    BAR = "bar", "Exponential, faster to light than to dark (BAR 7)."
    OVERSHOOT = (
        "overshoot",
        ("The same, and on the way to light the threshold overshoots (BAR 7–8), which the tone operator `ward` shows."),
    )


class Bleaching(DescribedEnum):
    """What strong light does to the pigments, for half an hour."""

    OFF = "off", "Nothing: adaptation is over in seconds."
    PATTANAIK = (
        "pattanaik",
        "Constants of Pattanaik 2000, after Hunt: they also stand for what saturates rods in the light.",
    )
    RUSHTON = (
        "rushton",
        "Measured bleaching alone (Rushton & Henry 1968), with log thresholds that rise with it (Rushton 1965).",
    )


class Adaptation(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an eye adapts to, and how."""

    target: Target = Target.LUI
    course: Course = Course.LUI
    gaze_sd_deg: Annotated[float, described("Standard deviation of target `lui`'s weight.", ge=1.0, le=90.0)] = (
        GAZE_SD_DEG
    )
    left_after_1_s_to_light: Annotated[
        Left,
        described(
            "BAR's p, for courses `bar` and `overshoot`: the share of the way that is left after a second where it "
            "grows lighter."
        ),
    ] = 0.1
    left_after_1_s_to_dark: Annotated[Left, described("The same where it grows darker.")] = 0.5
    robust: Annotated[
        bool,
        described(
            "Small bright lights count for no more than 30 times the geometric mean, so that one that enters, "
            "leaves or blinks does not make the whole frame flicker."
        ),
    ] = False
    bleaching: Bleaching = Bleaching.OFF


DEFAULT = Adaptation()
