"""What a live bridge keeps of a recording: states.csv, events.csv, eyes/ and, when it ends, bridge.json.

After a restart of the bridge the tables go on, what the tracker measured goes to eyes-2/, and so on.
"""

from __future__ import annotations

import csv
from pathlib import Path

import msgspec

from entoptic.atomic_file import write_json
from entoptic.services.bridge.tables import STATES, Tables
from entoptic.services.ipc.status import Problem
from entoptic.services.results.folder import BRIDGE
from entoptic.tracker_bridge.events import Event
from entoptic.tracker_bridge.samples import NS_PER_S, EyeState, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Item, Tick
from entoptic.tracker_bridge.sources.pupil_core.recorder import PupilRecorder

GAP_S = 0.5
"""States that come no more often are told of as a gap: as long as a pupil may be gone before it counts as lost."""


class StatesGap(msgspec.Struct, frozen=True):
    """No state was published for longer than GAP_S."""

    from_s: float
    to_s: float


class BridgeSummary(msgspec.Struct, frozen=True):
    """A bridge's summary of a recording."""

    source: str
    states: int
    """In states.csv."""
    rate_hz: float
    """States a second, from the first to the last, gaps included."""
    stalls: int
    """How often a reader fell behind by a whole queue; since the bridge was last started, as the two that follow."""
    late_samples: int
    """Samples that came too late, twice, backwards or from the future, and were left out."""
    directions_beyond_90_deg: int
    """Left out of eyes/, which cannot hold them."""
    recordings: tuple[str, ...]
    """Folders of what the tracker measured, in order: more than one where the bridge was started again."""
    gaps: tuple[StatesGap, ...]
    problem: Problem | None
    """Why it ended before it was told to."""


class BridgeRecording:
    """One recording. All but `close` raise OSError or RecordingError where something cannot be written."""

    def __init__(self, folder: Path, start_ns: int) -> None:
        self.folder, self.start_ns = folder, start_ns
        self._check_ns = 0
        self._states = 0
        self._first_s: float | None = None
        self._last_s: float | None = None
        self._gaps: list[StatesGap] = []
        # A summary is of a recording that has ended.
        (folder / BRIDGE).unlink(missing_ok=True)
        self._recall()
        self._tables = Tables(folder, start_ns)
        try:
            self._recorder = PupilRecorder(_free(folder), name=folder.name)
        except Exception:
            self._tables.close()
            raise

    def item(self, item: Item) -> None:
        """What the tracker measured; once a second of ticks, whether the folder is still there."""
        if isinstance(item, PupilSample | GazeSample):
            self._recorder.add(item)
        elif isinstance(item, Tick) and item.t_ns >= self._check_ns:
            self._check_ns = item.t_ns + NS_PER_S
            self._tables.check()

    def record(self, record: EyeState | Event) -> None:
        """What was published."""
        self._tables.add(record)
        if isinstance(record, EyeState):
            self._count((record.t_ns - self.start_ns) / NS_PER_S)

    def end(self, source: str, stalls: int, late_samples: int, problem: Problem | None = None) -> BridgeSummary:
        """Makes all files whole."""
        try:
            self._recorder.close()
        finally:
            self._tables.close()
            summary = self._summary(source, stalls, late_samples, problem)
            write_json(self.folder / BRIDGE, summary)
        return summary

    def _summary(self, source: str, stalls: int, late_samples: int, problem: Problem | None) -> BridgeSummary:
        lasted_s = 0.0 if self._first_s is None or self._last_s is None else self._last_s - self._first_s
        return BridgeSummary(
            source=source,
            states=self._states,
            rate_hz=round((self._states - 1) / lasted_s, 2) if lasted_s > 0.0 else 0.0,
            stalls=stalls,
            late_samples=late_samples,
            directions_beyond_90_deg=self._recorder.unwritable,
            recordings=tuple(path.name for path in _recordings(self.folder)),
            gaps=tuple(self._gaps),
            problem=problem,
        )

    def _count(self, t_s: float) -> None:
        self._states += 1
        if self._last_s is None:
            self._first_s = t_s
        elif t_s - self._last_s > GAP_S:
            self._gaps.append(StatesGap(round(self._last_s, 3), round(t_s, 3)))
        self._last_s = t_s

    def _recall(self) -> None:
        """Counts what a bridge before this one kept: 0.5 s for an hour of it."""
        path = self.folder / STATES
        if path.exists():
            with path.open(newline="", encoding="utf-8") as file:
                rows = csv.reader(file)
                next(rows, None)
                for row in rows:
                    # The last one may be cut off.
                    if len(row) > 2:
                        self._count(float(row[1]))


def _recordings(folder: Path) -> list[Path]:
    found = [folder / "eyes"]
    while found[-1].exists():
        found.append(folder / f"eyes-{len(found) + 1}")
    return found[:-1]


def _free(folder: Path) -> Path:
    count = len(_recordings(folder))
    return folder / (f"eyes-{count + 1}" if count else "eyes")
