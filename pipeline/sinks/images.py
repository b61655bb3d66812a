"""Single frames as files: what a display takes, and what a scene holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from jaxtyping import Float, UInt8, UInt16

from entoptic.atomic_file import atomic_file, output_errors
from entoptic.pipeline.effects.encode import PQ_CODES
from entoptic.pipeline.frame import Display, Encoding, FrameError

P3_CICP, PQ_CICP = (12, 13, 0, 1), (9, 16, 0, 1)
"""Primaries, transfer function, no matrix, full range (ITU-T H.273), as PNG's cICP chunk says them."""
P3_NAME, PQ_NAME = "srgb_p3d65_display", "pq_rec2020_display"
"""What OpenImageIO calls them; without, it says sRGB in chunks of its own."""
PNG_LEVEL = 2
"""Engineering choice: a frame of the street takes 0.6 of the default level's time and 29 % more bytes."""


def still_path(path: Path, display: Display) -> Path:
    """The path with the suffix that a still for this display has."""
    return path.with_suffix(".exr" if display.encoding == Encoding.LINEAR else ".png")


def write_still(
    path: Path,
    image: UInt8[np.ndarray, "y x 3"] | UInt16[np.ndarray, "y x 3"] | Float[np.ndarray, "y x 3"],
    display: Display,
) -> None:
    """Writes what `encode` gives for a display, one eye's: PNG that names its colour space, EXR for linear light.

    HDR10's 10 bits fill the 16 of a PNG. Raises OutputError if the file cannot be written, FrameError for a path of
    another suffix than `still_path` gives.
    """
    if path.suffix != still_path(path, display).suffix:
        raise FrameError(f"{path}: a still for {display.encoding} is written as {still_path(path, display).name}")
    if display.encoding == Encoding.LINEAR:
        _write_linear(path, np.asarray(image, np.float32), display.peak_cd_m2)
    elif display.encoding == Encoding.HDR10:
        # From 0…1023 to 0…65535, rounded.
        codes = (image.astype(np.uint32) * 65535 + PQ_CODES // 2) // PQ_CODES
        _write_tagged(path, codes.astype(np.uint16), PQ_NAME, PQ_CICP)
    elif display.encoding == Encoding.DISPLAY_P3:
        _write_tagged(path, image, P3_NAME, P3_CICP)
    else:
        write_png(path, image)


def write_png(path: Path, image: UInt8[np.ndarray, "y x 3"]) -> None:
    """Writes code values for an sRGB display. Raises OutputError if the file cannot be written."""
    spec = oiio.ImageSpec(image.shape[1], image.shape[0], 3, oiio.UINT8)
    spec.attribute("oiio:ColorSpace", "sRGB")
    spec.attribute("png:compressionLevel", PNG_LEVEL)
    _write(path, spec, image)


def write_exr(path: Path, image: Float[np.ndarray, "y x 3"]) -> None:
    """Writes linear Rec.709 RGB in cd/m², float32; `whiteLuminance` says that 1 is 1 cd/m².

    No chromaticities are stored: OpenEXR's default is Rec.709. Raises OutputError if the file cannot be written.
    """
    _write_linear(path, image, 1.0)


def _write_linear(path: Path, image: Float[np.ndarray, "y x 3"], cd_m2_per_unit: float) -> None:
    spec = oiio.ImageSpec(image.shape[1], image.shape[0], 3, oiio.FLOAT)
    spec.attribute("compression", "zip")
    spec.attribute("whiteLuminance", cd_m2_per_unit)
    spec.attribute("DateTime", "1970:01:01 00:00:00")  # or the hour of writing is put in: same frame, same bytes
    _write(path, spec, image.astype(np.float32))


def _write_tagged(path: Path, image: np.ndarray, name: str, cicp: tuple[int, int, int, int]) -> None:
    spec = oiio.ImageSpec(image.shape[1], image.shape[0], 3, oiio.UINT16 if image.dtype == np.uint16 else oiio.UINT8)
    spec.attribute("oiio:ColorSpace", name)
    spec.attribute("CICP", oiio.TypeDesc("int[4]"), cicp)
    spec.attribute("png:compressionLevel", PNG_LEVEL)
    _write(path, spec, image)


def _write(path: Path, spec: oiio.ImageSpec, image: np.ndarray) -> None:
    with output_errors(path), atomic_file(path) as partial:
        output = oiio.ImageOutput.create(str(partial))
        if output is None:
            raise FrameError(f"{path}: {oiio.geterror()}")
        written = output.open(str(partial), spec) and output.write_image(np.ascontiguousarray(image))
        # On a full disk a PNG reports success all the way and only leaves a message; and some bytes go out on closing.
        error = output.geterror()
        written = output.close() and written
        error = error or output.geterror()
        if error or not written:
            raise OSError(error)
