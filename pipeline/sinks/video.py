"""A film of perceived frames in MP4, as the display takes them.

sRGB and Display P3 are H.264, 8 bits, which every browser plays; HDR10 is HEVC, 10 bits. A linear encoding has no film.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.video.frame import PictureType
from av.video.reformatter import ColorRange, Colorspace
from av.video.stream import VideoStream
from jaxtyping import UInt8, UInt16

from entoptic.atomic_file import atomic_file, output_errors
from entoptic.pipeline.frame import Display, Encoding, FrameError
from entoptic.pipeline.sinks import hdr10

CRF = "16"
"""x264's constant rate factor. Engineering choice: it is taken for visually lossless from 17–18 down; one or two finer,
since a film is what effects are judged by, at a tenth of the size of one without loss."""
HDR10_CRF = "12"
"""x265's. Engineering choice: PQ's codes are wider apart than 8 bits' in the dark, where an eye at night looks."""
KEY_EVERY_S = 0.5
"""Of a film that is read while it is written. Engineering choice: what is lost where its writer is killed."""
FRAGMENTED = "+frag_keyframe+empty_moov+default_base_moof"
"""Each key frame and those that hang on it are whole in themselves; no index at the end is needed."""


@dataclasses.dataclass(frozen=True)
class _Form:
    """How frames of one encoding become a stream; colours by their numbers in ITU-T H.273."""

    codec: str
    options: dict[str, str]
    at_once: dict[str, str]
    """Beside these, where no frame may be held back."""
    pixels: str
    tag: str
    dtype: type[np.uint8] | type[np.uint16]
    primaries: int
    transfer: int
    matrix: int
    picture: Callable[[np.ndarray], av.VideoFrame]


class Encoder:
    """Frames of one size and display, to be packets in a container; what both kinds of film are made with.

    Raises FrameError for an encoding that no film has, OutputError where the container cannot be written.
    """

    def __init__(self, path: Path, written: Path, size_px: tuple[int, int], fps: float, display: Display, whole: bool):
        """`written` is where it is written until it gets its `path`; width and height in px.

        `whole` films are made as small as they can be; else every frame is there as soon as it is written, and a key
        frame every KEY_EVERY_S.
        """
        width_px, height_px = size_px
        self._path, self._fps = path, fps
        self._form = _form(display, path)
        self._shape = (height_px, width_px, 3)
        self._pad = ((0, height_px % 2), (0, width_px % 2), (0, 0))
        self._next, self._key_due = 0, 0.0 if not whole else math.inf
        flags = {"movflags": "+faststart"} if whole else {"movflags": FRAGMENTED, "flush_packets": "1"}
        with output_errors(path):
            self.container = av.open(str(written), "w", format="mp4", options=flags)
        rate = Fraction(fps).limit_denominator(1000)
        options = self._form.options | ({} if whole else self._form.at_once)
        stream = self.container.add_stream(self._form.codec, rate=rate, options=options)
        assert isinstance(stream, VideoStream)
        self._stream = stream
        self._stream.width, self._stream.height = width_px + width_px % 2, height_px + height_px % 2
        self._stream.pix_fmt = self._form.pixels
        context = self._stream.codec_context
        context.color_primaries, context.color_trc = self._form.primaries, self._form.transfer
        context.colorspace = self._form.matrix
        context.color_range = ColorRange.MPEG.value
        if self._form.tag:
            context.codec_tag = self._form.tag

    @property
    def begun(self) -> bool:
        """Whether there is a frame."""
        return self._next > 0

    def write(self, image: UInt8[np.ndarray, "y x 3"] | UInt16[np.ndarray, "y x 3"], index: int | None = None) -> None:
        """Adds one frame, the next one, or the one that is shown from `index` frames after the start.

        Raises FrameError for a frame of another size or depth, or one that does not come after the one before, and
        OutputError where it cannot be written.
        """
        if image.shape != self._shape:
            raise FrameError(f"{self._path}: a frame of shape {image.shape} in a film of {self._shape}")
        if image.dtype != self._form.dtype:
            raise FrameError(
                f"{self._path}: a frame of {image.dtype} in a film of {np.dtype(self._form.dtype)}: encode it for the "
                "display that the film is made for"
            )
        index = self._next if index is None else index
        if index < self._next:
            raise FrameError(f"{self._path}: frame {index} comes too late, after frame {self._next - 1}")
        padded = np.pad(image, self._pad, mode="edge") if any(after for _, after in self._pad) else image
        frame = self._form.picture(np.ascontiguousarray(padded))
        frame.pts = index
        frame.time_base = 1 / Fraction(self._fps).limit_denominator(1000)
        if index / self._fps >= self._key_due:
            frame.pict_type = PictureType.I
            self._key_due = index / self._fps + KEY_EVERY_S
        self._encode(frame)
        self._next = index + 1

    def _encode(self, frame: av.VideoFrame | None) -> None:
        with output_errors(self._path):
            for packet in self._stream.encode(frame):
                self.container.mux(packet)

    def close(self) -> None:
        """Writes what is left, and the index; a full disk may refuse that too. Raises OutputError."""
        try:
            if self.begun:
                self._encode(None)
        finally:
            with output_errors(self._path):
                self.container.close()


@contextlib.contextmanager
def film(path: Path, size_px: tuple[int, int], fps: float, display: Display = Display()) -> Iterator[Encoder]:
    """A context that writes one film, `size_px` wide and high; it takes its name when it is whole, and vanishes on an
    error.

    Raises OutputError if the film cannot be written, FrameError for a frame of another size or depth, for a film
    without a frame, and for an encoding that no film has.

    Frames are what `encode` gives for the display, one eye's, of the size given; 4:2:0 wants even sides, so an odd side
    repeats its last row or column. The same frames give the same bytes.
    """
    with contextlib.ExitStack() as file:
        encoder = Encoder(path, file.enter_context(atomic_file(path)), size_px, fps, display, whole=True)
        try:
            yield encoder
            if not encoder.begun:
                raise FrameError(f"{path}: no frame was written, so there is no film")
        except BaseException:
            with contextlib.suppress(OSError, ValueError):  # of the two errors the first one is told
                encoder.container.close()
            raise
        with output_errors(path):
            encoder.close()
            file.close()


def _form(display: Display, path: Path) -> _Form:
    if display.encoding == Encoding.LINEAR:
        raise FrameError(f"{path}: a linear encoding has no film; write single frames as EXR, or choose another")
    if display.encoding == Encoding.HDR10:
        options = {"crf": HDR10_CRF, "preset": "ultrafast", "x265-params": hdr10.parameters(display)}
        # Apple's players know no other tag.
        at_once = {"tune": "zerolatency", "forced-idr": "1", "bf": "0"}
        return _Form("libx265", options, at_once, "yuv420p10le", "hvc1", np.uint16, 9, 16, 9, _ten_bits)
    # With x264's macroblock tree, the same frames gave other bytes in 11 of 30 films, as threads happened to run;
    # without it in none of 40, at a third more bytes. The number of threads is fixed since the output depends on it.
    options = {"crf": CRF, "preset": "veryfast", "threads": "2", "x264-params": "mbtree=0"}
    primaries = 12 if display.encoding == Encoding.DISPLAY_P3 else 1  # SMPTE EG 432-1; BT.709
    at_once = {"tune": "zerolatency", "forced-idr": "1"}
    return _Form(
        "libx264", options, at_once, "yuv420p", "", np.uint8, primaries, 13, 1, _eight_bits
    )  # 13: sRGB, IEC 61966-2-1


def _eight_bits(image: UInt8[np.ndarray, "y x 3"]) -> av.VideoFrame:
    return av.VideoFrame.from_ndarray(image, format="rgb24").reformat(
        format="yuv420p",
        src_colorspace=Colorspace.ITU709,
        dst_colorspace=Colorspace.ITU709,
        dst_color_range=ColorRange.MPEG,
    )


def _ten_bits(image: UInt16[np.ndarray, "y x 3"]) -> av.VideoFrame:
    return av.VideoFrame.from_ndarray(hdr10.planes(image), format="yuv420p10le")
