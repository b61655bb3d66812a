"""A frame perceived as planned, with everything on, and without each effect: what each truly changes."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float

from pipeline import Glare, GlareLevel, Perceived, Plan, RenderState, Step, perceive, render
from pipeline.plan import SKIPPED, Effect
from services.explain.subject import Subject

ALWAYS = frozenset({Effect.ADAPTATION, Effect.TONE})
"""A display shows nothing without them."""
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
    """Every effect on, at its best."""
    touched: dict[Effect, Touch]
    """By each effect that ran and can be left out."""

    @property
    def difference(self) -> Float[np.ndarray, "eye y x"]:
        """Full minus planned in code values: of each pixel the channel that differs most, with its sign."""
        apart = code_values(self.full) - code_values(self.planned)
        return np.take_along_axis(apart, np.abs(apart).argmax(-1)[..., None], -1)[..., 0]


def explain(subject: Subject, done: Callable[[], None] = lambda: None) -> Explained:
    """Perceives the frame in all its variants. `done` is told of each; there are at most `variants()` of them."""
    _perceive(subject, subject.settings.glare, _as_it_is)  # compiles: its times mean nothing
    done()
    planned = _perceive(subject, subject.settings.glare, _as_it_is)
    done()
    best = Glare(subject.settings.glare.model, GlareLevel.FRAME, subject.settings.glare.above_display)
    full = _perceive(subject, best, _everything)
    done()
    touched = {}
    for step in planned.plan:
        if step.runs and step.effect not in ALWAYS:
            without = _perceive(subject, subject.settings.glare, _without(step.effect))
            touched[step.effect] = Touch(np.abs(code_values(planned) - code_values(without)).max(-1))
        done()
    return Explained(planned, full, touched)


def variants() -> int:
    """How often `explain` tells that something is done."""
    return 3 + len(Effect)


def code_values(perceived: Perceived) -> Float[np.ndarray, "eye y x 3"]:
    """What the display is sent, in code values; of a linear image 255 to the display's peak."""
    image = perceived.image
    return image.astype(np.float64) * (255.0 if np.issubdtype(image.dtype, np.floating) else 1.0)


def _perceive(subject: Subject, glare: Glare, revised: Callable[[Plan], Plan]) -> Perceived:
    with _plans(revised):
        return perceive(
            subject.frame,
            subject.looking,
            observer=subject.settings.observer,
            display=subject.settings.display,
            state=None if subject.adapted_cd_m2 is None else RenderState(subject.adapted_cd_m2),
            glare=glare,
        )


def _as_it_is(plan: Plan) -> Plan:
    return plan


def _everything(plan: Plan) -> Plan:
    return tuple(step if step.runs else Step(step.effect, "on", "everything is on") for step in plan)


def _without(effect: Effect) -> Callable[[Plan], Plan]:
    def left_out(plan: Plan) -> Plan:
        return tuple(Step(effect, SKIPPED, "left out") if step.effect == effect else step for step in plan)

    return left_out


@contextlib.contextmanager
def _plans(revised: Callable[[Plan], Plan]) -> Iterator[None]:
    """Within it, plans are revised before they run."""
    make = render.make_plan
    render.make_plan = lambda *given, **named: revised(make(*given, **named))
    try:
        yield
    finally:
        render.make_plan = make
