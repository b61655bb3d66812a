"""How well found eye movements agree with labelled ones: matching one to one, precision, recall, F1, timing errors."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

SLACK_NS = 20_000_000
"""Found and labelled movements match where they overlap or lie no further apart than this. Engineering choice: a
microsaccade of 6 ms at 60 Hz lies between two samples; the shortest time between two movements is 150 ms."""


class Span(NamedTuple):
    """A movement, found or labelled."""

    onset_ns: int
    offset_ns: int
    kind: str = "saccade"


@dataclasses.dataclass(frozen=True)
class Scores:
    """The agreement; a quotient of nothing is NaN."""

    found: int
    labelled: int
    pairs: tuple[tuple[int, int], ...]
    """Positions (in what was found, in the labels) of those that match."""
    onset_errors_ms: NDArray[np.float64]
    """Found less labelled, of each pair."""
    offset_errors_ms: NDArray[np.float64]

    @property
    def precision(self) -> float:
        """The share of the found ones that are labelled."""
        return _share(len(self.pairs), self.found)

    @property
    def recall(self) -> float:
        """The share of the labelled ones that were found."""
        return _share(len(self.pairs), self.labelled)

    @property
    def f1(self) -> float:
        """Harmonic mean of both."""
        return _share(2 * len(self.pairs), self.found + self.labelled)


def _share(part: int, whole: int) -> float:
    return part / whole if whole else math.nan


def compare(found: Sequence[Span], labelled: Sequence[Span], slack_ns: int = SLACK_NS) -> Scores:
    """Matches each movement with at most one, those with the nearest onsets first; their kinds do not matter."""
    near = sorted(
        (abs(one.onset_ns - other.onset_ns), i, j)
        for i, one in enumerate(found)
        for j, other in enumerate(labelled)
        if one.onset_ns <= other.offset_ns + slack_ns and other.onset_ns <= one.offset_ns + slack_ns
    )
    taken_found: set[int] = set()
    taken_labelled: set[int] = set()
    pairs: list[tuple[int, int]] = []
    for _, i, j in near:
        if i not in taken_found and j not in taken_labelled:
            taken_found.add(i)
            taken_labelled.add(j)
            pairs.append((i, j))
    pairs.sort()
    return Scores(
        found=len(found),
        labelled=len(labelled),
        pairs=tuple(pairs),
        onset_errors_ms=np.array([(found[i].onset_ns - labelled[j].onset_ns) * 1e-6 for i, j in pairs]),
        offset_errors_ms=np.array([(found[i].offset_ns - labelled[j].offset_ns) * 1e-6 for i, j in pairs]),
    )


def error_text(errors_ms: NDArray[np.float64]) -> str:
    """Bias (median), median size and 90th percentile of the size, in ms."""
    if errors_ms.size == 0:
        return "–"
    sizes = np.abs(errors_ms)
    return f"{np.median(errors_ms):+.1f} / {np.median(sizes):.1f} / {np.percentile(sizes, 90):.1f}"
