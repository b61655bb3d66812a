"""The bridge process: opens a source, publishes its states and events, keeps them, and does what it is asked to."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import structlog

from entoptic.services.bridge.desk import BridgeDesk
from entoptic.services.bridge.pupil_calibration import PupilCalibration
from entoptic.services.bridge.scene_light import SceneLight
from entoptic.services.bridge.tables import Tables
from entoptic.services.control import Control
from entoptic.services.eye_data import ROOM_CD_M2
from entoptic.services.live.requests import BridgeRequest
from entoptic.services.process import Stop
from entoptic.tracker_bridge import bridge
from entoptic.tracker_bridge.access import ClientKeys, ServerKeys
from entoptic.tracker_bridge.chain import Chain, Lane
from entoptic.tracker_bridge.events import ClockEstimated, Event, Heartbeat, SaccadeOffset, SaccadeOnset
from entoptic.tracker_bridge.publisher import LINGER_MS, LIVE_LINGER_MS, Publisher
from entoptic.tracker_bridge.pupil_map import PupilMap
from entoptic.tracker_bridge.samples import NS_PER_S, EyeState, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Item, Source, SourceError, SourceInfo
from entoptic.tracker_bridge.sources.played import Played
from entoptic.tracker_bridge.sources.pupil_recorder import PupilRecorder
from entoptic.tracker_bridge.sources.simulated_endless import EndlessEyes

LIGHT_WITHIN_MS = 500
"""So long a bridge that is started anew waits for the worker's next frame."""
QUIET = (ClockEstimated, Heartbeat, SaccadeOnset, SaccadeOffset)
"""Events that come too often for a log."""


@dataclasses.dataclass(frozen=True)
class LiveBridgeSettings:
    """What a bridge that is a part of a live session has beside."""

    screens_address: str | None = None
    """Where it asks a display for the screens of a pupil calibration."""
    answers_address: str | None = None
    """Where the display answers."""
    sees_address: str | None = None
    """A worker's frames: their light falls into simulated eyes."""
    reader_keys: ClientKeys | None = None
    """For that worker, if it has keys."""
    goes_on: bool = False
    """Another bridge was there before this one."""


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
    pupil_map_file: Path | None = None
    """Where `pupil_map` lies."""
    live: LiveBridgeSettings | None = None
    """What a part of a live session has beside."""


def run(source: Source, settings: BridgeSettings, stop: Stop, log: structlog.typing.FilteringBoundLogger) -> None:
    """Publishes the source to its end, or until asked to stop.

    Raises PortInUseError, OpenAddressError, or SourceError where a live source is to wait for its reader, or a
    recording or a table cannot be written.
    """
    if source.info.live and not settings.real_time:
        raise SourceError(f"{source.info.name} measures at its own pace and waits for no reader: leave --pace out")
    live, session = source.info.live, settings.live
    if session is not None and session.sees_address is not None and not isinstance(source, EndlessEyes):
        raise SourceError(f"{source.info.name} has pupils that no light drives: leave --sees out")
    publisher = Publisher(
        settings.states_address,
        settings.events_address,
        replay_address=settings.replay_address,
        keys=settings.keys,
    )
    with contextlib.ExitStack() as opened:
        opened.callback(publisher.close, LIVE_LINGER_MS if live else LINGER_MS)
        chain = Chain(live=live, lane=settings.lane, pupil_map=settings.pupil_map)
        desk = BridgeDesk(
            source, chain, publisher, log, in_session=session is not None, pupil_map=settings.pupil_map_file
        )
        opened.callback(desk.close)
        control: Control[BridgeRequest] = Control(
            settings.control_address, BridgeRequest, desk.answer, settings.keys, publisher.context
        )
        opened.callback(control.close)
        places = {} if session is None else _open_session(source, desk, session, settings.keys, publisher)
        on_record = opened.enter_context(_tables(settings.tables))
        states_at, events_at = publisher.addresses
        log.info(
            "ready", source=source.info.name, states=states_at, events=events_at, control=control.address, **places
        )
        for remark in source.info.notes:
            log.info("source", note=remark)
        if settings.wait_for_reader:
            publisher.wait_for_reader(stop)
        on_item = opened.enter_context(_recording(settings.recording, source.info, log))

        def take_in(item: Item) -> None:
            on_item(item)
            desk.item(item)

        def note(record: EyeState | Event) -> None:
            on_record(record)
            desk.record(record)
            if live and not isinstance(record, (EyeState, *QUIET)):
                log.info(type(record).__name__, **msgspec.to_builtins(record))

        count = bridge.run(
            source,
            chain,
            publisher,
            real_time=settings.real_time,
            seconds=settings.seconds,
            stopped=stop,
            on_item=take_in,
            on_record=note,
            between=control.attend,
        )
        if not (settings.real_time or live):
            publisher.wait_until_left(stop)
        log.info("ended", states=count, stalls=publisher.stalls, late_samples=chain.late_count)


def _open_session(
    source: Source, desk: BridgeDesk, session: LiveBridgeSettings, keys: ServerKeys | None, publisher: Publisher
) -> dict[str, object]:
    """Opens what a live session has beside; what is to be logged of it."""
    places: dict[str, object] = {}
    if isinstance(source, EndlessEyes | Played):
        places["begun_ns"] = source.info.t_start_ns
    eyes = source if isinstance(source, EndlessEyes) else None
    if session.screens_address is not None and session.answers_address is not None:
        desk.calibration = PupilCalibration(
            session.screens_address,
            session.answers_address,
            source.info.name,
            keys=keys,
            context=publisher.context,
            eyes=eyes,
            scene_cd_m2=ROOM_CD_M2,
        )
        places["screens"], places["answers"] = desk.calibration.addresses
    if session.sees_address is not None:
        desk.light = SceneLight(session.sees_address, session.reader_keys, publisher.context)
        # A pupil that starts in another light than it had would wander for seconds.
        light = desk.light.newest(LIGHT_WITHIN_MS if session.goes_on else 0)
        if light is not None:
            desk.shine(light)
    return places


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


@contextlib.contextmanager
def _tables(folder: Path | None) -> Iterator[Callable[[EyeState | Event], None]]:
    """A writer of states.csv and events.csv, or of nothing without a folder."""
    if folder is None:
        yield lambda record: None
        return
    with _named(folder):
        folder.mkdir(parents=True, exist_ok=True)
        tables = Tables(folder)

    def add(record: EyeState | Event) -> None:
        with _named(folder):
            tables.add(record)

    with contextlib.closing(tables):
        yield add


@contextlib.contextmanager
def _named(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise SourceError(
            f"tables in {folder} cannot be written: {error.strerror}; make room, or choose another --tables"
        ) from None
