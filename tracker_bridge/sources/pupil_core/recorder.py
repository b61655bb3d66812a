"""Writes a recording of Pupil Core while it happens, so that a crash costs next to nothing.

What is lost, and when:
- The program is killed (`kill -9`) or crashes: the samples of the newest time, which wait for others of the same time.
  Every datum goes to the operating system whole, in one write, as soon as it is made.
- The machine loses its power: the last second at most. The disk is told to keep what it got every half second, by a
  thread of its own, so that a slow disk never holds up the samples.
- In both cases the `*_timestamps.npy` files are missing and the duration in info.player.json is 0. `open_recording`
  needs neither; `write_recording` makes a whole recording, as Pupil Player wants it, of what it reads.
- The disk is full, or an entry is refused: RecordingError, and what was written until then stays, whole.

What comes back of samples is the same but for this:
- Times are seconds in 64-bit floats: exact to the nanosecond up to 11 days of clock, to 1 µs for 100 years and more.
- Directions come back within 1e-9°; they must lie less than 90° from straight ahead, as a scene camera's do.
- A sample without px gets px of its mm, at the scale of a simulated camera.
- Pupil Core knows no openness; it is written under a key of its own, which other programs skip.
"""

from __future__ import annotations

import array
import contextlib
import importlib.metadata
import json
import os
import tempfile
import threading
import time
import uuid
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import msgpack  # type: ignore[import-untyped]  # ships no types
import numpy as np

from entoptic.atomic_file import write_bytes
from entoptic.tracker_bridge.samples import NS_PER_S
from entoptic.tracker_bridge.source import RecordedSource, SourceError
from entoptic.tracker_bridge.sources.loaded import Sample, sort_key
from entoptic.tracker_bridge.sources.pupil_core.form import Map, data_of, is_writable

SYNC_INTERVAL_S: Final = 0.5
"""Half of what a power failure may cost; the other half is for the disk to finish. Engineering choice."""

INFO_FILE: Final = "info.player.json"


class RecordingError(SourceError):
    """A recording cannot be written: the message names the file and the remedy."""


class PupilRecorder:
    """A recording that grows as samples come, in any order. Not for several threads at once.

    `start_synced_s` is the time of the samples' clock now (unless given, that of this machine's monotonic clock),
    `start_system_s` that of the day; `name` is the folder's unless given. The parent folders are made where they are
    missing. Raises RecordingError where the folder exists or cannot be made, and later where something cannot be
    written; then the recording is closed.
    """

    def __init__(
        self,
        folder: Path,
        *,
        start_synced_s: float | None = None,
        start_system_s: float | None = None,
        name: str | None = None,
    ) -> None:
        self.folder = folder
        self.unwritable = 0
        """Directions left out because they lie 90° or more to a side, which no scene camera sees."""
        self._waiting: dict[tuple[int, bool, int], Sample] = {}
        self._streams: dict[str, _Stream] = {}
        self._failed_sync: OSError | None = None
        self._closed = threading.Event()
        start_s = time.monotonic() if start_synced_s is None else start_synced_s
        self._info = _info(name or folder.name, start_s, time.time() if start_system_s is None else start_system_s)
        try:
            folder.mkdir(parents=True)
            write_bytes(folder / INFO_FILE, json.dumps(self._info, indent=4).encode(), durable=True)
        except FileExistsError:
            raise RecordingError(f"{folder} exists already: choose another name, or remove it first") from None
        except OSError as error:
            raise RecordingError(f"{folder} cannot be written: {error.strerror}. Choose another place") from None
        self._syncing = threading.Thread(target=self._sync, name="recorder-sync", daemon=True)
        self._syncing.start()

    def add(self, sample: Sample) -> None:
        """Takes a sample in. It is written when one of another time comes, since a datum may hold several."""
        if not is_writable(sample):
            self.unwritable += 1
            return
        key = sort_key(sample)
        if self._waiting and (key in self._waiting or key[0] != next(iter(self._waiting))[0]):
            self._write_waiting()
        self._waiting[key] = sample

    def write(self, stream: str, datum: Map) -> None:
        """Writes a datum of Pupil Core, which must have `topic` and `timestamp`, into `stream`.pldata at once."""
        if self._closed.is_set():
            return
        try:
            if self._failed_sync is not None:
                raise self._failed_sync
            if stream not in self._streams:
                self._streams[stream] = _Stream(self.folder / f"{stream}.pldata")
            self._streams[stream].write(datum)
        except OSError as error:
            # What it held so far may still be finished, since only the growing file met the obstacle.
            with contextlib.suppress(RecordingError):
                self._finish()
            raise RecordingError(
                f"{self.folder / stream}.pldata cannot be written any more: {error.strerror}. "
                "What was recorded until now is kept; make room and start a new recording"
            ) from None

    def close(self) -> None:
        """Writes what waits, the timestamps and the duration. Nothing is written after it."""
        self._write_waiting()
        self._finish()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _write_waiting(self) -> None:
        waiting, self._waiting = self._waiting, {}
        for stream, data in zip(("pupil", "gaze"), data_of(waiting.values()), strict=True):
            for datum in data:
                self.write(stream, datum)

    def _finish(self) -> None:
        if self._closed.is_set():
            return
        self._closed.set()
        self._syncing.join()
        try:
            stamps = [np.frombuffer(stream.timestamps) for stream in self._streams.values() if stream.timestamps]
            if stamps:
                end_s = max(float(each.max()) for each in stamps)
                self._info["duration_s"] = max(end_s - float(self._info["start_time_synced_s"]), 0.0)
            with contextlib.ExitStack() as each:
                # One that cannot be finished must not keep the others open.
                for stream in self._streams.values():
                    each.callback(stream.close)
            write_bytes(self.folder / INFO_FILE, json.dumps(self._info, indent=4).encode(), durable=True)
        except OSError as error:
            raise RecordingError(
                f"{self.folder} cannot be finished: {error.strerror}. Its .pldata files are whole and can be read"
            ) from None

    def _sync(self) -> None:
        while not self._closed.wait(SYNC_INTERVAL_S):
            for stream in tuple(self._streams.values()):
                try:
                    stream.sync()
                except OSError as error:
                    self._failed_sync = error
                    return


class _Stream:
    """One pldata file, and the timestamps of what is in it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        binary: int = getattr(os, "O_BINARY", 0)  # Windows alone has it, and needs it
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | binary, 0o644)
        self._end = 0
        self.timestamps = array.array("d")

    def write(self, datum: Map) -> None:
        message = memoryview(msgpack.packb([datum["topic"], msgpack.packb(datum)]))
        done = 0
        try:
            while done < len(message):
                done += os.write(self._file, message[done:])
        except OSError:
            # A full disk takes half a message first.
            os.ftruncate(self._file, self._end)
            raise
        self._end += done
        self.timestamps.append(datum["timestamp"])

    def sync(self) -> None:
        os.fsync(self._file)

    def close(self) -> None:
        try:
            self.sync()
            timestamps = self._path.with_name(f"{self._path.stem}_timestamps.npy")
            np.save(timestamps, np.frombuffer(self.timestamps))
        finally:
            os.close(self._file)


def _info(name: str, start_synced_s: float, start_system_s: float) -> Map:
    """The contents of info.player.json at the start."""
    return {
        "duration_s": 0.0,
        "meta_version": "2.3",
        "min_player_version": "2.0",
        "recording_name": name,
        "recording_software_name": "Entoptic",
        "recording_software_version": importlib.metadata.version("entoptic"),
        "recording_uuid": str(uuid.uuid5(uuid.NAMESPACE_OID, f"{name} {start_synced_s} {start_system_s}")),
        "start_time_synced_s": start_synced_s,
        "start_time_system_s": start_system_s,
        "system_info": "",
    }


def write_recording(source: RecordedSource, folder: Path) -> None:
    """Writes all samples of a source, which must end, as a new recording folder of Pupil Core.

    In it are pupil.pldata, gaze.pldata, the timestamps of both and info.player.json; see form.py for what
    becomes of which sample. The folder appears whole or not at all.

    Raises SourceError where the folder exists, there are no samples, or a direction lies 90° or more to a side.
    """
    ordered = sorted(source.samples(), key=sort_key)
    if not ordered:
        raise SourceError(f"{folder}: there are no samples to write")
    if folder.exists():
        raise SourceError(f"{folder} exists already: choose another name, or remove it first")
    for sample in ordered:
        if not is_writable(sample):
            raise SourceError(
                f"a direction cannot be written: a scene camera sees less than 90° to each side; {sample}"
            )
    # Nobody knows what time of day it was: both clocks start together.
    start_s = ordered[0].t_ns / NS_PER_S
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as scratch:
            whole = Path(scratch) / folder.name
            with PupilRecorder(whole, start_synced_s=start_s, start_system_s=start_s) as recorder:
                for sample in ordered:
                    recorder.add(sample)
            whole.rename(folder)
    except OSError as error:
        raise SourceError(f"{folder} cannot be written: {error.strerror}. Choose another place") from None
