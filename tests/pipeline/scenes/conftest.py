from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

Write = Callable[..., Path]


@pytest.fixture
def write_hdr(tmp_path: Path) -> Write:
    """Writes an image (y, x, channel) under a name, with attributes in its header."""

    def write(name: str, pixels: np.ndarray, *, channels: tuple[str, ...] | None = None, **attributes: object) -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT)
        if channels is not None:
            spec.channelnames = channels
        for key, value in attributes.items():
            if key == "chromaticities":
                spec.attribute(key, oiio.TypeDesc("float[8]"), value)
            else:
                spec[key] = value
        if "textureformat" in attributes:  # OpenImageIO writes environment maps in tiles alone
            spec.tile_width = spec.tile_height = 64
        output = oiio.ImageOutput.create(str(path))
        assert output.open(str(path), spec), output.geterror()
        assert output.write_image(np.ascontiguousarray(pixels, np.float32)), output.geterror()
        assert output.close()
        del output  # closes the file of an environment map
        return path

    return write
