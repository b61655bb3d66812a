"""What a plan says."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

from entoptic.pipeline.effects.effect import SKIPPED

OFF = "off"
"""The level of an effect that the settings switch off."""


@dataclasses.dataclass(frozen=True)
class Step:
    """What the plan says of one effect."""

    effect: str
    """Its name."""
    level: str
    """How it runs, or `skipped` or `off`."""
    reason: str
    """Why, with the measured figures."""
    bound_code_values: float = 0.0
    """The most by which doing it so, and not in full, changes any component of any pixel, all else in full."""
    fading_from: str | None = None
    """The level before, while the picture still passes from it."""
    fade: float = 1.0
    """Weight of `level`; that of `fading_from` is the rest."""

    @property
    def runs(self) -> bool:
        """Whether the effect runs at all."""
        return any(level not in (SKIPPED, OFF) for level in self.weights)

    @property
    def weights(self) -> dict[str, float]:
        """The levels to compute and their weights, which add up to 1."""
        if self.fading_from is None:
            return {self.level: 1.0}
        both = {self.level: self.fade, self.fading_from: 1 - self.fade}
        return {level: weight for level, weight in both.items() if weight}


@dataclasses.dataclass(frozen=True)
class Plan:
    """A step for each effect, in the order in which they run."""

    steps: tuple[Step, ...]
    bound_code_values: float = 0.0
    """The most by which any component of any pixel, before rounding, differs from that of a frame with every effect in
    full: what is paid for all skips together."""

    def __iter__(self) -> Iterator[Step]:
        return iter(self.steps)

    def __getitem__(self, effect: str) -> Step:
        return next(step for step in self.steps if step.effect == effect)
