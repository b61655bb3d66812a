"""states.csv and events.csv: what a bridge published, a row each, whole at every moment.

A row is one write to the operating system: a bridge that is killed loses none, and one that is started again goes on
below. That costs 10 µs a row beside 27 µs for its text, 0.2 % of a core at 200 Hz.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from entoptic.services.results.appended import Appended, row, whole_rows
from entoptic.tracker_bridge.events import Event, SaccadeOffset, SaccadeOnset, StreamStarted
from entoptic.tracker_bridge.samples import NS_PER_S, Eye, EyeState

STATES, EVENTS = "states.csv", "events.csv"
STATE_COLUMNS = (
    "sequence",
    "t_s",
    "gaze_azimuth_deg",
    "gaze_elevation_deg",
    *(
        f"{eye}_{quantity}"
        for eye in ("right", "left")
        for quantity in ("phase", "pupil_diameter_mm", "measured_mm", "confidence", "openness", "borrowed")
    ),
)
EVENT_COLUMNS = ("t_s", "event", "eye", "duration_ms", "amplitude_deg", "peak_velocity_deg_s", "detail")


class Tables:
    """Both tables in a folder that is there. All methods but `close` raise OSError where they cannot be written."""

    def __init__(self, folder: Path, start_ns: int | None = None) -> None:
        """Times count from `start_ns`, and rows are added to those that are there; unless it is given, they count from
        the stream's start, and the tables are new."""
        self._start_ns = start_ns or 0
        self._of_stream = start_ns is None
        self._states = self._open(folder / STATES, STATE_COLUMNS)
        try:
            self._events = self._open(folder / EVENTS, EVENT_COLUMNS)
        except OSError:
            self._states.close()
            raise

    def _open(self, path: Path, columns: Sequence[str]) -> Appended:
        file = Appended(path, 0 if self._of_stream else whole_rows(path))
        try:
            if file.size == 0:
                file.write(row(columns))
        except OSError:
            file.close()
            raise
        return file

    def add(self, record: EyeState | Event) -> None:
        """One row more."""
        if self._of_stream and isinstance(record, StreamStarted):
            self._start_ns = record.t_ns
        if isinstance(record, EyeState):
            self._states.write(row(self._state_row(record)))
        else:
            self._events.write(row(self._event_row(record)))

    def check(self) -> None:
        """Raises FileNotFoundError where somebody deleted them."""
        self._states.check()
        self._events.check()

    def close(self) -> None:
        """Nothing is left to be written."""
        self._states.close()
        self._events.close()

    def _state_row(self, state: EyeState) -> list[object]:
        gaze = state.gaze
        cells: list[object] = [state.sequence, self._seconds(state.t_ns)]
        cells += ["", ""] if gaze is None else [f"{gaze.azimuth_deg:.4f}", f"{gaze.elevation_deg:.4f}"]
        for one in (state.right, state.left):
            cells += [one.phase.value, *(_number(value) for value in (one.pupil_diameter_mm, one.measured_mm))]
            cells += [_number(one.confidence), _number(one.openness), int(one.borrowed)]
        return cells

    def _event_row(self, event: Event) -> list[object]:
        fields = msgspec.structs.asdict(event)
        duration_ns = fields.pop("duration_ns", None)
        if isinstance(event, SaccadeOffset):
            duration_ns = event.offset_ns - event.onset_ns
        eye = fields.pop("eye", None)
        amplitude, velocity = (fields.pop(name, None) for name in ("amplitude_deg", "peak_velocity_deg_s"))
        fields.pop("t_ns")
        for name in ("onset_ns", "offset_ns") if isinstance(event, SaccadeOnset | SaccadeOffset) else ():
            if name in fields:
                fields[name.replace("_ns", "_s")] = self._seconds(fields.pop(name))
        return [
            self._seconds(event.t_ns),
            type(event).__name__,
            "" if eye is None else Eye(eye).name.lower(),
            "" if duration_ns is None else f"{duration_ns * 1e-6:.1f}",
            _number(amplitude),
            _number(velocity),
            "; ".join(f"{name} {_number(v) if isinstance(v, float) else v}" for name, v in fields.items()),
        ]

    def _seconds(self, t_ns: int) -> str:
        return f"{(t_ns - self._start_ns) / NS_PER_S:.6f}"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4f}"
