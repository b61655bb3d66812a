"""The bridge process: opens a source, publishes its states and events, and keeps them as tables."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TextIO

import msgspec
import structlog

from services.process import Stop
from tracker_bridge import bridge
from tracker_bridge.samples import NS_PER_S, Event, Eye, EyeState, Source

STATE_COLUMNS = (
    "sequence",
    "t_s",
    "gaze_azimuth_deg",
    "gaze_elevation_deg",
    *(
        f"{eye}_{quantity}"
        for eye in ("right", "left")
        for quantity in ("phase", "diameter_mm", "measured_mm", "confidence", "openness")
    ),
)
EVENT_COLUMNS = ("t_s", "event", "eye", "duration_ms")


@dataclasses.dataclass(frozen=True)
class BridgeSettings:
    """How a source is published."""

    states_address: str
    events_address: str
    real_time: bool
    """Paced by the recorded time; otherwise as fast as the reader takes it."""
    wait_for_reader: bool
    """Starts when somebody has subscribed to both sockets."""
    seconds: float | None
    tables: Path | None
    """A folder for states.csv and events.csv."""


def run(source: Source, settings: BridgeSettings, stop: Stop, log: structlog.typing.FilteringBoundLogger) -> None:
    """Publishes the source to its end, or until asked to stop. Raises PortInUseError."""
    publisher = bridge.Publisher(settings.states_address, settings.events_address)
    try:
        states_at, events_at = publisher.addresses
        log.info("ready", source=source.info.name, states=states_at, events=events_at)
        for note in source.info.notes:
            log.info("source", note=note)
        if settings.wait_for_reader:
            publisher.wait_for_reader(stop)
        with _tables(settings.tables, source.info.t_start_ns) as write:
            count = bridge.run(
                source,
                publisher,
                real_time=settings.real_time,
                seconds=settings.seconds,
                stopped=stop,
                on_state=write,
            )
        log.info("ended", states=count, dropped=publisher.dropped)
    finally:
        publisher.close()


class _Writer:
    def __init__(self, states: TextIO, events: TextIO, start_ns: int) -> None:
        self._states, self._events, self._start_ns = csv.writer(states), csv.writer(events), start_ns
        self._states.writerow(STATE_COLUMNS)
        self._events.writerow(EVENT_COLUMNS)

    def __call__(self, state: EyeState, events: tuple[Event, ...]) -> None:
        gaze = state.gaze
        row: list[object] = [state.sequence, self._seconds(state.t_ns)]
        row += ["", ""] if gaze is None else [f"{gaze.azimuth_deg:.4f}", f"{gaze.elevation_deg:.4f}"]
        for one in (state.right, state.left):
            row += [one.phase.value, *(_number(value) for value in (one.diameter_mm, one.measured_mm))]
            row += [_number(one.confidence), _number(one.openness)]
        self._states.writerow(row)
        for event in events:
            fields = msgspec.structs.asdict(event)
            eye = fields.get("eye")
            duration_ns = fields.get("duration_ns")
            self._events.writerow(
                [
                    self._seconds(event.t_ns),
                    type(event).__name__,
                    "" if eye is None else Eye(eye).name.lower(),
                    "" if duration_ns is None else f"{duration_ns * 1e-6:.1f}",
                ]
            )

    def _seconds(self, t_ns: int) -> str:
        return f"{(t_ns - self._start_ns) / NS_PER_S:.6f}"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4f}"


@contextlib.contextmanager
def _tables(folder: Path | None, start_ns: int) -> Iterator[Callable[[EyeState, tuple[Event, ...]], None]]:
    """A writer of states.csv and events.csv, or of nothing without a folder."""
    if folder is None:
        yield lambda state, events: None
        return
    with contextlib.ExitStack() as files:
        states, events = (
            files.enter_context((folder / name).open("w", newline="", encoding="utf-8"))
            for name in ("states.csv", "events.csv")
        )
        yield _Writer(states, events, start_ns)
