"""Reading one HDR file: its pixels as linear Rec.709, what was wrong with them, and how bright they are meant to be.

A file's numbers are mostly relative. `cd_m2_per_unit` says what one unit is, by the first of: the mean luminance that
the person gave, the file's own `whiteLuminance`, a documented default.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, Cleaned, FrameError, clean

SUFFIXES = (".exr", ".hdr")
DEFAULT_MEAN_CD_M2 = 100.0
"""Mean luminance of a file that says nothing of its own scale: a lit room or an overcast dusk, where neither night
vision nor dazzle hides what the picture shows (engineering choice)."""

REC709_CHROMATICITIES = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""x and y of red, green, blue and white (ITU-R BT.709), in the order of OpenEXR's `chromaticities`."""
SAME_CHROMATICITY = 1e-3
"""Chromaticities nearer than this are one colour: a third of what an eye can just tell apart (MacAdam 1942)."""

LATLONG, CUBE = "LatLong Environment", "CubeFace Environment"
"""How OpenImageIO spells OpenEXR's two values of `envmap`."""


@dataclasses.dataclass(frozen=True)
class Header:
    """What a file says of itself, known without reading its pixels."""

    path: Path
    width_px: int
    height_px: int
    panorama: bool
    """Equirectangular over the whole sphere: it says so, or is twice as wide as high."""
    white_cd_m2: float | None
    """Luminance of RGB (1, 1, 1); None where the file does not say."""
    chromaticities: tuple[float, ...] | None
    """Eight numbers, as REC709_CHROMATICITIES; None for Rec.709."""


@dataclasses.dataclass(frozen=True)
class HdrFile:
    """A file's pixels in its own unit, in Rec.709, without a bad component."""

    header: Header
    rgb: np.ndarray
    """float32 (3, y, x), 0 or more."""
    cleaned: Cleaned
    notes: tuple[str, ...]
    """What was repaired or converted, a sentence each."""


def read_header(path: Path) -> Header:
    """What the file says of itself. Raises FrameError that names the file and the remedy."""
    return _header(path, _open(path))


def read(path: Path) -> HdrFile:
    """The pixels of a file. Raises FrameError that names the file and the remedy."""
    image = _open(path)
    header = _header(path, image)
    if not image.read(0, 0, True, oiio.FLOAT):
        raise FrameError(f"{path}: its pixels cannot be read ({_reason(image)}); write the file again")
    # The data window may be smaller or larger than the picture; pixels it does not reach are black.
    image = oiio.ImageBufAlgo.reorient(oiio.ImageBufAlgo.crop(image, image.roi_full))
    names = image.spec().channelnames
    pixels = np.asarray(image.get_pixels(oiio.FLOAT), np.float32)
    rgb = np.stack([pixels[:, :, names.index(name)] for name in "RGB"])
    try:
        rgb, cleaned = clean(rgb)
    except FrameError as error:
        raise FrameError(f"{path}: {error}") from None
    notes = [f"{path.name}: {cleaned} set to usable values."] if cleaned else []
    if header.chromaticities is not None:
        rgb, outside = _to_rec709(path, rgb, header.chromaticities)
        notes.append(
            f"{path.name}: converted from its own chromaticities to Rec.709"
            + (f", {outside} components outside its gamut set to 0." if outside else ".")
        )
    return HdrFile(header, np.ascontiguousarray(rgb), cleaned, tuple(notes))


def cd_m2_per_unit(file: HdrFile, mean_luminance_cd_m2: float | None) -> tuple[float, str]:
    """The scale from a file's unit to cd/m², and a sentence that says where it comes from.

    The mean of a panorama is weighted by solid angle, that of a picture is taken over its pixels. Raises FrameError
    for a black file, which has no mean to scale.
    """
    name, white = file.header.path.name, file.header.white_cd_m2
    if mean_luminance_cd_m2 is None and white is not None:
        return white, f"{name}: 1 unit is {white:g} cd/m², its own whiteLuminance."
    luminance = np.tensordot(np.array(LUMINANCE_WEIGHTS, np.float32), file.rgb, 1).mean(axis=1, dtype=np.float64)
    weights = band_solid_angles(len(luminance)) if file.header.panorama else np.ones(len(luminance))
    mean = float(np.average(luminance, weights=weights))
    target = DEFAULT_MEAN_CD_M2 if mean_luminance_cd_m2 is None else mean_luminance_cd_m2
    if mean == 0 or not math.isfinite(target / mean):
        raise FrameError(f"{file.header.path}: the image is black, so no mean luminance can be given to it")
    over = "solid-angle mean" if file.header.panorama else "mean over its pixels"
    why = "as asked" if mean_luminance_cd_m2 is not None else "the default, since the file does not say its own scale"
    return target / mean, f"{name}: 1 unit is {target / mean:.4g} cd/m², {over} {target:g} cd/m² ({why})."


def band_solid_angles(rows: int) -> np.ndarray:
    """Solid angle of each row of an equirectangular panorama, as a share of the sphere: float64, sums to 1."""
    return -np.diff(np.cos(np.linspace(0.0, np.pi, rows + 1))) / 2


def _open(path: Path) -> oiio.ImageBuf:
    """The file, its header read and its pixels not yet."""
    if path.suffix.lower() not in SUFFIXES:
        raise FrameError(f"{path}: not a format of HDR images; use {' or '.join(SUFFIXES)}")
    if not path.is_file():
        raise FrameError(f"{path}: no such file; check the path")
    image = oiio.ImageBuf(str(path))
    if not image.init_spec(str(path), 0, 0):
        raise FrameError(f"{path}: cannot be read ({_reason(image)}); write the file again")
    return image


def _reason(image: oiio.ImageBuf) -> str:
    return str(image.geterror()).strip().split("\n")[0].removesuffix(".")


def _header(path: Path, image: oiio.ImageBuf) -> Header:
    spec = image.spec()
    width, height = spec.full_width, spec.full_height
    missing = [name for name in "RGB" if name not in spec.channelnames]
    if missing:
        raise FrameError(
            f"{path}: its channels are {', '.join(spec.channelnames)}, {', '.join(missing)} missing; "
            "save it as linear RGB"
        )
    environment = spec.get_string_attribute("textureformat")
    if environment == CUBE:
        raise FrameError(f"{path}: a cube-face environment map; convert it to latlong, with exrenvmap -l for example")
    if environment == LATLONG and width != 2 * height:
        raise FrameError(
            f"{path}: a panorama of {width}×{height} pixels; an equirectangular one is twice as wide as high"
        )
    white = spec.get_float_attribute("whiteLuminance")
    chromaticities = spec.getattribute("chromaticities")
    return Header(
        path,
        width,
        height,
        panorama=width == 2 * height,
        white_cd_m2=white if math.isfinite(white) and white > 0 else None,
        chromaticities=_foreign(chromaticities),
    )


def _foreign(chromaticities: tuple[float, ...] | None) -> tuple[float, ...] | None:
    if chromaticities is None or np.allclose(chromaticities, REC709_CHROMATICITIES, rtol=0, atol=SAME_CHROMATICITY):
        return None
    return tuple(chromaticities)


def _to_rec709(path: Path, rgb: np.ndarray, chromaticities: tuple[float, ...]) -> tuple[np.ndarray, int]:
    """The same XYZ in Rec.709, and how many components were out of its gamut.

    White is not adapted: the frame says what light stands before the eye, and luminance stays as it was.
    """
    from colour.models import normalised_primary_matrix  # colour-science takes seconds to import, few files need it

    def to_xyz(xy: tuple[float, ...]) -> np.ndarray:
        return np.asarray(normalised_primary_matrix(np.reshape(xy[:6], (3, 2)), np.array(xy[6:])))

    with np.errstate(all="ignore"):
        try:
            matrix = np.linalg.solve(to_xyz(REC709_CHROMATICITIES), to_xyz(chromaticities))
        except np.linalg.LinAlgError:
            matrix = np.full((3, 3), np.nan)
    if not np.isfinite(matrix).all():
        raise FrameError(f"{path}: its chromaticities {chromaticities} span no colours; correct or remove them")
    converted = np.tensordot(matrix.astype(np.float32), rgb, 1)
    outside = converted < 0
    return np.where(outside, np.float32(0), converted), int(outside.sum())
