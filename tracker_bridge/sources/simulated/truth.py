"""What a simulated pair of eyes really did: the labels that detectors are scored against."""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from entoptic.tracker_bridge.samples import Eye

Floats = NDArray[np.float64]


class TruthEvent(msgspec.Struct, frozen=True):
    """Something that the eyes did."""

    kind: Literal["blink", "microsaccade", "saccade"]
    eye: Eye | None
    """None: both eyes."""
    onset_ns: int
    """The lid, or the eye, starts to move."""
    offset_ns: int
    """The lid is open again, or the eye has arrived."""
    amplitude_deg: float | None = None
    """Of an eye movement, from its start to its end; None for a blink."""
    peak_velocity_deg_s: float | None = None
    """Of an eye movement, without the drift below it; None for a blink."""


@dataclasses.dataclass(frozen=True)
class Truth:
    """The eyes without any tracker, at the tracker's n times."""

    events: tuple[TruthEvent, ...]
    """In the order of their onsets."""
    t_ns: NDArray[np.int64]
    """Shape (n,)."""
    azimuth_deg: Floats
    """Shape (2, n), the right eye first."""
    elevation_deg: Floats
    """Shape (2, n), the right eye first."""
    pupil_diameter_mm: Floats
    """Shape (n,): both pupils are equal, as in a healthy person."""
    openness: Floats
    """Shape (n,), 0 … 1: both lids move together."""

    def part(self, times: slice, pupil_diameter_mm: Floats) -> Truth:
        """Some of its times, with other pupils."""
        return dataclasses.replace(
            self,
            t_ns=self.t_ns[times],
            azimuth_deg=self.azimuth_deg[:, times],
            elevation_deg=self.elevation_deg[:, times],
            pupil_diameter_mm=pupil_diameter_mm,
            openness=self.openness[times],
        )

    def write_csv(self, path: Path) -> None:
        """Writes the events as a table, one line each, with the fields of `TruthEvent` as columns.

        The eye is "right", "left" or "both"; what a blink does not have is empty.
        """
        columns = TruthEvent.__struct_fields__
        with path.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(columns)
            for event in self.events:
                cells = {column: getattr(event, column) for column in columns}
                cells["eye"] = "both" if event.eye is None else event.eye.name.lower()
                writer.writerow("" if cell is None else cell for cell in cells.values())
