"""Single frames as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from jaxtyping import Float, UInt8

from pipeline.frame import FrameError


def write_png(path: Path, image: UInt8[np.ndarray, "y x 3"]) -> None:
    """Writes code values for an sRGB display. Raises FrameError if the file cannot be written."""
    spec = oiio.ImageSpec(image.shape[1], image.shape[0], 3, oiio.UINT8)
    spec.attribute("oiio:ColorSpace", "sRGB")
    spec.attribute("png:compressionLevel", 2)  # a third of the time of the default, a tenth more bytes
    _write(path, spec, image)


def write_exr(path: Path, image: Float[np.ndarray, "y x 3"]) -> None:
    """Writes linear Rec.709 RGB in cd/m², float32; `whiteLuminance` says that 1 is 1 cd/m².

    Raises FrameError if the file cannot be written.
    """
    spec = oiio.ImageSpec(image.shape[1], image.shape[0], 3, oiio.FLOAT)
    spec.attribute("compression", "zip")
    spec.attribute("whiteLuminance", 1.0)
    _write(path, spec, image.astype(np.float32))


def _write(path: Path, spec: oiio.ImageSpec, image: np.ndarray) -> None:
    output = oiio.ImageOutput.create(str(path))
    if output is None:
        raise FrameError(f"{path}: {oiio.geterror()}")
    try:
        if not (output.open(str(path), spec) and output.write_image(np.ascontiguousarray(image))):
            raise FrameError(f"{path} cannot be written: {output.geterror()}")
    finally:
        output.close()
