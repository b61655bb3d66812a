"""Which effects a frame calls for, at which level, and why: a pure function of what was measured."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Sequence

from pipeline.effects import acuity, adaptation, night_colour
from pipeline.effects.glare import Glare, Scattering
from pipeline.frame import Light
from pipeline.measure import MAX_SOURCES, Measurement
from pipeline.threshold import threshold_cd_m2


class Effect(enum.StrEnum):
    """The effects, in the order in which they run."""

    ADAPTATION = "adaptation"
    GLARE = "glare"
    ACUITY = "acuity"
    TONE = "tone"
    NIGHT_COLOUR = "night_colour"


SKIPPED = "skipped"
PHOTOPIC_CD_M2 = 3.0
"""Above it only cones see (Ferwerda; BAR 3)."""


@dataclasses.dataclass(frozen=True)
class Step:
    """What the plan says of one effect."""

    effect: Effect
    level: str
    """How it runs, or `skipped`."""
    reason: str
    """Why, with the measured figures."""

    @property
    def runs(self) -> bool:
        """Whether the effect runs at all."""
        return self.level != SKIPPED


Plan = tuple[Step, ...]


def make_plan(
    measured: Sequence[Measurement],
    adapted_cd_m2: Sequence[float],
    scattering: Sequence[Scattering],
    glare: Glare = Glare(),
    lights: Sequence[Light] = (),
) -> Plan:
    """The plan for a frame: an effect runs on all eyes' images if any eye calls for it.

    One measurement, adapted luminance and kernel bound for each eye. A skip of glare changes no pixel's luminance by
    more than the threshold of an eye so adapted; a skip of acuity changes none at all.
    """
    return (
        Step(Effect.ADAPTATION, "temporal", f"adapted to {_list(adapted_cd_m2)} cd/m²"),
        _plan_glare(measured, adapted_cd_m2, scattering, glare, lights),
        _plan_acuity(measured, scattering),
        Step(Effect.TONE, "aces", "every display needs it"),
        _plan_night_colour(adapted_cd_m2),
    )


def _plan_glare(
    measured: Sequence[Measurement],
    adapted_cd_m2: Sequence[float],
    scattering: Sequence[Scattering],
    glare: Glare,
    lights: Sequence[Light],
) -> Step:
    if lights:
        reason = (
            f"{len(lights)} {'lights of their own are' if len(lights) > 1 else 'light of its own is'} drawn with it"
        )
        return Step(Effect.GLARE, f"{glare.model} {glare.level}", reason)
    # The eye that calls for it most.
    bound, threshold, eye = max(
        (
            (kernel.share * eye.max_cd_m2, threshold_cd_m2(adapted), eye)
            for eye, adapted, kernel in zip(measured, adapted_cd_m2, scattering, strict=True)
        ),
        key=lambda candidate: candidate[0] / candidate[1],
    )
    seen = f"brightest pixel {eye.max_cd_m2:.3g} cd/m², {_lights(eye)}"
    if bound <= threshold:
        reason = (
            f"{seen}: glare changes no pixel by more than {bound:.2g}, the eye's threshold is {threshold:.2g} cd/m²"
        )
        return Step(Effect.GLARE, SKIPPED, reason)
    reason = f"{seen}: glare may change a pixel by {bound:.2g}, over the threshold of {threshold:.2g} cd/m²"
    return Step(Effect.GLARE, f"{glare.model} {glare.level}", reason)


def _lights(measured: Measurement) -> str:
    count = len(measured.sources)
    more = " or more" if count == MAX_SOURCES else ""
    return f"{count}{more} {'light stands' if count == 1 else 'lights stand'} out" if count else "no light stands out"


def _plan_acuity(measured: Sequence[Measurement], scattering: Sequence[Scattering]) -> Step:
    darkest = min(eye.min_cd_m2 for eye in measured)
    # Glare may take from a pixel what it scatters.
    left = min(eye.min_cd_m2 * kernel.stays for eye, kernel in zip(measured, scattering, strict=True))
    if left >= acuity.LIMIT_CD_M2:
        return Step(
            Effect.ACUITY,
            SKIPPED,
            f"darkest pixel {darkest:.3g} cd/m², {left:.3g} of it after glare: above {acuity.LIMIT_CD_M2:.2g} cd/m² an "
            "eye resolves every pixel",
        )
    return Step(
        Effect.ACUITY,
        "lightness",
        f"darkest pixel {darkest:.3g} cd/m², {_percent(measured, 0.01)} of it below 0.01 cd/m²",
    )


def _plan_night_colour(adapted_cd_m2: Sequence[float]) -> Step:
    darkest = min(adapted_cd_m2)
    share = adaptation.rod_sensitivity(darkest)
    if darkest >= PHOTOPIC_CD_M2:
        change = night_colour.grey_change_code_values(share)
        return Step(
            Effect.NIGHT_COLOUR,
            SKIPPED,
            f"adapted to {darkest:.3g} cd/m², above {PHOTOPIC_CD_M2:g} cd/m² cones alone see; a grey would change by "
            f"{change:.2g} of 255 code values",
        )
    return Step(Effect.NIGHT_COLOUR, "tint", f"adapted to {darkest:.3g} cd/m²: rods carry {share:.0%} of vision")


def _list(values: Sequence[float]) -> str:
    return " and ".join(f"{value:.3g}" for value in dict.fromkeys(values))


def _percent(measured: Sequence[Measurement], limit: float) -> str:
    return f"{max(eye.share_below(limit) for eye in measured):.0%}"
