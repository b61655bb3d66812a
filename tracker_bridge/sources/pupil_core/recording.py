"""Recordings of Pupil Capture and Pupil Service: folders, or single `*.pldata` files.

A pldata file is a row of msgpack messages `[topic, bytes]`, the bytes being one msgpack map. Both eyes are merged into
one file and not in order; a recorder that was killed leaves half a message at the end.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import msgpack  # type: ignore[import-untyped]  # ships no types

from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.loaded import LoadedSource
from entoptic.tracker_bridge.sources.pupil_core.datum import PupilDatum, base_pupils, decode_gaze, decode_pupil
from entoptic.tracker_bridge.sources.pupil_core.streams import Gaze, assemble

PUPIL_FILE = "pupil.pldata"
GAZE_FILE = "gaze.pldata"

_LARGEST_DATUM = 2**31 - 1
_LARGEST_TOPIC = 1000
"""Bytes. Longer ones are those of a damaged or foreign file, which must not make the reader claim memory for them."""


class _Message(NamedTuple):
    number: int
    topic: str
    payload: bytes


def open_recording(path: Path) -> LoadedSource:
    """The pupils and directions in a recording's folder, or in one `*.pldata` file alone.

    Needs pupil.pldata or gaze.pldata. Half a message at the end of a file is left out, with a note. Raises SourceError
    where a file is missing, empty, of another format, damaged before its end or without samples.
    """
    files = [path / PUPIL_FILE, path / GAZE_FILE] if path.is_dir() else [path]
    present = [file for file in files if file.is_file()]
    if not present:
        wanted = f"{PUPIL_FILE} or {GAZE_FILE}"
        raise SourceError(
            f"{path} holds no {wanted}: name a folder that Pupil Capture recorded"
            if path.is_dir()
            else f"{path} does not exist: name a folder that Pupil Capture recorded, or a .pldata file"
        )
    pupils: list[PupilDatum] = []
    gazes: list[Gaze] = []
    notes: list[str] = []
    for file in present:
        try:
            other_topics = _read_into(file, pupils, gazes, notes)
        except OSError as error:
            raise SourceError(f"{file} cannot be read: {error.strerror}. Check its permissions") from None
        if other_topics and not (pupils or gazes):
            raise SourceError(
                f"{file} holds no pupil or gaze data but {', '.join(sorted(other_topics))}: "
                f"choose {PUPIL_FILE} or {GAZE_FILE}"
            )
    return assemble(f"Pupil recording {path.resolve().name}", pupils, gazes, notes)


def _read_into(file: Path, pupils: list[PupilDatum], gazes: list[Gaze], notes: list[str]) -> set[str]:
    """Adds a file's datums to the lists; the topics that were neither."""
    others = set()
    for message in _messages(file, notes):
        try:
            if message.topic.startswith("pupil."):
                pupils.append(decode_pupil(message.payload))
            elif message.topic.split(".")[0] == "gaze":
                gaze = decode_gaze(message.payload)
                gazes.append((gaze, base_pupils(gaze)))
            else:
                others.add(message.topic)
        except SourceError as error:
            raise SourceError(f"{file}, message {message.number}: {error}. Restore the file from a copy") from None
    return others


def _messages(file: Path, notes: list[str]) -> Iterator[_Message]:
    """The whole messages of a pldata file, in its order."""
    size = file.stat().st_size
    if size == 0:
        raise SourceError(f"{file} is empty: the recorder stopped before it wrote anything; choose another recording")
    number = end = 0
    with file.open("rb") as stream:
        unpacker = msgpack.Unpacker(
            stream, max_buffer_size=_LARGEST_DATUM, max_str_len=_LARGEST_TOPIC, max_array_len=2, max_map_len=0
        )
        try:
            for number, item in enumerate(unpacker, start=1):
                match item:
                    case [str(topic), bytes(payload)]:
                        end = unpacker.tell()
                        yield _Message(number, topic, payload)
                    case _:
                        raise ValueError("it is no pair of a topic and a datum")
        except (ValueError, msgpack.UnpackException) as error:
            # msgpack's own errors often carry no text.
            reason = str(error) or type(error).__name__
            raise SourceError(
                f"{file} is no pldata file of Pupil Core, or is damaged, behind byte {end:,}: {reason}. "
                "Choose another recording, or restore the file from a copy"
            ) from None
    if number == 0:
        raise SourceError(f"{file} ends within its first message: choose another recording")
    if end < size:
        notes.append(f"{file.name} ends within a message; bytes that were left out there: {size - end:,}.")
