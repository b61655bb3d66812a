"""How much a plan may leave out."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, Annotated

import msgspec

from entoptic.described import described
from entoptic.pipeline.effects import OPTIONAL

if TYPE_CHECKING:
    OptionalEffect = str
else:
    OptionalEffect = enum.StrEnum("OptionalEffect", {name.upper(): name for name in OPTIONAL})


class Planning(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What decides between accuracy and time."""

    everything: Annotated[bool, described("Every effect runs in full, called for or not.")] = False
    leave_out: Annotated[
        frozenset[OptionalEffect],
        described("Effects that do not run whatever they would change: to see what each of them does."),
    ] = frozenset()
    tolerance_code_values: Annotated[
        float,
        described(
            "An effect, or a better level of it, is left out where it changes no component of any pixel by more. "
            "Half a code value rounds to the same code value, give or take one.",
            gt=0.0,
            le=64.0,
        ),
    ] = 0.5
    budget_ms: Annotated[
        Annotated[float, msgspec.Meta(gt=0.0, le=1e6)] | None,
        described(
            "Time that a frame may take: of all plans that fit, the one of least predicted error. None: what it takes.",
            slider=(5.0, 500.0),
            first=True,
        ),
    ] = None

    def __post_init__(self) -> None:
        if unknown := self.leave_out - set(OPTIONAL):
            raise ValueError(
                f"{', '.join(sorted(unknown))} cannot be left out: effects that can are {', '.join(OPTIONAL)}"
            )
        if self.everything and self.budget_ms is not None:
            raise ValueError("everything and budget_ms exclude each other: choose one")
