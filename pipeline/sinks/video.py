"""A film of perceived frames: H.264 in MP4, which every browser plays."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from types import TracebackType

import av
import numpy as np
from av.video.reformatter import ColorRange, Colorspace
from jaxtyping import UInt8

CRF = "16"
"""x264's constant rate factor: visually without loss, a tenth of the size."""


class Video:
    """A context that writes one film; it takes its name when it is whole, and vanishes on an error.

    Frames are code values for an sRGB display, of the size given; H.264's 4:2:0 wants even sides, so an odd side
    repeats its last row or column. The same frames give the same bytes.
    """

    def __init__(self, path: Path, width_px: int, height_px: int, fps: float) -> None:
        self._path = path
        self._partial = path.with_name(f"{path.stem}.partial{path.suffix}")
        self._pad = ((0, height_px % 2), (0, width_px % 2), (0, 0))
        self._container = av.open(str(self._partial), "w", options={"movflags": "+faststart"})
        # A fixed number of threads: x264's output depends on it.
        options = {"crf": CRF, "preset": "veryfast", "threads": "2"}
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
        padded = np.pad(image, self._pad, mode="edge") if any(after for _, after in self._pad) else image
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(padded), format="rgb24")
        frame = frame.reformat(
            format="yuv420p",
            src_colorspace=Colorspace.ITU709,
            dst_colorspace=Colorspace.ITU709,
            dst_color_range=ColorRange.MPEG,
        )
        for packet in self._stream.encode(frame):
            self._container.mux(packet)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                for packet in self._stream.encode():
                    self._container.mux(packet)
        finally:
            self._container.close()
        if kind is None:
            self._partial.replace(self._path)
        else:
            self._partial.unlink(missing_ok=True)
