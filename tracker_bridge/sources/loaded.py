"""Samples in the order of their time, each time and eye once: what every source that reads a whole file ends in."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import TypeVar

import msgspec

from entoptic.tracker_bridge.samples import GazeSample, PupilSample
from entoptic.tracker_bridge.source import SourceError, SourceInfo

Sample = PupilSample | GazeSample
OneKind = TypeVar("OneKind", PupilSample, GazeSample)

_BOTH = 2
"""Sorts the direction of both eyes behind those of the right (0) and the left (1)."""


class LoadedSource(msgspec.Struct, frozen=True):
    """A source whose samples are all in memory."""

    info: SourceInfo
    ordered: tuple[Sample, ...]

    def samples(self) -> Iterator[Sample]:
        """All samples in the order of their time; at the same time pupils before gaze, right, left, both."""
        return iter(self.ordered)


def sort_key(sample: Sample) -> tuple[int, bool, int]:
    """What samples are ordered by; also what must not occur twice."""
    return sample.t_ns, isinstance(sample, GazeSample), _BOTH if sample.eye is None else sample.eye


def load(
    name: str,
    pupils: Sequence[PupilSample],
    gazes: Sequence[GazeSample],
    notes: Iterable[str],
    computed: Sequence[GazeSample] = (),
) -> LoadedSource:
    """A source of these samples, sorted, without repetitions: of two samples of one time and eye the first stays.

    What had to be repaired is added to the notes; not so for `computed` directions, which were not recorded as such
    and so cannot be at fault. Raises SourceError where there is no sample at all.
    """
    notes = [*notes, *_faults(pupils, "pupil samples"), *_faults(gazes, "gaze directions")]
    every: list[Sample] = [*pupils, *gazes, *computed]
    if not every:
        raise SourceError(f"{name} holds no samples: there is nothing to show; choose another source")
    unique: dict[tuple[int, bool, int], Sample] = {}
    for sample in every:
        unique.setdefault(sort_key(sample), sample)
    ordered = tuple(unique[key] for key in sorted(unique))
    info = SourceInfo(name=name, t_start_ns=ordered[0].t_ns, t_end_ns=ordered[-1].t_ns, notes=tuple(notes))
    return LoadedSource(info, ordered)


def _faults(samples: Sequence[OneKind], what: str) -> list[str]:
    """What is wrong with the order of recorded samples, a sentence each."""
    notes = []
    backward = sum(after.t_ns < before.t_ns for before, after in itertools.pairwise(samples))
    if backward:
        notes.append(f"Among {len(samples):,} {what} time went backwards; they were sorted; steps back: {backward:,}.")
    repeated = len(samples) - len({sort_key(sample) for sample in samples})
    if repeated:
        notes.append(f"Of {len(samples):,} {what} those that repeat a time and eye were dropped: {repeated:,}.")
    return notes
