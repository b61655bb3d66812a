"""Every decoder of foreign bytes: what it may raise, and a few good inputs to spoil."""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import msgpack

from entoptic.services.console.requests import RequestError, decode_request
from entoptic.services.ipc import messages
from entoptic.services.settings import SettingsError
from entoptic.services.settings import load as load_settings
from entoptic.tracker_bridge import wire
from entoptic.tracker_bridge.clock import ArrivalClock
from entoptic.tracker_bridge.events import BlinkOffset, StreamStarted
from entoptic.tracker_bridge.pupil_map import PupilMapError
from entoptic.tracker_bridge.pupil_map import read as read_pupil_map
from entoptic.tracker_bridge.samples import Direction, Eye, EyeState, GazeSample, OneEyeState, Phase, PupilSample
from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources import open_source
from entoptic.tracker_bridge.sources.hid.descriptor import HidDescriptorError
from entoptic.tracker_bridge.sources.hid.eye_tracker import EyeTrackerReports
from entoptic.tracker_bridge.sources.pupil_core.bus import PupilBus
from entoptic.tracker_bridge.sources.pupil_core.datum import (
    base_pupils,
    decode_gaze,
    decode_pupil,
    gaze_samples,
    pupil_sample,
)
from entoptic.tracker_bridge.sources.pupil_core.recorder import write_recording
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings
from entoptic.tracker_bridge.sources.table.map import read_table_map
from entoptic.tracker_bridge.sources.usb.capture import open_usb_file
from entoptic.tracker_bridge.sources.usb.stream import Connection, PacketStream
from entoptic.tracker_bridge.usb_twin.descriptors import PACKET_BYTES
from entoptic.tracker_bridge.usb_twin.report import DESCRIPTOR, tracking_report

PAGE_REQUESTS = (
    b'{"id": 1, "request": {"do": "change settings", "changes": {"observer.age_years": 61}}}',
    b'{"id": 2, "request": {"do": "start session", "config": {"eyes": {"source": "capture"}}}}',
    b'{"id": 3, "request": {"do": "watch", "perceived": true, "displayed": false}}',
)


class Decoder(NamedTuple):
    """One decoder."""

    read: Callable[[bytes], object]
    may_raise: tuple[type[Exception], ...]
    good: Sequence[bytes]


def _as_file(name: str, read: Callable[[Path], object], data: bytes) -> object:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(data)
        return read(path)


def _file(name: str, read: Callable[[Path], object]) -> Callable[[bytes], object]:
    return functools.partial(_as_file, name, read)


def _samples(path: Path) -> object:
    return list(open_source(str(path)).samples())


def _pupil(data: bytes) -> object:
    return pupil_sample(decode_pupil(data))


def _gaze(data: bytes) -> object:
    datum = decode_gaze(data)
    return gaze_samples(datum, base_pupils(datum))


def _bus(data: bytes) -> object:
    """The first byte is the length of the topic."""
    length = 1 + data[0] if data else 0
    return PupilBus().read([data[1:length], data[length:]], 0)


def _packets(data: bytes) -> object:
    """Packets of the device that plays recordings."""
    stream = PacketStream(Connection("fuzzed", DESCRIPTOR, PACKET_BYTES, {}), ArrivalClock())
    return [stream.add(data[at : at + PACKET_BYTES], at) for at in range(0, len(data), PACKET_BYTES)]


def _picture(data: bytes) -> object:
    return messages.decode(data, messages.Picture).image


def _shown(data: bytes) -> object:
    return messages.decode(data, messages.Shown)


def _framed(topic: bytes, payload: bytes) -> bytes:
    return bytes([len(topic)]) + topic + payload


@functools.cache
def _recording() -> tuple[bytes, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording"
        write_recording(SimulatedEyes(SimulatedSettings(seconds=0.1, rate_hz=60.0)), path)
        return (path / "pupil.pldata").read_bytes(), (path / "gaze.pldata").read_bytes()


def _datums(file: bytes) -> list[tuple[bytes, bytes]]:
    unpacker = msgpack.Unpacker(strict_map_key=False)
    unpacker.feed(file)
    return [(topic.encode(), datum) for topic, datum in unpacker]


def decoders() -> dict[str, Decoder]:
    """All of them, by name."""
    pupil_file, gaze_file = _recording()
    (pupil_topic, pupil), (gaze_topic, gaze) = _datums(pupil_file)[0], _datums(gaze_file)[0]
    one = OneEyeState(Phase.TRACKING, 3.0, 3.1, 1.0, 0.9, Direction(1.0, 2.0, 3), 3)
    state = wire.encode_state(EyeState(4, 5, one, one, None, 6))
    events = [
        wire.encode_event(event, stream=1, sequence=2, replay_port=3)
        for event in (BlinkOffset(1, Eye.LEFT, 2), StreamStarted(1, None, "eyes"))
    ]
    table = b"t_s,left_mm,right_mm\n0.0,3.0,3.1\n0.01,3.0,3.2\n"
    table_map = b'delimiter = ","\n[time]\ncolumn = "t_s"\nunit = "s"\n'
    picture = messages.Picture(1, 2, 1, 1, "srgb", "uint8", b"abc")
    shown = messages.Shown(1, 0.1, 2, 3, 4, (), (), 0.5, {}, None, 24.0, 24.0, 0, messages.LatencyMs(1, 2, 3), None)
    source, wrong = (SourceError,), (wire.WireError,)
    report = tracking_report([PupilSample(0, Eye.LEFT, 4.0, 1.0), GazeSample(0, None, 1.0, 2.0, 1.0)], 5, 1)
    return {
        "pupil datum": Decoder(_pupil, source, [pupil]),
        "gaze datum": Decoder(_gaze, source, [gaze]),
        "message on Capture's bus": Decoder(_bus, (), [_framed(pupil_topic, pupil), _framed(gaze_topic, gaze)]),
        "state": Decoder(wire.decode_state, wrong, [state]),
        "event": Decoder(wire.decode_event, wrong, events),
        "replay request": Decoder(wire.decode_request, wrong, [wire.encode_request(5)]),
        "replay answer": Decoder(wire.decode_answer, wrong, [wire.encode_answer(wire.BadRequest("why"))]),
        "recording": Decoder(_file("pupil.pldata", _samples), source, [pupil_file, gaze_file]),
        "table": Decoder(_file("table.csv", _samples), source, [table]),
        "column map": Decoder(_file("map.toml", read_table_map), source, [table_map]),
        "pupil map": Decoder(_file("pupil.toml", read_pupil_map), (PupilMapError,), [b'protocol = "robust"\n']),
        "report descriptor": Decoder(EyeTrackerReports, (HidDescriptorError,), [DESCRIPTOR]),
        "USB packets": Decoder(_packets, (), [report * 3]),
        "USB capture": Decoder(_file("capture", open_usb_file), source, [b""]),
        "worker's picture": Decoder(_picture, (messages.MessageError,), [messages.encode(picture)]),
        "worker's figures": Decoder(_shown, (messages.MessageError,), [messages.encode(shown)]),
        "page's request": Decoder(decode_request, (RequestError,), PAGE_REQUESTS),
        "settings": Decoder(_file("settings.toml", load_settings), (SettingsError,), [b"[observer]\nage_years = 30\n"]),
    }
