"""Blinks against what people labelled, in recordings that are no part of the project."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from numpy.typing import NDArray

from entoptic.services.event_scores import Scores, Span, compare
from entoptic.tracker_bridge.dropout import DropoutFilter
from entoptic.tracker_bridge.events import BlinkOffset
from entoptic.tracker_bridge.samples import Eye, PupilSample
from entoptic.tracker_bridge.sources import open_source

Shared = Callable[[str], Path]


def blinks(samples: list[PupilSample]) -> list[Span]:
    eye_filter = DropoutFilter()
    events = [event for sample in samples for event in eye_filter.step(sample).events]
    return [
        Span(event.t_ns - event.duration_ns, event.t_ns, "blink") for event in events if isinstance(event, BlinkOffset)
    ]


def labels(t_ns: NDArray[np.int64], inside: NDArray[np.bool_]) -> list[Span]:
    edges = np.diff(np.concatenate([[0], inside.astype(int), [0]]))
    pairs = zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True)
    return [Span(int(t_ns[start]), int(t_ns[end - 1]), "blink") for start, end in pairs]


def f1(scores: list[Scores]) -> float:
    return 2 * sum(len(score.pairs) for score in scores) / sum(score.found + score.labelled for score in scores)


@pytest.mark.shared_data
@pytest.mark.parametrize("rater", ["MN", "RA"])
def test_pixels_alone_agree_with_each_rater(shared: Shared, rater: str) -> None:
    scores = []
    for path in sorted(shared("eye/lund2013").glob(f"*/*_{rater}.mat")):
        table = scipy.io.loadmat(path, struct_as_record=False, squeeze_me=True)["ETdata"].pos
        t_ns = np.arange(len(table)) * 2_000_000
        sizes = np.sqrt(table[:, 1] * table[:, 2])
        samples = [
            PupilSample(at, Eye.LEFT, None, float(px > 0.0), diameter_px=px)
            for at, px in zip(t_ns.tolist(), sizes.tolist(), strict=True)
        ]
        scores.append(compare(blinks(samples), labels(t_ns, table[:, 5] == 5), slack_ns=0))
    assert f1(scores) >= 0.9


@pytest.mark.shared_data
def test_confidence_alone_agrees_with_people(shared: Shared) -> None:
    table = np.load(shared("eye/irf/lookAtPoint_EL_S1.npy"))
    t_ns = np.round(table["t"] * 1e9).astype(np.int64)
    found = table["status"].astype(float).tolist()
    samples = [PupilSample(at, Eye.LEFT, None, sure) for at, sure in zip(t_ns.tolist(), found, strict=True)]
    score = compare(blinks(samples), labels(t_ns, table["evt"] == 5), slack_ns=0)
    assert score.labelled == 22
    assert score.f1 >= 0.9
    assert abs(np.median(score.onset_errors_ms)) < 40
    assert abs(np.median(score.offset_errors_ms)) < 40


@pytest.mark.shared_data
def test_drawn_eyes_that_blink_every_4_s_blink_12_times(shared: Shared) -> None:
    samples = list(open_source(str(shared("eye/pupil_core/capture_3_6"))).samples())
    for eye in Eye:
        found = blinks([s for s in samples if isinstance(s, PupilSample) and s.eye is eye])
        assert len(found) == 12


@pytest.mark.shared_data
def test_a_person_who_held_the_eyes_shut_15_times_blinked_15_times(shared: Shared) -> None:
    """14 times for 2–3 s, and once for 0.2 s between; once more the lids came down part of the way."""
    samples = list(open_source(str(shared("eye/tobii_fusion/P1 - very long blinks.tsv"))).samples())
    for eye in Eye:
        found = blinks([s for s in samples if isinstance(s, PupilSample) and s.eye is eye])
        # The recording ends within the last one.
        assert 14 <= len(found) <= 16
        assert sum(span.offset_ns - span.onset_ns > 1_500_000_000 for span in found) >= 13
