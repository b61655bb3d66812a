"""What settings mean, beside their types and ranges: for command lines, the console's form and the documents."""

from __future__ import annotations

import enum
from typing import Any, Self

import msgspec


def described(
    sentence: str,
    title: str | None = None,
    *,
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
    lt: float | None = None,
    **extra: Any,
) -> msgspec.Meta:
    """For Annotated: what a field means, and its range; `extra` is services.records' and says how it is shown."""
    limits: dict[str, Any] = {"ge": ge, "gt": gt, "le": le, "lt": lt}
    return msgspec.Meta(description=sentence, title=title, extra=extra or None, **limits)


class DescribedEnum(enum.StrEnum):
    """A choice: each member is a value, or a value and a sentence about it."""

    description: str

    def __new__(cls, value: str, description: str = "") -> Self:
        """The member is its value; `description` goes along."""
        member = str.__new__(cls, value)
        member._value_ = value
        member.description = description
        return member
