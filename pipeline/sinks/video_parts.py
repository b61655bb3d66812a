"""Films of what happens now: readable while they are written, and whole however their writer ends.

A part begins wherever a writer begins; frames keep their times, so that frames left out leave the one before standing.
Parts become one film afterwards, by copying: no frame is encoded twice.
"""

from __future__ import annotations

import contextlib
import re
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.container import InputContainer, OutputContainer
from av.video.stream import VideoStream
from jaxtyping import UInt8, UInt16

from entoptic.atomic_file import atomic_file, output_errors
from entoptic.pipeline.frame import Display, FrameError
from entoptic.pipeline.sinks.video import Encoder

_BEGINS = "begins at "
"""What a part says of itself, and then at how many seconds, as a fraction; a film of parts what its first one said."""


class Part:
    """One stretch of a film: fragmented MP4. Half a second at most is lost where its writer is killed.

    Raises OutputError if it cannot be written, FrameError for a frame of another size or depth, and for an encoding
    that no film has.
    """

    def __init__(
        self, path: Path, width_px: int, height_px: int, fps: float, display: Display, first_frame: int
    ) -> None:
        self._path, self._first = path, first_frame
        self._encoder = Encoder(path, path, (width_px, height_px), fps, display, whole=False)
        begins_s = first_frame / Fraction(fps).limit_denominator(1000)
        self._encoder.container.metadata["comment"] = f"{_BEGINS}{begins_s}"
        with output_errors(path):
            self._encoder.container.start_encoding()

    def write(self, image: UInt8[np.ndarray, "y x 3"] | UInt16[np.ndarray, "y x 3"], frame: int) -> None:
        """Adds a frame by its number, of which there are `fps` a second."""
        self._encoder.write(image, frame - self._first)

    def close(self) -> None:
        """Writes what is left; a part without a frame vanishes."""
        try:
            self._encoder.close()
        finally:
            if not self._encoder.begun:
                self._path.unlink(missing_ok=True)


def join(parts: list[Path], out: Path) -> tuple[tuple[Path, str], ...]:
    """One film of all parts, with the gaps between them; returns those that are not in it, and why not. It begins
    where the first of them does (`begins_s`).

    A part that its writer left torn counts up to its last whole frame, one that holds no frame not at all. Raises
    OutputError if the film cannot be written, FrameError if there is no frame in any part.
    """
    with output_errors(out), atomic_file(out) as partial:
        with av.open(str(partial), "w", format="mp4", options={"movflags": "+faststart"}) as film:
            joined = _Joined(film)
            notes = [(path, _append(joined, path)) for path in parts]
        if joined.stream is None:
            raise FrameError(f"{out}: no part holds a frame, so there is no film")
    return tuple((path, note) for path, note in notes if note is not None)


class _Joined:
    """A film on its way."""

    def __init__(self, container: OutputContainer) -> None:
        self.container = container
        self.stream: VideoStream | None = None
        self.form: tuple[object, ...] = ()
        self.begins_s = Fraction(0)
        self.last_dts = -1


def _append(joined: _Joined, path: Path) -> str | None:
    """Adds a part; says what was left out."""
    try:
        part = av.open(str(path), "r", format="mp4")
    except (OSError, ValueError):  # what is no film is a ValueError
        return f"{path.name} holds no whole frame."
    with part:
        if not part.streams.video:
            return f"{path.name} holds no whole frame."
        source = part.streams.video[0]
        begins_s = _said_to_begin(part)
        assert source.time_base is not None
        form = (source.codec_context.name, source.codec_context.extradata, source.time_base)
        if joined.stream is not None and form != joined.form:
            return f"{path.name} is of another form than the parts before it and stands alone."
        count = 0
        with contextlib.suppress(av.error.InvalidDataError, av.error.EOFError):
            for packet in part.demux(source):
                if packet.dts is None or packet.pts is None or packet.is_corrupt:
                    continue
                if joined.stream is None:
                    joined.container.metadata["comment"] = f"{_BEGINS}{begins_s}"
                    joined.stream = joined.container.add_stream_from_template(source)
                    joined.stream.time_base = source.time_base
                    joined.form, joined.begins_s = form, begins_s
                offset = round((begins_s - joined.begins_s) / source.time_base)
                count += 1
                packet.pts += offset
                packet.dts += offset
                if packet.dts <= joined.last_dts:
                    continue
                joined.last_dts = packet.dts
                packet.stream = joined.stream
                joined.container.mux(packet)
    return None if count else f"{path.name} holds no whole frame."


def begins_s(path: Path) -> float | None:
    """When the first frame of a part, or of a film of parts, is due; 0 where it does not say, None where it holds no
    whole frame."""
    try:
        with av.open(str(path), "r", format="mp4") as film:
            if any(packet.pts is not None and not packet.is_corrupt for packet in film.demux(video=0)):
                return float(_said_to_begin(film))
    except (OSError, ValueError, IndexError):  # av's errors are OSErrors or ValueErrors; without a stream IndexError
        pass
    return None


def _said_to_begin(film: InputContainer) -> Fraction:
    found = re.fullmatch(re.escape(_BEGINS) + r"(\d+(?:/[1-9]\d*)?)", film.metadata.get("comment", ""))
    return Fraction(found[1]) if found else Fraction(0)
