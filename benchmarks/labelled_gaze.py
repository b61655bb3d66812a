"""Recordings in which people labelled the saccades, from ../shared/data: see the README there."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.io
from numpy.typing import NDArray

from entoptic.services.event_scores import Span
from entoptic.tracker_bridge.samples import GazeSample, direction_deg

DATA = Path(__file__).parents[2] / "shared" / "data" / "eye"
SACCADE = 2
"""The label of saccades in both sets; the oscillation after a saccade has another."""


class Labelled(NamedTuple):
    """One recording of one eye."""

    name: str
    rate_hz: float
    gaze: list[GazeSample]
    """Confidence 0 where the tracker lost the eye."""
    labels: dict[str, list[Span]]
    """Saccades, by who labelled them."""


def _spans(labels: NDArray[np.integer], step_ns: int) -> list[Span]:
    edges = np.flatnonzero(np.diff(labels == SACCADE, prepend=False, append=False)).reshape(-1, 2)
    return [Span(int(first) * step_ns, (int(end) - 1) * step_ns) for first, end in edges]


def _gaze(
    azimuth_deg: NDArray[np.float64], elevation_deg: NDArray[np.float64], seen: NDArray[np.bool], step_ns: int
) -> list[GazeSample]:
    seen = seen & np.isfinite(azimuth_deg) & np.isfinite(elevation_deg)
    columns = np.where(seen, azimuth_deg, 0.0), np.where(seen, elevation_deg, 0.0), seen.astype(float)
    return [
        GazeSample(n * step_ns, None, *values)
        for n, values in enumerate(zip(*(column.tolist() for column in columns), strict=True))
    ]


def irf() -> Iterator[Labelled]:
    """1000 Hz, 81 s each, one rater; y runs downwards, as the lids' pull on it shows."""
    for path in sorted((DATA / "irf").glob("*.npy")):
        table = np.load(path)
        gaze = _gaze(table["x"], -table["y"], table["status"], 1_000_000)
        yield Labelled(path.stem, 1000.0, gaze, {"rater": _spans(table["evt"], 1_000_000)})


def lund(kind: str) -> Iterator[Labelled]:
    """500 Hz, 1–10 s each, two raters; `kind` is "img" (pictures) or "dots" (moving dots, mostly pursuit)."""
    for path in sorted((DATA / "lund2013" / kind).glob("*_MN.mat")):
        raters = {}
        for rater in ("MN", "RA"):
            file = path.with_name(path.name.replace("_MN", f"_{rater}"))
            raters[rater] = scipy.io.loadmat(file, simplify_cells=True)["ETdata"]
        count = min(len(data["pos"]) for data in raters.values())
        data = raters["MN"]
        position = data["pos"][:count]
        middle, per_px = data["screenRes"] / 2.0, data["screenDim"] / data["screenRes"]
        right, down = ((position[:, 3:5] - middle) * per_px).T
        angles = [direction_deg(x, -y, data["viewDist"]) for x, y in zip(right, down, strict=True)]
        azimuth, elevation = np.array(angles).T
        seen = np.all(position[:, 3:5] != 0.0, axis=1)
        gaze = _gaze(azimuth, elevation, seen, 2_000_000)
        labels = {name: _spans(labelled["pos"][:count, 5], 2_000_000) for name, labelled in raters.items()}
        yield Labelled(path.stem.removesuffix("_labelled_MN"), 500.0, gaze, labels)


def every(recording: Labelled, nth: int) -> list[GazeSample]:
    """The same gaze as a slower tracker sees it."""
    return recording.gaze[:: math.floor(nth)]
