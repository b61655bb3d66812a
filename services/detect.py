"""Finds saccades, microsaccades and blinks in a recording, by the code that finds them live, and scores them."""

from __future__ import annotations

import bisect
import csv
import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from entoptic.services.event_scores import Scores, Span, compare
from entoptic.tracker_bridge.chain import records_of
from entoptic.tracker_bridge.events import BlinkOffset, BlinkOnset, SaccadeKind, SaccadeOffset, SaccadeOnset
from entoptic.tracker_bridge.microsaccades import COVERED, MIN_CONFIDENCE
from entoptic.tracker_bridge.samples import NS_PER_S, Eye, EyeState, GazeSample
from entoptic.tracker_bridge.source import Item, Source, SourceError

AT_BLINK_NS = 100_000_000
"""A movement that ends so shortly before the eye is lost may be the lid's. Online nobody can know in time."""

MOVEMENTS = frozenset(kind.value for kind in SaccadeKind)
BLINK = "blink"


@dataclasses.dataclass(frozen=True)
class Found:
    """One line of the table; what an event does not have is None. Times are those of the recording, in s."""

    kind: str
    """saccade, microsaccade or blink."""
    eye: str
    """right, left or both."""
    onset_s: float
    detection_s: float | None
    """Time of the sample that showed a movement: its latency is this less the onset."""
    offset_s: float
    amplitude_deg: float | None = None
    peak_velocity_deg_s: float | None = None
    azimuth_deg: float | None = None
    """The movement to the right."""
    elevation_deg: float | None = None
    """The movement upwards."""
    direction_deg: float | None = None
    """0 to the right, 90 upwards, −90 downwards."""
    at_blink: bool | None = None
    """The eye was lost within 100 ms after it: perhaps the lid. Not scored and not plotted."""

    @property
    def span(self) -> Span:
        """When it was."""
        return Span(round(self.onset_s * NS_PER_S), round(self.offset_s * NS_PER_S), self.kind)


def detect(source: Source) -> list[Found]:
    """All events of a recorded source, in the order of their onsets. Raises SourceError where there is no gaze."""
    saccades: list[SaccadeOnset | SaccadeOffset] = []
    blinks: list[tuple[int, BlinkOffset]] = []
    blink_onsets_ns: dict[Eye, int] = {}
    lost_ns: list[int] = []
    gaze_count = 0

    def watched() -> Iterator[Item]:
        nonlocal gaze_count
        for item in source.samples():
            if isinstance(item, GazeSample):
                gaze_count += 1
                if item.confidence < MIN_CONFIDENCE:
                    lost_ns.append(item.t_ns)
            yield item

    for record in records_of(watched()):
        match record:
            case EyeState():
                if any(one.phase in COVERED and one.t_ns == record.t_ns for one in (record.right, record.left)):
                    lost_ns.append(record.t_ns)
            case SaccadeOnset() | SaccadeOffset():
                saccades.append(record)
            case BlinkOnset():
                blink_onsets_ns[record.eye] = record.t_ns
            case BlinkOffset() if record.eye in blink_onsets_ns:
                blinks.append((blink_onsets_ns.pop(record.eye), record))
    if not gaze_count:
        raise SourceError(f"{source.info.name} holds no directions of gaze: choose a recording that does, or map them")
    lost_ns.sort()
    onsets = {event.onset_ns: event for event in saccades if isinstance(event, SaccadeOnset)}
    found = [
        _movement(onsets[event.onset_ns], event, lost_after(lost_ns, event))
        for event in saccades
        if isinstance(event, SaccadeOffset)
    ]
    found += [
        Found(BLINK, offset.eye.name.lower(), onset_ns / NS_PER_S, None, offset.t_ns / NS_PER_S)
        for onset_ns, offset in blinks
    ]
    return sorted(found, key=lambda event: event.onset_s)


def _movement(onset: SaccadeOnset, offset: SaccadeOffset, at_blink: bool) -> Found:
    return Found(
        kind=offset.kind.value,
        eye="both",
        onset_s=onset.onset_ns / NS_PER_S,
        detection_s=onset.t_ns / NS_PER_S,
        offset_s=offset.offset_ns / NS_PER_S,
        amplitude_deg=offset.amplitude_deg,
        peak_velocity_deg_s=offset.peak_velocity_deg_s,
        azimuth_deg=offset.azimuth_deg,
        elevation_deg=offset.elevation_deg,
        direction_deg=math.degrees(math.atan2(offset.elevation_deg, offset.azimuth_deg)),
        at_blink=at_blink,
    )


def lost_after(lost_ns: Sequence[int], movement: SaccadeOffset) -> bool:
    """Whether a movement ends so shortly before an eye is lost, at one of these rising times, that a lid may be it."""
    at = bisect.bisect_left(lost_ns, movement.onset_ns)
    return at < len(lost_ns) and lost_ns[at] <= movement.offset_ns + AT_BLINK_NS


def write_csv(path: Path, found: Iterable[Found]) -> None:
    """Writes one line an event, with the fields of `Found` as columns. Raises SourceError where it cannot."""
    columns = [field.name for field in dataclasses.fields(Found)]
    try:
        with path.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(columns)
            for event in found:
                writer.writerow(_cell(column, getattr(event, column)) for column in columns)
    except OSError as error:
        raise SourceError(f"{path} cannot be written: {error.strerror}; choose another place with --out") from None


def _cell(column: str, value: object) -> object:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6f}" if column.endswith("_s") and not column.endswith("deg_s") else f"{value:.4f}"
    return value


def read_labels(path: Path) -> list[Span]:
    """The labelled events in a CSV file.

    Its columns are onset_s, offset_s or onset_ns, offset_ns, on the recording's clock, and kind; without a kind all are
    saccades; other columns do not matter. `entoptic simulate` writes such a file as truth.csv.

    Raises SourceError that names the file and the line.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise SourceError(f"labels {path} cannot be read: {error}. Name a CSV file") from None
    rows = csv.DictReader(lines)
    columns = set(rows.fieldnames or ())
    unit, to_ns = ("ns", 1.0) if {"onset_ns", "offset_ns"} <= columns else ("s", 1e9)
    if not {f"onset_{unit}", f"offset_{unit}"} <= columns:
        raise SourceError(f"labels {path}: its first line must name the columns onset_s and offset_s, or both in _ns")
    return [_label(row, unit, to_ns, f"labels {path}, line {rows.line_num}") for row in rows]


def _label(row: Mapping[str, str | None], unit: str, to_ns: float, where: str) -> Span:
    try:
        onset_ns, offset_ns = (round(float(row[f"{edge}_{unit}"] or "") * to_ns) for edge in ("onset", "offset"))
    except (TypeError, ValueError, OverflowError):
        raise SourceError(f"{where}: onset or offset is no number of {unit}") from None
    if offset_ns < onset_ns:
        raise SourceError(f"{where}: it ends before it begins; swap its onset and offset")
    return Span(onset_ns, offset_ns, row.get("kind") or SaccadeKind.SACCADE.value)


def score(found: Sequence[Found], labels: Sequence[Span]) -> dict[str, Scores]:
    """Agreement with labels: of saccades and microsaccades together, and of blinks where either has any."""
    movements = [event.span for event in found if event.kind in MOVEMENTS and not event.at_blink]
    scores = {"eye movements": compare(movements, [label for label in labels if label.kind in MOVEMENTS])}
    blinks = _merged(event.span for event in found if event.kind == BLINK)
    labelled = _merged(label for label in labels if label.kind == BLINK)
    if labelled:
        scores["blinks"] = compare(blinks, labelled)
    return scores


def _merged(spans: Iterable[Span]) -> list[Span]:
    """Both eyes' events as one where they overlap."""
    whole: list[Span] = []
    for span in sorted(spans):
        if whole and span.onset_ns <= whole[-1].offset_ns:
            whole[-1] = whole[-1]._replace(offset_ns=max(whole[-1].offset_ns, span.offset_ns))
        else:
            whole.append(span)
    return whole


def plot_main_sequence(path: Path, found: Iterable[Found], title: str) -> None:
    """Draws peak velocity over amplitude, both logarithmic. Raises SourceError where it cannot be written."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.8), dpi=100, layout="constrained")
    axes = figure.add_subplot(xscale="log", yscale="log")
    for kind, colour in ((SaccadeKind.MICROSACCADE, "tab:blue"), (SaccadeKind.SACCADE, "tab:orange")):
        points = [
            (event.amplitude_deg, event.peak_velocity_deg_s)
            for event in found
            if event.kind == kind and not event.at_blink and event.amplitude_deg and event.peak_velocity_deg_s
        ]
        axes.plot(
            [amplitude for amplitude, _ in points],
            [peak for _, peak in points],
            ".",
            color=colour,
            markersize=5,
            label=f"{len(points)} {kind}s",
        )
    axes.set(xlabel="amplitude (°)", ylabel="peak velocity (°/s)", title=title)
    axes.grid(visible=True, which="both", linewidth=0.3)
    axes.legend()
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise SourceError(f"{path} cannot be drawn: {error}; choose another place or ending with --plot") from None
