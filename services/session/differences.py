"""What frames that are rendered again differ in from those of the recording, and what is promised of that.

A render log holds a digest of all frames up to each, so it tells the first that differs. By how much, the recording's
pictures tell: those of `key_frames`, and all of `frames` if they were saved as PNG. The film is no measure, being
compressed with loss.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import jax
import msgspec
import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from entoptic import __version__
from entoptic.pipeline.effects.encode import PQ_CODES, encode
from entoptic.pipeline.frame import Display, Encoding
from entoptic.services.rendering import Rendered
from entoptic.services.results.frames import side_by_side
from entoptic.services.results.machine import machine
from entoptic.services.results.render_log import Begun

OTHERWHERE_CODE_VALUES = 1
"""What frames of another machine, or of a graphics card, may differ by, with the same version of this program.
Engineering choice: they round otherwise, which moves a value that lies on the border of two codes."""


@dataclasses.dataclass(frozen=True)
class Difference:
    """The largest of one frame."""

    frame: int
    code_values: int
    x_px: int
    """Of the picture; two eyes stand side by side."""
    y_px: int
    channel: str
    values: int
    """How many of the frame's differ at all."""
    of_values: int


class Differences:
    """Of a recording's frames, given one after another."""

    def __init__(self, recording: Path, begun: Begun) -> None:
        self._folder = recording
        same_program, same_machine = begun.program == __version__, begun.machine == machine()
        self.promised: int | None = None
        """Code values that no frame differs by more than; None: nothing is promised."""
        if same_program:
            # A graphics card's many threads add up in any order.
            self.promised = 0 if same_machine and jax.default_backend() == "cpu" else OTHERWHERE_CODE_VALUES
        self._where = "" if same_machine else f"rendered on {begun.machine or 'an unknown machine'}, here {machine()}"
        self._which = "" if same_program else f"rendered by version {begun.program}, this is {__version__}"
        self.first: int | None = None
        """Number of the first frame that differs."""
        self.pictures = 0
        """Frames from there on whose picture the recording holds."""
        self.largest: Difference | None = None
        """Of those."""

    def add(self, rendered: Rendered, display: Display, *, same: bool) -> None:
        """One more frame; `same`: as the recording's, and so are all before it."""
        if same:
            return
        number = rendered.frame_number
        self.first = number if self.first is None else self.first
        pictures = self._pictures(rendered, display)
        self.pictures += bool(pictures)
        for before, now in pictures:
            found = _difference(number, before, now)
            if found is not None and (self.largest is None or found.code_values > self.largest.code_values):
                self.largest = found

    @property
    def kept(self) -> bool:
        """Whether what is promised was kept, as far as that is known."""
        if self.first is None or self.promised is None:
            return True
        if self.promised == 0:
            return False
        return self.largest is None or self.largest.code_values <= self.promised

    def __str__(self) -> str:
        """For a person."""
        if self.first is None:
            return "all frames are the same"
        told = [f"frames differ from frame {self.first} on"]
        if not self.pictures:
            told.append("by how much is not known: the recording holds no picture of them (--save png keeps all)")
        elif self.largest is None:
            told.append(f"not in the {self.pictures} of them whose pictures the recording holds")
        else:
            one = self.largest
            told.append(
                f"the largest difference in the {self.pictures} whose pictures the recording holds is "
                f"{one.code_values} code value{'s' if one.code_values > 1 else ''}, {one.channel} at x {one.x_px}, "
                f"y {one.y_px} of frame {one.frame}, of which {one.values} of {one.of_values} values differ"
            )
        told += [each for each in (self._which, self._where) if each]
        promises = "nothing is" if self.promised is None else f"{self.promised} at most is"
        return "; ".join([*told, f"{promises} promised then"])

    def _pictures(self, rendered: Rendered, display: Display) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Code values of the recording's pictures of a frame, and what they are now."""
        name, perceived = f"{rendered.frame_number:06d}", rendered.perceived
        page = msgspec.structs.replace(display, encoding=Encoding.SRGB)
        pairs = []
        if (before := _codes(self._folder / "key_frames" / f"{name}_perceived.png")) is not None:
            pairs.append((before, side_by_side(encode(perceived.linear, page)).astype(np.int64)))
        if (before := _codes(self._folder / "frames" / f"{name}.png")) is not None:
            pairs.append((before, side_by_side(perceived.image).astype(np.int64)))
        return [(before, now) for before, now in pairs if before.shape == now.shape]


def _codes(path: Path) -> NDArray[np.int64] | None:
    """Of a PNG that `write_still` or `write_png` wrote, if it is there."""
    picture = oiio.ImageInput.open(str(path)) if path.exists() else None
    if picture is None:
        return None
    depth = picture.spec().format
    values = picture.read_image(oiio.UNKNOWN)
    picture.close()
    codes = np.asarray(values).astype(np.int64)
    return (codes * PQ_CODES + 65535 // 2) // 65535 if depth == oiio.UINT16 else codes


def _difference(frame: int, before: NDArray[np.int64], now: NDArray[np.int64]) -> Difference | None:
    apart = np.abs(now - before)
    if not apart.any():
        return None
    y, x, channel = (int(index) for index in np.unravel_index(apart.argmax(), apart.shape))
    return Difference(
        frame, int(apart.max()), x, y, ("red", "green", "blue")[channel], int(np.count_nonzero(apart)), apart.size
    )
