"""Events of a recording, and how they are scored."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from entoptic.services.detect import Found, detect, plot_main_sequence, read_labels, score, write_csv
from entoptic.services.event_scores import Span, compare
from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.loaded import load
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings

MS = 1_000_000


@pytest.fixture(scope="module")
def eyes() -> SimulatedEyes:
    return SimulatedEyes(SimulatedSettings(seconds=20.0, seed=3))


@pytest.fixture(scope="module")
def found(eyes: SimulatedEyes) -> list[Found]:
    return detect(eyes)


def test_a_recordings_events_agree_with_its_truth(eyes: SimulatedEyes, found: list[Found], tmp_path: Path) -> None:
    truth = tmp_path / "truth.csv"
    eyes.write_truth_csv(truth)
    scores = score(found, read_labels(truth))
    assert scores["eye movements"].f1 >= 0.95
    assert np.median(np.abs(scores["eye movements"].onset_errors_ms)) <= 3.0
    assert scores["blinks"].f1 >= 0.9


def test_each_event_is_one_line(found: list[Found], tmp_path: Path) -> None:
    path = tmp_path / "events.csv"
    write_csv(path, found)
    rows = list(csv.DictReader(path.read_text().splitlines()))
    assert [row["kind"] for row in rows] == [event.kind for event in found]
    assert {"blink", "saccade", "microsaccade"} == {row["kind"] for row in rows}
    for row, event in zip(rows, found, strict=True):
        assert float(row["onset_s"]) == pytest.approx(event.onset_s, abs=1e-6)
        assert float(row["offset_s"]) >= float(row["onset_s"])
        if row["kind"] == "blink":
            assert row["amplitude_deg"] == row["detection_s"] == ""
        else:
            assert float(row["detection_s"]) > float(row["onset_s"])
            assert float(row["amplitude_deg"]) == pytest.approx(event.amplitude_deg, abs=1e-4)


def test_the_table_may_serve_as_labels(found: list[Found], tmp_path: Path) -> None:
    path = tmp_path / "events.csv"
    write_csv(path, found)
    perfect = score(found, read_labels(path))["eye movements"]
    assert perfect.recall == 1.0 or any(event.at_blink for event in found)
    assert perfect.precision == 1.0
    assert np.abs(perfect.onset_errors_ms).max() < 1e-3


def test_the_main_sequence_is_a_small_picture(found: list[Found], tmp_path: Path) -> None:
    path = tmp_path / "main-sequence.png"
    plot_main_sequence(path, found, "Simulated eyes")
    content = path.read_bytes()
    assert content.startswith(b"\x89PNG")
    assert len(content) < 100_000


def test_a_recording_without_gaze_is_named() -> None:
    pupils = [PupilSample(n * MS, Eye.LEFT, 4.0, 1.0) for n in range(3)]
    with pytest.raises(SourceError, match="only pupils holds no directions of gaze"):
        detect(load("only pupils", pupils, [], []))


def test_a_table_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r"events\.csv cannot be written"):
        write_csv(tmp_path / "nowhere" / "events.csv", [])
    with pytest.raises(SourceError, match="cannot be drawn"):
        plot_main_sequence(tmp_path / "picture.nonsense", [], "")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "first line must name"),
        ("start,end\n1,2\n", "first line must name"),
        ("onset_s,offset_s\n1.0,x\n", "line 2: onset or offset is no number"),
        ("onset_s,offset_s\n1.0,nan\n", "line 2: onset or offset is no number"),
        ("onset_s,offset_s\n1.0,1.1\n2.0\n", "line 3: onset or offset is no number"),
        ("onset_s,offset_s\n1.0,inf\n", "line 2: onset or offset is no number"),
        ("onset_s,offset_s\n2.0,1.0\n", "line 2: it ends before it begins"),
        ("onset_s,offset_s\n1.0,1.1\n\n2.0,1.0\n", "line 4: it ends before it begins"),
    ],
)
def test_labels_that_cannot_be_read_are_named(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    path.write_text(text)
    with pytest.raises(SourceError, match=message) as error:
        read_labels(path)
    assert "labels.csv" in str(error.value)


def test_labels_without_a_file_are_named() -> None:
    with pytest.raises(SourceError, match=r"nowhere\.csv cannot be read"):
        read_labels(Path("nowhere.csv"))


def test_labels_are_saccades_unless_they_say_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    path.write_text("onset_s,offset_s\n1.5,1.55\n")
    assert read_labels(path) == [Span(1_500 * MS, 1_550 * MS, "saccade")]


def test_labels_of_a_spreadsheet_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    path.write_text("onset_s,offset_s\n1.5,1.55\n", encoding="utf-8-sig")
    assert read_labels(path) == [Span(1_500 * MS, 1_550 * MS, "saccade")]


def test_each_movement_is_matched_once_and_with_the_nearest() -> None:
    labelled = [Span(100 * MS, 130 * MS), Span(400 * MS, 410 * MS), Span(900 * MS, 950 * MS)]
    seen = [Span(96 * MS, 140 * MS), Span(125 * MS, 150 * MS), Span(385 * MS, 389 * MS), Span(600 * MS, 610 * MS)]
    scores = compare(seen, labelled)
    assert scores.pairs == ((0, 0), (2, 1))
    assert (scores.precision, scores.recall) == (2 / 4, 2 / 3)
    assert scores.f1 == pytest.approx(2 * 0.5 * (2 / 3) / (0.5 + 2 / 3))
    np.testing.assert_allclose(scores.onset_errors_ms, [-4.0, -15.0])
    np.testing.assert_allclose(scores.offset_errors_ms, [10.0, -21.0])


def test_nothing_found_is_no_recall_and_no_error() -> None:
    scores = compare([], [Span(0, 1)])
    assert scores.recall == 0.0
    assert np.isnan(scores.precision)
    assert scores.onset_errors_ms.size == 0


@pytest.mark.shared_data
def test_drawn_eyes_that_pursue_and_blink_make_blinks_and_no_saccades(shared: Callable[[str], Path]) -> None:
    from entoptic.tracker_bridge.sources import open_source

    events = detect(open_source(str(shared("eye/pupil_core/capture_3_6"))))
    assert sum(event.kind == "blink" for event in events) >= 20  # about 12 of both eyes
    assert sum(event.kind != "blink" and not event.at_blink for event in events) <= 1


@pytest.mark.shared_data
def test_saccades_that_a_person_labelled_are_found(shared: Callable[[str], Path], tmp_path: Path) -> None:
    table = np.load(shared("eye/irf/lookAtPoint_EL_S2.npy"))[:12_000]
    gaze = [
        GazeSample(n * MS, None, float(row["x"]), -float(row["y"]), 1.0)
        if row["status"]
        else GazeSample(n * MS, None, 0.0, 0.0, 0.0)
        for n, row in enumerate(table)
    ]
    edges = np.flatnonzero(np.diff(table["evt"] == 2, prepend=False, append=False)).reshape(-1, 2)
    # In the first half second the noise is still unknown.
    labels = [Span(int(first) * MS, int(end - 1) * MS) for first, end in edges if first > 600]
    scores = score(detect(load("irf", [], gaze, [])), labels)["eye movements"]
    assert scores.recall >= 0.95
    assert scores.precision >= 0.85
    assert np.median(np.abs(scores.onset_errors_ms)) <= 2.0
    assert np.median(np.abs(scores.offset_errors_ms)) <= 4.0
