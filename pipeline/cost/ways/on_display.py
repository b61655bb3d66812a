"""Ways of the effects whose images are on the display: tone mapping, night colour, afterimages, encoding."""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Callable
from pathlib import Path

import colour
import jax.numpy as jnp
import msgspec
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from entoptic.pipeline import mesopic
from entoptic.pipeline.cost.plain import night_colour as plain_night
from entoptic.pipeline.cost.plain import operators
from entoptic.pipeline.cost.plain import tone as plain_tone
from entoptic.pipeline.cost.plain.adaptation import luminance, rod_share
from entoptic.pipeline.cost.ways.stage import Reals, Stage
from entoptic.pipeline.cost.ways.way import SKIPPED, Way, Ways
from entoptic.pipeline.effects import afterimage, encode, night_colour, tone
from entoptic.pipeline.effects.afterimage import Afterimage
from entoptic.pipeline.effects.night_colour import NightColour, NightMethod
from entoptic.pipeline.effects.night_colour.tints import tint, weights
from entoptic.pipeline.effects.tone import Hue, Operator, Tone
from entoptic.pipeline.frame import Encoding

CURVE = ([-3.0, -1.5, 0.0, 1.0, 2.0], [0.01, 0.1, 0.45, 0.85, 1.0])
"""A person's curve: log10 of luminance over the adapted one, share of the peak. Made up, to be timed."""

STARED_S, ASIDE_DEG = 10.0, 8.0
"""How long the eye has looked straight ahead, and how far to the right it then looks. Engineering choice: long enough
to bleach, far enough for the afterimage to lie on other things than its cause."""
CELLS_DEG, FINEST_CELL_DEG = (3.0, 1.5, Afterimage().cell_deg), 0.2
DEFAULT_CELLS = f"{Afterimage().cell_deg:g}° cells"


def tone_ways(stage: Stage) -> Ways:
    """Each operator, and each way to keep hues, against the same in float64."""
    rgb = jnp.asarray(stage.resolved)[None]
    exact, adapted = stage.resolved.astype(np.float64), stage.adapted_cd_m2
    plainly: dict[Operator, Callable[[], Reals]] = {
        Operator.ACES: lambda: operators.filmic(exact, adapted),
        Operator.REINHARD: lambda: operators.reinhard(exact, adapted),
        Operator.WARD: lambda: operators.ward(exact, adapted),
        Operator.DURAND: lambda: operators.durand(exact, adapted),
        Operator.CURVE: lambda: operators.own_curve(exact, adapted, *CURVE),
    }
    hues = {Hue.CLIP: operators.clipped, Hue.RGB: operators.divided, Hue.XYY: operators.same_chromaticity}
    settings = {
        _name(operator, hue): Tone(
            operator=operator, hue=hue, curve=_curve_file() if operator is Operator.CURVE else ""
        )
        for operator in Operator
        for hue in Hue
    }
    truths: dict[str, Callable[[], Reals]] = {
        _name(operator, hue): functools.partial(_after, plainly[operator], hues[hue])
        for operator in Operator
        for hue in Hue
    }
    truths[_name(Operator.ACES, Hue.CLIP)] = lambda: plain_tone.aces(exact, stage.exposure, stage.display.peak_cd_m2)
    return Ways(
        [
            Way(name, functools.partial(tone.show, rgb, [adapted], [adapted], of, stage.display), name, _image)
            for name, of in settings.items()
        ],
        truths,
        unit_cd_m2=stage.display.peak_cd_m2,
    )


def night_colour_ways(stage: Stage) -> Ways:
    """Each method against the same in float64; leaving it out against LUI's."""
    shown = jnp.asarray(stage.shown)[None]
    scene = jnp.asarray(stage.resolved)[None]
    exact, adapted = stage.shown.astype(np.float64), stage.adapted_cd_m2
    lui = NightMethod.LUI.value
    settings = {method.value: NightColour(method=method) for method in NightMethod}
    settings |= {"lui, mesopic": NightColour(mesopic=True), "lui, per pixel": NightColour(per_pixel=True)}

    def by_pixel() -> Reals:
        y = luminance(stage.resolved.astype(np.float64))
        share = mesopic.HALF_CD_M2 / (mesopic.HALF_CD_M2 + y)
        return plain_night.towards(exact, np.array(plain_night.TINT), share)

    def rods() -> Reals:
        method = NightMethod.RODS
        return plain_night.towards(exact, tint(method, adapted), rod_share(adapted), weights(method))

    return Ways(
        [
            Way(SKIPPED, None, lui, lambda _: exact),
            *(
                Way(name, functools.partial(night_colour.shift, shown, [adapted], of, scene), name, _image)
                for name, of in settings.items()
            ),
        ],
        {
            lui: lambda: plain_night.night_tint(exact, adapted),
            NightMethod.KRI_XY.value: lambda: plain_night.kri_xy(exact, adapted),
            NightMethod.KRI_RGB.value: lambda: plain_night.kri_rgb(exact, adapted),
            NightMethod.BAR.value: lambda: plain_night.bar(exact, adapted),
            NightMethod.RODS.value: rods,
            "lui, mesopic": lambda: plain_night.towards(exact, np.array(plain_night.TINT), mesopic.rod_share(adapted)),
            "lui, per pixel": by_pixel,
        },
        unit_cd_m2=stage.display.peak_cd_m2,
    )


def afterimage_ways(stage: Stage) -> Ways:
    """Maps of the retina against the finest, of an eye that has looked at the scene for STARED_S and then aside."""
    shown = jnp.asarray(stage.tinted)[None]
    exact, view = stage.tinted.astype(np.float64), stage.scene.frame.view
    finest = f"{FINEST_CELL_DEG:g}° cells"

    def seen(cell_deg: float) -> Array:
        retina = afterimage.rested(Afterimage(on=True, cell_deg=cell_deg), stage.exposure)
        retina = afterimage.step(
            retina,
            stage.rgb,
            view,
            view.pixel_of(0.0, 0.0),
            pupil_mm=stage.pose.pupil_mm,
            openness=1.0,
            dt_s=STARED_S,
            exposure=stage.exposure,
        )
        return afterimage.show(shown, [retina], view, [view.pixel_of(ASIDE_DEG, 0.0)])

    return Ways(
        [
            Way(SKIPPED, None, finest, lambda _: exact),
            *(
                Way(f"{cell_deg:g}° cells", functools.partial(seen, cell_deg), finest, _image)
                for cell_deg in (*CELLS_DEG, FINEST_CELL_DEG)
            ),
        ],
        {finest: lambda: _image(seen(FINEST_CELL_DEG))},
        unit_cd_m2=stage.display.peak_cd_m2,
    )


def encode_ways(stage: Stage) -> Ways:
    """Each encoding, decoded again, against the light that was to be shown."""
    linear = jnp.asarray(stage.tinted)[None]
    exact = stage.tinted.astype(np.float64)
    return Ways(
        [
            Way(
                encoding.value,
                functools.partial(encode.encode, linear, msgspec.structs.replace(stage.display, encoding=encoding)),
                "light",
                functools.partial(_decoded, encoding=encoding, peak_cd_m2=stage.display.peak_cd_m2),
            )
            for encoding in Encoding
        ],
        {"light": lambda: exact},
        unit_cd_m2=stage.display.peak_cd_m2,
    )


def _decoded(codes: NDArray[np.generic], *, encoding: Encoding, peak_cd_m2: float) -> Reals:
    """What a display makes of code values, as a share of its peak: linear Rec.709."""
    values = np.asarray(codes[0], np.float64)
    match encoding:
        case Encoding.LINEAR:
            return values.transpose(2, 0, 1)
        case Encoding.SRGB:
            light, primaries = colour.models.eotf_sRGB(values / 255), None
        case Encoding.DISPLAY_P3:
            light, primaries = colour.models.eotf_sRGB(values / 255), "Display P3"
        case Encoding.HDR10:
            light, primaries = colour.models.eotf_ST2084(values / 1023) / peak_cd_m2, "ITU-R BT.2020"
    if primaries is not None:
        spaces = colour.RGB_COLOURSPACES
        light = light @ colour.matrix_RGB_to_RGB(spaces[primaries], spaces["ITU-R BT.709"]).T
    return np.asarray(light.transpose(2, 0, 1), np.float64)


def _name(operator: Operator, hue: Hue) -> str:
    return operator.value if hue is Hue.CLIP else f"{operator.value}, hue {hue.value}"


def _curve_file() -> str:
    path = Path(_folder().name) / "curve.csv"
    if not path.exists():
        rows = "".join(f"{log},{share}\n" for log, share in zip(*CURVE, strict=True))
        path.write_text(f"log10_of_adapted,share\n{rows}", encoding="utf-8")
    return str(path)


@functools.cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    """Gone when the program ends."""
    return tempfile.TemporaryDirectory(prefix="entoptic-")


def _after(mapped: Callable[[], Reals], within: Callable[[Reals], Reals]) -> Reals:
    return within(mapped())


def _image(result: Array) -> Reals:
    """Of the one eye."""
    return np.asarray(result[0], np.float64)
