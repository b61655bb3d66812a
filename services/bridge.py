"""The bridge process: opens a source, publishes its states and events, and keeps them as tables."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import functools
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import structlog

from services.control import Control
from services.live.requests import TrackerRequest
from services.process import Stop
from services.tracker_tasks import told
from tracker_bridge import bridge
from tracker_bridge.access import ServerKeys
from tracker_bridge.chain import Chain, Lane
from tracker_bridge.events import ClockEstimated, Event, Heartbeat, SaccadeOffset, SaccadeOnset, StreamStarted
from tracker_bridge.publisher import Publisher
from tracker_bridge.pupil_map import PupilMap
from tracker_bridge.samples import NS_PER_S, Eye, EyeState, GazeSample, PupilSample
from tracker_bridge.source import Item, Source, SourceError, SourceInfo
from tracker_bridge.sources.pupil_recorder import PupilRecorder

STATE_COLUMNS = (
    "sequence",
    "t_s",
    "gaze_azimuth_deg",
    "gaze_elevation_deg",
    *(
        f"{eye}_{quantity}"
        for eye in ("right", "left")
        for quantity in ("phase", "diameter_mm", "measured_mm", "confidence", "openness", "borrowed")
    ),
)
EVENT_COLUMNS = ("t_s", "event", "eye", "duration_ms", "amplitude_deg", "peak_velocity_deg_s", "detail")
QUIET = (ClockEstimated, Heartbeat, SaccadeOnset, SaccadeOffset)
"""Events that come too often for a log."""


@dataclasses.dataclass(frozen=True)
class BridgeSettings:
    """How a source is published."""

    states_address: str
    events_address: str
    replay_address: str | None
    """A free port of the events' host unless given."""
    control_address: str
    keys: ServerKeys | None
    """Needed to be heard beyond this machine."""
    lane: Lane
    pupil_map: PupilMap | None
    real_time: bool
    """A recording is paced by its recorded time; otherwise it goes as fast as the reader takes it."""
    wait_for_reader: bool
    """Starts when somebody has subscribed to both sockets."""
    seconds: float | None
    tables: Path | None
    """A folder for states.csv and events.csv; made where it is missing."""
    recording: Path | None
    """A new folder for a recording of Pupil's form."""


def run(source: Source, settings: BridgeSettings, stop: Stop, log: structlog.typing.FilteringBoundLogger) -> None:
    """Publishes the source to its end, or until asked to stop.

    Raises PortInUseError, OpenAddressError, or SourceError where a live source is to wait for its reader, or a
    recording or a table cannot be written.
    """
    if source.info.live and not settings.real_time:
        raise SourceError(f"{source.info.name} measures at its own pace and waits for no reader: leave --pace out")
    publisher = Publisher(
        settings.states_address,
        settings.events_address,
        replay_address=settings.replay_address,
        keys=settings.keys,
    )
    live = source.info.live
    with contextlib.ExitStack() as opened:
        opened.callback(publisher.close)
        control: Control[TrackerRequest] = Control(
            settings.control_address,
            TrackerRequest,
            functools.partial(told, source),
            settings.keys,
            publisher.context,
        )
        opened.callback(control.close)
        on_record = opened.enter_context(_tables(settings.tables))
        states_at, events_at = publisher.addresses
        log.info("ready", source=source.info.name, states=states_at, events=events_at, control=control.address)
        for remark in source.info.notes:
            log.info("source", note=remark)
        chain = Chain(live=live, lane=settings.lane, pupil_map=settings.pupil_map)
        if settings.wait_for_reader:
            publisher.wait_for_reader(stop)
        on_item = opened.enter_context(_recording(settings.recording, source.info, log))

        def note(record: EyeState | Event) -> None:
            on_record(record)
            if live and not isinstance(record, (EyeState, *QUIET)):
                log.info(type(record).__name__, **msgspec.to_builtins(record))

        count = bridge.run(
            source,
            chain,
            publisher,
            real_time=settings.real_time,
            seconds=settings.seconds,
            stopped=stop,
            on_item=on_item,
            on_record=note,
            between=control.attend,
        )
        if not (settings.real_time or live):
            publisher.wait_until_left(stop)
        log.info("ended", states=count, stalls=publisher.stalls, late_samples=chain.late_count)


@contextlib.contextmanager
def _recording(
    folder: Path | None, info: SourceInfo, log: structlog.typing.FilteringBoundLogger
) -> Iterator[Callable[[Item], None]]:
    """Takes items into a recording, or nowhere without a folder."""
    if folder is None:
        yield lambda item: None
        return
    with PupilRecorder(folder, start_synced_s=None if info.live else info.t_start_ns / NS_PER_S) as recorder:

        def add(item: Item) -> None:
            if isinstance(item, PupilSample | GazeSample):
                recorder.add(item)

        yield add
        if recorder.unwritable:
            log.warning("recording", directions_beyond_90_deg_left_out=recorder.unwritable)


class _Writer:
    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._start_ns = 0
        self._files = contextlib.ExitStack()
        with self._named():
            folder.mkdir(parents=True, exist_ok=True)
            self._states, self._events = (
                csv.writer(self._files.enter_context((folder / name).open("w", newline="", encoding="utf-8")))
                for name in ("states.csv", "events.csv")
            )
            self._states.writerow(STATE_COLUMNS)
            self._events.writerow(EVENT_COLUMNS)

    def __call__(self, record: EyeState | Event) -> None:
        if isinstance(record, StreamStarted):
            self._start_ns = record.t_ns
        with self._named():
            if isinstance(record, EyeState):
                self._states.writerow(self._state_row(record))
            elif not isinstance(record, Heartbeat):
                self._events.writerow(self._event_row(record))

    def close(self) -> None:
        with self._named():
            self._files.close()

    @contextlib.contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise SourceError(
                f"tables in {self._folder} cannot be written: {error.strerror}; make room, or choose another --tables"
            ) from None

    def _state_row(self, state: EyeState) -> list[object]:
        gaze = state.gaze
        row: list[object] = [state.sequence, self._seconds(state.t_ns)]
        row += ["", ""] if gaze is None else [f"{gaze.azimuth_deg:.4f}", f"{gaze.elevation_deg:.4f}"]
        for one in (state.right, state.left):
            row += [one.phase.value, *(_number(value) for value in (one.diameter_mm, one.measured_mm))]
            row += [_number(one.confidence), _number(one.openness), int(one.borrowed)]
        return row

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


@contextlib.contextmanager
def _tables(folder: Path | None) -> Iterator[Callable[[EyeState | Event], None]]:
    """A writer of states.csv and events.csv, or of nothing without a folder."""
    if folder is None:
        yield lambda record: None
        return
    with contextlib.closing(_Writer(folder)) as writer:
        yield writer
