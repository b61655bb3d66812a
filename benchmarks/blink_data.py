"""Recordings with labelled blinks, from ../shared/data: eyes as samples, and the blinks that somebody or something saw.

Where people labelled blinks those labels are taken. Tobii's recordings come with an instruction only ("blink slowly");
their labels are read off each eye's own openness, offline, by a rule that knows no pupil: the median over five samples
is below 0.3 until it is above 0.5, and gaps below 200 ms are closed. So they check the count where the detector sees
openness too, and are independent of it where it does not.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
import scipy.io
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.signal import find_peaks, peak_widths

from entoptic.services.event_scores import Span
from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.sources import open_source

_BLINK = 5
"""The label of a blink in Lund's and in the Tilburg group's files."""


class LabelledEye(NamedTuple):
    """One eye of one recording."""

    samples: list[PupilSample]
    blinks: list[Span]


def lund(data: Path, rater: str) -> list[LabelledEye]:
    """Every recording that this rater, "MN" or "RA", labelled: 500 Hz, pupil width and height in whole px."""
    eyes = []
    for path in sorted((data / "eye/lund2013").glob(f"*/*_{rater}.mat")):
        table = scipy.io.loadmat(path, struct_as_record=False, squeeze_me=True)["ETdata"].pos
        sizes = np.sqrt(table[:, 1] * table[:, 2])
        samples = [
            PupilSample(2_000_000 * k, Eye.LEFT, None, 1.0 if px > 0.0 else 0.0, diameter_px=px)
            for k, px in enumerate(sizes.tolist())
        ]
        eyes.append(LabelledEye(samples, _spans(np.arange(len(table)) * 2_000_000, table[:, 5] == _BLINK)))
    return eyes


def irf(data: Path) -> list[LabelledEye]:
    """Two people at 1000 Hz; whether the pupil was found is all that these files say of it."""
    eyes = []
    for name in ("S1", "S2"):
        table = np.load(data / f"eye/irf/lookAtPoint_EL_{name}.npy")
        t_ns = np.round(table["t"] * 1e9).astype(np.int64)
        found = table["status"].astype(float).tolist()
        samples = [PupilSample(at, Eye.LEFT, None, sure) for at, sure in zip(t_ns.tolist(), found, strict=True)]
        eyes.append(LabelledEye(samples, _spans(t_ns, table["evt"] == _BLINK)))
    return eyes


def tobii(data: Path, instruction: str, *, with_openness: bool) -> list[LabelledEye]:
    """Both eyes of somebody at 120 Hz who was told to blink so; the pupil in mm and, if wanted, openness."""
    path = data / f"eye/tobii_fusion/P1 - {instruction}.tsv"
    eyes = []
    for samples in _both(path):
        t_ns = np.array([sample.t_ns for sample in samples])
        openness = np.array([np.nan if sample.openness is None else sample.openness for sample in samples])
        if not with_openness:
            samples = without_openness(samples)
        eyes.append(LabelledEye(samples, list(_closures(t_ns, openness))))
    return eyes


def tobii_dips(data: Path) -> list[LabelledEye]:
    """The same person told to blink partially; labels: each dip of both eyes' mean openness by 0.15 and more."""
    both = _both(data / "eye/tobii_fusion/P1 - partial blinks.tsv")
    each = np.array([[sample.openness for sample in samples] for samples in both], dtype=np.float64)
    openness = median_filter(each.mean(axis=0), 5)
    peaks, _ = find_peaks(-openness, prominence=0.15, distance=24, width=3)
    _, _, starts, ends = peak_widths(-openness, peaks, rel_height=0.5)
    t_ns = [sample.t_ns for sample in both[0]]
    blinks = [Span(t_ns[int(a)], t_ns[int(b)], "blink") for a, b in zip(starts, ends, strict=True)]
    return [LabelledEye(samples, blinks) for samples in both]


def capture(data: Path) -> list[LabelledEye]:
    """Both eyes of Pupil Capture 3.6 at 60 Hz before drawn eyes, which blink every 4 s; it stalled for 0.3 s once."""
    starts_s = [1536.52, 1540.52, *(1544.84 + 4.0 * k for k in range(10))]
    blinks = [Span(round(start_s * 1e9), round(start_s * 1e9) + 180_000_000, "blink") for start_s in starts_s]
    return [LabelledEye(samples, blinks) for samples in _both(data / "eye/pupil_core/capture_3_6")]


def player(data: Path) -> list[LabelledEye]:
    """Both eyes of a real Pupil Core at 200 Hz, confidence alone; the labels are Pupil's own detector's."""
    folder = data / "eye/pupil_core"
    table = np.genfromtxt(folder / "tutorial10_blinks.csv", delimiter=",", skip_header=1, usecols=(1, 3))
    blinks = [Span(round(start_s * 1e9), round(end_s * 1e9), "blink") for start_s, end_s in table.tolist()]
    items = open_source(str(folder / "tutorial10_gaze_positions.csv")).samples()
    gazes = [item for item in items if isinstance(item, GazeSample)]
    eyes = []
    for eye in Eye:
        own = [gaze for gaze in gazes if gaze.eye is eye]
        eyes.append(LabelledEye([PupilSample(gaze.t_ns, eye, None, gaze.confidence) for gaze in own], blinks))
    return eyes


def _both(path: Path) -> list[list[PupilSample]]:
    samples = [sample for sample in open_source(str(path)).samples() if isinstance(sample, PupilSample)]
    return [[sample for sample in samples if sample.eye is eye] for eye in Eye]


def _spans(t_ns: NDArray[np.int64], inside: NDArray[np.bool_]) -> list[Span]:
    edges = np.diff(np.concatenate([[0], inside.astype(int), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [Span(int(t_ns[a]), int(t_ns[b]), "blink") for a, b in zip(starts, ends, strict=True)]


def _closures(t_ns: NDArray[np.int64], openness: NDArray[np.float64]) -> Iterator[Span]:
    # Openness is missing while an eye is shut for long: the last value goes on.
    known = np.maximum.accumulate(np.where(np.isnan(openness), 0, np.arange(openness.size)))
    smooth = median_filter(openness[known], 5)
    shut = np.zeros(openness.size, dtype=bool)
    for k, value in enumerate(smooth.tolist()):
        shut[k] = value < 0.3 or (k > 0 and shut[k - 1] and value <= 0.5)
    merged: list[Span] = []
    for span in _spans(t_ns, shut):
        if merged and span.onset_ns - merged[-1].offset_ns < 200_000_000:
            span = merged.pop()._replace(offset_ns=span.offset_ns)
        merged.append(span)
    yield from merged


def without_openness(samples: list[PupilSample]) -> list[PupilSample]:
    """The same samples from a tracker that does not see lids."""
    return [msgspec.structs.replace(sample, openness=None) for sample in samples]
