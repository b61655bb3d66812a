"""Single frames as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from jaxtyping import Float, UInt8

from pipeline.frame import FrameError
from pipeline.sinks.whole_file import WholeFile


def write_png(path: Path, image: UInt8[np.ndarray, "y x 3"]) -> None:
    """Writes code values for an sRGB display. Raises FrameError if the file cannot be written."""
    spec = oiio.ImageSpec(image.shape[1], image.shape[0], 3, oiio.UINT8)
    spec.attribute("oiio:ColorSpace", "sRGB")
    spec.attribute(
        "png:compressionLevel", 2
    )  # a frame of the street: 56 ms instead of the default's 98, 29 % more bytes
    _write(path, spec, image)


def write_exr(path: Path, image: Float[np.ndarray, "y x 3"]) -> None:
    """Writes linear Rec.709 RGB in cd/m², float32; `whiteLuminance` says that 1 is 1 cd/m².

    No chromaticities are stored: OpenEXR's default is Rec.709. Raises FrameError if the file cannot be written.
    """
    spec = oiio.ImageSpec(image.shape[1], image.shape[0], 3, oiio.FLOAT)
    spec.attribute("compression", "zip")
    spec.attribute("whiteLuminance", 1.0)
    spec.attribute("DateTime", "1970:01:01 00:00:00")  # or the hour of writing is put in: same frame, same bytes
    _write(path, spec, image.astype(np.float32))


def _write(path: Path, spec: oiio.ImageSpec, image: np.ndarray) -> None:
    file = WholeFile(path)
    output = oiio.ImageOutput.create(str(file.partial))
    if output is None:
        raise FrameError(f"{path}: {oiio.geterror()}")
    written = output.open(str(file.partial), spec) and output.write_image(np.ascontiguousarray(image))
    # On a full disk a PNG reports success all the way and only leaves a message; and some bytes go out on closing.
    error = output.geterror()
    written = output.close() and written
    error = error or output.geterror()
    if error or not written:
        raise file.failed(error)
    file.keep()
