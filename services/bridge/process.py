"""The bridge process: opens a source, publishes its states and events, keeps them, and does what it is asked to."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import structlog

from entoptic.services import keys as key_files
from entoptic.services.bridge.handler import BridgeHandler
from entoptic.services.bridge.scene_light import SceneLight
from entoptic.services.calibration.display import SocketDisplay
from entoptic.services.calibration.pupil_calibration import PupilCalibration
from entoptic.services.calibration.run import Room
from entoptic.services.eye_data import ROOM_CD_M2, open_eyes, open_live_eyes
from entoptic.services.ipc.handler import RequestHandler
from entoptic.services.ipc.requests import BridgeRequest
from entoptic.services.process import Stop
from entoptic.services.process_config import BridgeConfig
from entoptic.tracker_bridge import bridge
from entoptic.tracker_bridge import pupil_map as pupil_maps
from entoptic.tracker_bridge.access import ServerKeys
from entoptic.tracker_bridge.chain import Chain
from entoptic.tracker_bridge.events import ClockEstimated, Event, Heartbeat, SaccadeOffset, SaccadeOnset
from entoptic.tracker_bridge.publisher import LINGER_MS, LIVE_LINGER_MS, Publisher
from entoptic.tracker_bridge.samples import NS_PER_S, EyeState, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Item, Source, SourceError, SourceInfo
from entoptic.tracker_bridge.sources.played import Played
from entoptic.tracker_bridge.sources.pupil_core.recorder import PupilRecorder
from entoptic.tracker_bridge.sources.simulated.live import LiveEyes

LIGHT_WITHIN_MS = 500
"""So long a bridge that is started again waits for the worker's next frame."""
QUIET = (ClockEstimated, Heartbeat, SaccadeOnset, SaccadeOffset)
"""Events that come too often for a log."""


def run(config: BridgeConfig, stop: Stop, log: structlog.typing.FilteringBoundLogger) -> None:
    """Publishes a source to its end, or until asked to stop.

    Raises SourceError, PupilMapError, PortInUseError or OpenAddressError; RecordingError where a recording cannot be
    written.
    """
    _refuse_odd(config)
    source = _open(config)
    live = source.info.live
    keys = None if config.keys is None else key_files.load_server(Path(config.keys))
    pupil_map = None if config.eyes.pupil_map is None else pupil_maps.read(Path(config.eyes.pupil_map))
    publisher = Publisher(config.states, config.events, replay_address=config.replay, keys=keys)
    with contextlib.ExitStack() as opened:
        opened.callback(publisher.close, LIVE_LINGER_MS if live else LINGER_MS)
        chain = Chain(live=live, latency_mode=config.eyes.latency_mode, pupil_map=pupil_map)
        handler = BridgeHandler(
            source,
            chain,
            publisher,
            log,
            in_session=config.live,
            pupil_map=None if config.eyes.pupil_map is None else Path(config.eyes.pupil_map),
        )
        opened.callback(handler.close)
        control: RequestHandler[BridgeRequest] = RequestHandler(
            config.control, BridgeRequest, handler.answer, keys, publisher.context
        )
        opened.callback(control.close)
        places = _open_session(source, handler, config, keys, publisher) if config.live else {}
        states_at, events_at = publisher.addresses
        log.info(
            "ready", source=source.info.name, states=states_at, events=events_at, control=control.address, **places
        )
        for remark in source.info.notes:
            log.info("source", note=remark)
        on_item = opened.enter_context(_recording(config.record, source.info, log))

        def take_in(item: Item) -> None:
            on_item(item)
            handler.item(item)

        def note(record: EyeState | Event) -> None:
            handler.record(record)
            if live and not isinstance(record, (EyeState, *QUIET)):
                log.info(type(record).__name__, **msgspec.to_builtins(record))

        count = bridge.run(
            source,
            chain,
            publisher,
            seconds=config.seconds,
            stopped=stop,
            on_item=take_in,
            on_record=note,
            between=control.serve,
        )
        log.info("ended", states=count, stalls=publisher.stalls, late_samples=chain.late_count)


def _refuse_odd(config: BridgeConfig) -> None:
    """What goes with other options alone."""
    for name in ("begun_ns", "screens", "answers", "sees"):
        if getattr(config, name) is not None and not config.live:
            raise SourceError(f"--{name.replace('_', '-')} is for a live session: add --live, or leave it out")
    if (config.screens is None) != (config.answers is None):
        raise SourceError("--screens and --answers are of use together alone: give both, or neither")
    if config.reader_keys is not None and config.sees is None:
        raise SourceError("--reader-keys are for the worker that --sees names: give that, or leave them out")


def _open(config: BridgeConfig) -> Source:
    if not config.live:
        return open_eyes(config.eyes, config.seconds, config.luminance, record_raw=config.record_raw)
    source = open_live_eyes(config.eyes, config.luminance, record_raw=config.record_raw, begun_ns=config.begun_ns)
    if config.sees is not None and not isinstance(source, LiveEyes):
        raise SourceError(f"{source.info.name} has pupils that no light drives: leave --sees out")
    return source


def _open_session(
    source: Source, handler: BridgeHandler, config: BridgeConfig, keys: ServerKeys | None, publisher: Publisher
) -> dict[str, object]:
    """Opens what a live session has beside; what is to be logged of it."""
    places: dict[str, object] = {}
    if isinstance(source, LiveEyes | Played):
        places["begun_ns"] = source.info.t_start_ns
    eyes = source if isinstance(source, LiveEyes) else None
    if config.screens is not None and config.answers is not None:
        # The context's authenticator lets in whom the publisher knows.
        display = SocketDisplay(
            config.screens, config.answers, "page in a browser", keys=keys, context=publisher.context
        )
        handler.calibration = PupilCalibration(Room(display, eyes), source.info.name, scene_cd_m2=ROOM_CD_M2)
        places["screens"], places["answers"] = display.commands_address, display.answers_address
    if config.sees is not None:
        reader_keys = None if config.reader_keys is None else key_files.load_client(Path(config.reader_keys))
        handler.light = SceneLight(config.sees, reader_keys, publisher.context)
        # A pupil that starts in another light than it had would wander for seconds.
        light = handler.light.newest(LIGHT_WITHIN_MS if config.begun_ns is not None else 0)
        if light is not None:
            handler.set_scene_light(light)
    return places


@contextlib.contextmanager
def _recording(
    folder: str | None, info: SourceInfo, log: structlog.typing.FilteringBoundLogger
) -> Iterator[Callable[[Item], None]]:
    """Takes items into a recording, or nowhere without a folder."""
    if folder is None:
        yield lambda item: None
        return
    with PupilRecorder(Path(folder), start_synced_s=None if info.live else info.t_start_ns / NS_PER_S) as recorder:

        def add(item: Item) -> None:
            if isinstance(item, PupilSample | GazeSample):
                recorder.add(item)

        yield add
        if recorder.unwritable:
            log.warning("recording", directions_beyond_90_deg_left_out=recorder.unwritable)
