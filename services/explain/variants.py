"""A frame perceived as planned, with everything on, and without each effect: what each truly changes."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float
from msgspec.structs import replace

from entoptic.pipeline import EFFECTS, OPTIONAL, Perceived, Planning
from entoptic.pipeline.budget import SHIPPED, CostModel
from entoptic.pipeline.effects.encode import srgb_codes
from entoptic.pipeline.plan import SKIPPED
from entoptic.services.explain.subject import Subject

TOUCHED_CODE_VALUES = 1.0
"""A pixel is touched if the display shows another code value."""


@dataclasses.dataclass(frozen=True, eq=False)
class Touch:
    """What one effect changes: the picture with it against the picture without."""

    change: Float[np.ndarray, "eye y x"]
    """In code values, of the channel that changes most."""

    @property
    def largest(self) -> float:
        """In code values."""
        return float(self.change.max())

    @property
    def share(self) -> float:
        """Of the pixels."""
        return float((self.change >= TOUCHED_CODE_VALUES).mean())


@dataclasses.dataclass(frozen=True, eq=False)
class Explained:
    """All that was found out about a frame."""

    planned: Perceived
    full: Perceived
    """Every effect on, as the settings ask for it."""
    touched: dict[str, Touch]
    """By each effect that ran and can be left out."""

    @property
    def difference(self) -> Float[np.ndarray, "eye y x"]:
        """Full minus planned in code values: of each pixel the channel that differs most, with its sign."""
        apart = code_values(self.full) - code_values(self.planned)
        return np.take_along_axis(apart, np.abs(apart).argmax(-1)[..., None], -1)[..., 0]


def explain(subject: Subject, costs: CostModel = SHIPPED) -> Explained:
    """Perceives the frame in all its variants. `costs` matter where the settings' plan has a budget."""
    subject.perceived(costs)  # compiles: its times mean nothing
    planned = subject.perceived(costs)
    full = subject.perceived(costs, Planning(everything=True))
    touched = {}
    levels = {
        effect.name: effect.at_level(effect.settings_of(subject.settings), planned.plan[effect.name].level)
        for effect in EFFECTS
        if planned.plan[effect.name].runs
    }
    settings = replace(subject.settings, **levels)
    as_planned = dataclasses.replace(subject, settings=settings)
    for step in planned.plan:
        if step.runs and step.effect in OPTIONAL:
            # The others as they were: what a budget saves here is spent on none of them.
            left_out = frozenset(one.effect for one in planned.plan if one.level == SKIPPED) | {step.effect}
            without = as_planned.perceived(costs, Planning(everything=True, leave_out=left_out))
            touched[step.effect] = Touch(np.abs(code_values(planned) - code_values(without)).max(-1))
    return Explained(planned, full, touched)


def code_values(perceived: Perceived) -> Float[np.ndarray, "eye y x 3"]:
    """What the display is sent, in code values; of a linear image those of sRGB."""
    if not np.issubdtype(perceived.image.dtype, np.floating):
        return perceived.image.astype(np.float64)
    return np.asarray(srgb_codes(perceived.linear, 0.0), np.float64)
