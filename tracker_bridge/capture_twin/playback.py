"""Where the eyes' data come from, and when: recordings, tables and simulated eyes, as messages with a time each."""

from __future__ import annotations

import dataclasses
import itertools
import queue
import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

import msgpack  # type: ignore[import-untyped]  # ships no types
import msgspec

from entoptic.tracker_bridge.capture_twin.published import Publisher, recorded_gaze, recorded_pupil, retimed
from entoptic.tracker_bridge.samples import NS_PER_S
from entoptic.tracker_bridge.sources import SIMULATED, open_source
from entoptic.tracker_bridge.sources.loaded import Sample
from entoptic.tracker_bridge.sources.pupil_core import recording
from entoptic.tracker_bridge.sources.pupil_core.form import Map
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings

_CHUNK_S: Final = 60.0
"""Simulated eyes are drawn by the minute, each with a seed of its own. Engineering choice."""

_AHEAD: Final = 400
"""Moments prepared ahead of their time: 2 s at 200 Hz, more than drawing a minute takes. Engineering choice."""


class Moment(NamedTuple):
    """What was measured at one time."""

    at_s: float
    """Since the start of the playback; the messages' own timestamps are on the same clock, and may go backwards."""
    pupils: tuple[Map, ...] = ()
    gazes: tuple[Map, ...] = ()


@dataclasses.dataclass(frozen=True)
class Playback:
    """A source of moments in the order of their time."""

    name: str
    notes: tuple[str, ...]
    moments: Iterator[Moment]


def open_playback(
    spec: str, *, simulated: SimulatedSettings, table_map: Path | None = None, loop: bool = False
) -> Playback:
    """What `spec` names, as `open_source` knows it; a Pupil recording's own datums where it is one.

    Simulated eyes go on for ever. A recording ends, or with `loop` begins again, its times going on.
    Raises SourceError.
    """
    if spec == SIMULATED and table_map is None:
        return Playback("Simulated eyes", (), _simulated(simulated))
    source = open_source(spec, table_map=table_map)
    path = Path(spec)
    files = [path / recording.PUPIL_FILE, path / recording.GAZE_FILE] if path.is_dir() else [path]
    if all(file.suffix == ".pldata" for file in files) and any(file.is_file() for file in files):
        moments = _recorded([file for file in files if file.is_file()])
    else:
        samples: Iterable[Sample] = (s for s in source.samples() if isinstance(s, Sample))
        moments = _measured(samples, source.info.t_start_ns)
    return Playback(source.info.name, source.info.notes, _looped(moments) if loop else moments)


def _simulated(settings: SimulatedSettings) -> Iterator[Moment]:
    for number in itertools.count():
        eyes = SimulatedEyes(msgspec.structs.replace(settings, seconds=_CHUNK_S, seed=(settings.seed + number) % 2**32))
        start_ns = -round(number * _CHUNK_S * NS_PER_S)
        yield from _measured(eyes.samples(), start_ns)


def _measured(samples: Iterable[Sample], start_ns: int) -> Iterator[Moment]:
    """The moments of samples in the order of their time."""
    publisher = Publisher()
    for t_ns, of_one_time in itertools.groupby(samples, key=lambda sample: sample.t_ns):
        messages = publisher.of_one_time(of_one_time)
        start_s = start_ns / NS_PER_S
        yield _moment(t_ns / NS_PER_S - start_s, messages, start_s)


def _moment(at_s: float, messages: Iterable[Map], start_s: float) -> Moment:
    shifted = [retimed(message, lambda time_s: time_s - start_s) for message in messages]
    pupils = tuple(message for message in shifted if message["topic"].startswith("pupil."))
    return Moment(at_s, pupils, tuple(message for message in shifted if not message["topic"].startswith("pupil.")))


class _Timed(msgspec.Struct, frozen=True):
    timestamp: float


_time_of = msgspec.msgpack.Decoder(_Timed)


def _recorded(files: Iterable[Path]) -> Iterator[Moment]:
    """The moments of a Pupil recording, each file in its own order, as it was published: times may go back."""
    rows: list[tuple[float, float, str, bytes]] = []
    for file in files:
        newest_s = float("-inf")
        with file.open("rb") as stream:
            for topic, payload in msgpack.Unpacker(stream, max_buffer_size=2**31 - 1):
                time_s = _time_of.decode(payload).timestamp
                newest_s = max(newest_s, time_s)
                rows.append((newest_s, time_s, topic, payload))
    rows.sort(key=lambda row: row[0])
    start_s = min(time_s for _, time_s, _, _ in rows)
    has_flat = any(topic.endswith(".2d") for _, _, topic, _ in rows)
    for newest_s, _, topic, payload in rows:
        yield _moment(newest_s - start_s, _messages(topic, payload, has_flat), start_s)


def _messages(topic: str, payload: bytes, has_flat: bool) -> Iterator[Map]:
    if topic.startswith("pupil."):
        flat, solid = recorded_pupil(payload)
        if solid is None or not has_flat:
            yield flat
        if solid is not None:
            yield solid
    elif topic.split(".")[0] == "gaze":
        yield recorded_gaze(payload)


def _looped(once: Iterator[Moment]) -> Iterator[Moment]:
    """Again and again, a mean interval between the last and the first."""
    moments = []
    for moment in once:
        moments.append(moment)
        yield moment
    period_s = moments[-1].at_s * (1.0 + 1.0 / max(len(moments) - 1, 1)) or 1.0
    for turn in itertools.count(1):
        start_s = -turn * period_s
        for at_s, pupils, gazes in moments:
            yield _moment(at_s - start_s, (*pupils, *gazes), start_s)


class Ahead:
    """Moments prepared in a thread of their own, so that drawing eyes never holds up what is sent."""

    def __init__(self, moments: Iterator[Moment]) -> None:
        self._queue: queue.Queue[Moment | None] = queue.Queue(_AHEAD)
        self._closed = threading.Event()
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._prepare, args=(moments,), name="playback", daemon=True)
        self._thread.start()
        self.ended = False
        """Nothing comes any more."""

    def take(self) -> Moment | None:
        """The next moment; None where there is none yet, or no more. Raises what the preparation raised."""
        if self.ended:
            return None
        try:
            moment = self._queue.get_nowait()
        except queue.Empty:
            return None
        if moment is None:
            self.ended = True
            if self._error is not None:
                raise self._error
        return moment

    def wait(self) -> Moment | None:
        """The next moment, as soon as there is one; None where no more come. Raises what the preparation raised."""
        while (moment := self.take()) is None and not self.ended:
            time.sleep(0.005)
        return moment

    def close(self) -> None:
        """Ends the thread."""
        self._closed.set()
        self._thread.join()

    def _prepare(self, moments: Iterator[Moment]) -> None:
        try:
            for moment in moments:
                if not self._put(moment):
                    return
        except Exception as error:
            self._error = error
        self._put(None)

    def _put(self, moment: Moment | None) -> bool:
        while not self._closed.is_set():
            try:
                self._queue.put(moment, timeout=0.1)
            except queue.Full:
                continue
            return True
        return False
