"""A picture before the eyes, or a folder of them one after the other.

A picture is fixed to the view: it does not follow the head, and all eyes see the same.
"""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from entoptic.pipeline.effects.effect import Cost
from entoptic.pipeline.frame import Frame, FrameError, View
from entoptic.pipeline.scenes import image_file
from entoptic.pipeline.scenes.resample import resize
from entoptic.pipeline.scenes.scene import Head, count_eyes
from entoptic.tracker_bridge.wire import Eye

FPS = 24.0
"""Pictures of a folder follow each other at the rate of cinema; after the last comes the first again."""
ASPECT_TOLERANCE = 0.01


@dataclasses.dataclass(frozen=True)
class Pictures:
    """One picture or a sequence of equal size. Implements Scene."""

    headers: tuple[image_file.Header, ...]
    cd_m2_per_unit: float
    name: str
    notes: tuple[str, ...]
    _shown: dict[tuple[Path, View, int], Frame] = dataclasses.field(default_factory=dict, repr=False, compare=False)

    @property
    def cost(self) -> Cost:
        """Of the next file, here one of two megapixels in EXR; none of a picture that is on show."""
        return Cost(20.0, 65.0) if len(self.headers) > 1 else Cost(0.0, 0.0)

    def view_for(self, width_px: int | None, height_px: int | None, fov_deg: float) -> View:
        """A view of the picture's own size, or of another with the same aspect."""
        own_width, own_height = self.headers[0].width_px, self.headers[0].height_px
        if width_px is None:
            width_px = own_width if height_px is None else max(round(height_px * own_width / own_height), 1)
        if height_px is None:
            height_px = max(round(width_px * own_height / own_width), 1)
        self._refuse_distortion(width_px, height_px)
        return View(width_px, height_px, fov_deg)

    def _refuse_distortion(self, width_px: int, height_px: int) -> None:
        own_width, own_height = self.headers[0].width_px, self.headers[0].height_px
        # A side is a whole number of pixels, so small views may miss the aspect by half a pixel.
        slack = ASPECT_TOLERANCE + 0.5 / height_px + 0.5 / width_px
        if abs(width_px / height_px / (own_width / own_height) - 1) > slack:
            fitting = max(round(width_px * own_height / own_width), 1)
            raise FrameError(
                f"{self.name} is {own_width}×{own_height} pixels, which {width_px}×{height_px} would distort: "
                f"give --width {width_px} --height {fitting}, or leave one of them out"
            )

    def frame(self, t_s: float, view: View, head: Head, eyes: tuple[Eye, ...]) -> Frame:
        """The picture of time `t_s`. Raises FrameError for a view of another aspect."""
        self._refuse_distortion(view.width_px, view.height_px)
        header = self.headers[int(max(t_s, 0.0) * FPS + 1e-6) % len(self.headers)]
        seen = (header.path, view, count_eyes(eyes))
        if seen not in self._shown:
            file = image_file.read(header.path)
            image = jnp.asarray(resize(file.rgb, view.height_px, view.width_px) * np.float32(self.cd_m2_per_unit))
            # The same array while the picture is on show, so that nothing is done twice.
            self._shown.clear()
            self._shown[seen] = Frame(jnp.stack([image] * count_eyes(eyes)), view, file.cleaned)
        return self._shown[seen]


def _in_order(path: Path) -> list[str | int]:
    """Sorts 2 before 10."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", path.name)]


def open_pictures(path: Path, mean_luminance_cd_m2: float | None) -> Pictures:
    """The picture in a file, or those in a folder by name and number; the first one sets the scale of all.

    Raises FrameError that names the file and the remedy.
    """
    paths = [path]
    if path.is_dir():
        paths = sorted((p for p in path.iterdir() if p.suffix.lower() in image_file.SUFFIXES), key=_in_order)
    if not paths:
        raise FrameError(f"{path}: no {' or '.join(image_file.SUFFIXES)} file in this folder; name one that has some")
    headers = tuple(image_file.read_header(one) for one in paths)
    for header in headers[1:]:
        if (header.width_px, header.height_px) != (headers[0].width_px, headers[0].height_px):
            raise FrameError(
                f"{header.path} is {header.width_px}×{header.height_px} pixels and {headers[0].path.name} "
                f"{headers[0].width_px}×{headers[0].height_px}: pictures of one folder must have one size"
            )
    first = image_file.read(paths[0])
    scale, sentence = image_file.cd_m2_per_unit(first, mean_luminance_cd_m2)
    many = f"{len(paths)} pictures at {FPS:g} per second" if len(paths) > 1 else "a picture, fixed before the eyes"
    name = f"picture {path.name}" if len(paths) == 1 else f"pictures in {path.name}"
    return Pictures(headers, scale, name, (f"{path.name}: {many}.", sentence, *first.notes))
