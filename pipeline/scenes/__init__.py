"""Where frames come from.

scene.py            what every scene is: a name, notes, a view, and a frame for a time and a head
head_path.py        how the head moves
image_file.py       one HDR file: pixels, repairs, absolute scale
panorama.py         an equirectangular panorama around the head
images.py           a picture before the eyes, or a folder of them in turn
night_street.py     the embedded scene: a street at night in real luminances
street_plan.py      where what stands in it
street_rays.py      what each pixel's ray meets
street_surfaces.py  its sky, ground and facades
street_facades.py   the buildings
street_patterns.py  stripes and windows averaged over a pixel
discs.py            lights that may be smaller than a pixel
resample.py         other sizes with the same light
"""

from __future__ import annotations

import math
from pathlib import Path

from entoptic.pipeline.frame import FrameError
from entoptic.pipeline.scenes import image_file
from entoptic.pipeline.scenes.images import open_pictures
from entoptic.pipeline.scenes.night_street import NightStreet
from entoptic.pipeline.scenes.panorama import Panorama
from entoptic.pipeline.scenes.scene import Head, Scene

__all__ = ["NIGHT_STREET", "Head", "Scene", "open_scene"]

NIGHT_STREET = "night-street"


def open_scene(spec: str, *, mean_luminance_cd_m2: float | None = None) -> Scene:
    """The scene that `spec` names: "night-street", an HDR file (.hdr, .exr), or a folder of them.

    A file twice as wide as high, or one that says so, is a panorama, any other a picture. Raises FrameError that
    names the thing and the remedy.
    """
    if mean_luminance_cd_m2 is not None and not (math.isfinite(mean_luminance_cd_m2) and mean_luminance_cd_m2 > 0):
        raise FrameError(f"mean luminance {mean_luminance_cd_m2} cd/m²: it must be a positive number")
    if spec == NIGHT_STREET:
        if mean_luminance_cd_m2 is not None:
            raise FrameError(f"{NIGHT_STREET} has absolute luminances of its own: leave the mean luminance out")
        return NightStreet()
    path = Path(spec)
    if path.is_dir():
        return open_pictures(path, mean_luminance_cd_m2)
    if not path.exists():
        raise FrameError(
            f'scene "{spec}": no such file or folder; use "{NIGHT_STREET}", an .hdr or .exr file or a folder'
        )
    if not image_file.read_header(path).panorama:
        return open_pictures(path, mean_luminance_cd_m2)
    file = image_file.read(path)
    scale, sentence = image_file.cd_m2_per_unit(file, mean_luminance_cd_m2)
    return Panorama.from_file(file, scale, (sentence, *file.notes))
