"""A film of perceived frames: H.264 in MP4, which every browser plays."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from types import TracebackType

import av
import numpy as np
from av.video.reformatter import ColorRange, Colorspace
from jaxtyping import UInt8

from pipeline.frame import FrameError
from pipeline.sinks.whole_file import WholeFile

CRF = "16"
"""x264's constant rate factor: visually without loss, a tenth of the size."""


class Video:
    """A context that writes one film; it takes its name when it is whole, and vanishes on an error.

    Raises FrameError if the film cannot be written, for a frame of another size, and for a film without a frame.

    Frames are code values for an sRGB display, of the size given; H.264's 4:2:0 wants even sides, so an odd side
    repeats its last row or column. The same frames give the same bytes.
    """

    def __init__(self, path: Path, width_px: int, height_px: int, fps: float) -> None:
        self._path = path
        self._file = WholeFile(path)
        self._shape = (height_px, width_px, 3)
        self._count = 0
        self._pad = ((0, height_px % 2), (0, width_px % 2), (0, 0))
        try:
            self._container = av.open(str(self._file.partial), "w", options={"movflags": "+faststart"})
        except (OSError, ValueError) as error:
            raise self._file.failed(str(error)) from None
        # With x264's macroblock tree, a busy machine gave other bytes for the same frames in 11 of 30 films; without it
        # in none of 40, at a third more bytes. The number of threads is fixed since the output depends on it.
        options = {"crf": CRF, "preset": "veryfast", "threads": "2", "x264-params": "mbtree=0"}
        rate = Fraction(fps).limit_denominator(1000)
        self._stream = self._container.add_stream("libx264", rate=rate, options=options)
        self._stream.width, self._stream.height = width_px + width_px % 2, height_px + height_px % 2
        self._stream.pix_fmt = "yuv420p"
        context = self._stream.codec_context
        context.color_primaries = context.colorspace = 1  # BT.709
        context.color_trc = 13  # sRGB (IEC 61966-2-1)
        context.color_range = ColorRange.MPEG.value

    def __enter__(self) -> Video:
        return self

    def write(self, image: UInt8[np.ndarray, "y x 3"]) -> None:
        """Adds one frame."""
        if image.shape != self._shape:
            raise FrameError(f"{self._path}: a frame of shape {image.shape} in a film of {self._shape}")
        padded = np.pad(image, self._pad, mode="edge") if any(after for _, after in self._pad) else image
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(padded), format="rgb24")
        frame = frame.reformat(
            format="yuv420p",
            src_colorspace=Colorspace.ITU709,
            dst_colorspace=Colorspace.ITU709,
            dst_color_range=ColorRange.MPEG,
        )
        self._encode(frame)
        self._count += 1

    def _encode(self, frame: av.VideoFrame | None) -> None:
        try:
            for packet in self._stream.encode(frame):
                self._container.mux(packet)
        except OSError as error:
            raise self._file.failed(str(error)) from None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None and self._count:
                self._encode(None)
        finally:
            self._close(kind is not None)
        if kind is None and not self._count:
            raise FrameError(f"{self._path}: no frame was written, so there is no film")
        if kind is None:
            self._file.keep()
        else:
            self._file.drop()

    def _close(self, failed: bool) -> None:
        """The index is written on closing, which a full disk may refuse too; an error on its way is not replaced."""
        try:
            self._container.close()
        except OSError as error:
            if not failed:
                raise self._file.failed(str(error)) from None
