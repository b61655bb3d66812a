"""Every level of glare against the direct sum over the sphere: `python -m benchmarks.glare_lamps FOLDER [FRAME.hdr …]`.

Lamps of one pixel at several places, each by every model and level, as shares of the truth in rings around them; and
extended light, the scenes of the cost tables and frames given as files, in code values. Writes glare-accuracy.md and
glare-accuracy.png into the folder.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from entoptic.pipeline import Display, Effects, EyeContext, EyePose, Frame, Glare, Observer, View
from entoptic.pipeline.cost import scenes
from entoptic.pipeline.effects import adaptation
from entoptic.pipeline.effects.effect import Picture
from entoptic.pipeline.effects.glare import GLARE, GlareLevel, GlareModel
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.measure import measure
from entoptic.pipeline.optics import light_spectra
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.oracles import point_spread, sphere, tone, wave_spread
from entoptic.pipeline.scenes import image_file
from entoptic.pipeline.viewing import view_frame

Reals = NDArray[np.float64]
Indices = NDArray[np.intp]

VIEWS = (View(720, 720, 20.0), View(1440, 1600, 104.0))
LAMPS_DEG = (0, 10, 20, 30, 40, 50)
"""Off the axis, to the right; a view of 20° has them to 9°."""
LAMP_CD_M2 = 1e6
RINGS_DEG = (0.2, 0.35, 0.6, 1.0, 1.5, 2.2, 3.0, 4.0, 5.0, 6.0, 7.5, 9.0, 12.0, 16.0, 22.0, 30.0)
PER_RING = 2000
ADAPTED_CD_M2 = 100.0
"""Photopic, for SPE; nothing else depends on it."""
NODES = 6
"""A side of a pixel, of wave optics' function averaged over as large a part of one."""
SIDE_PX = 160
"""Of a frame of extended light. Engineering choice: each pixel's sum is over 26 thousand others."""


@dataclasses.dataclass(frozen=True)
class Eye:
    """A model, and the pupil that it is shown at."""

    name: str
    model: GlareModel
    pupil_diameter_mm: float


EYES = (
    Eye("cie", GlareModel.CIE, 4.0),
    Eye("ijspeert", GlareModel.IJSPEERT, 4.0),
    Eye("spe, rings' means", GlareModel.SPE, 4.0),
    Eye("wave 3 mm", GlareModel.WAVE, 3.0),
    Eye("wave 5 mm", GlareModel.WAVE, 5.0),
)
OBSERVER = Observer()


@dataclasses.dataclass(frozen=True, eq=False)
class Shares:
    """What a level shows of the truth around one lamp."""

    view: View
    eye: Eye
    level: str
    lamp_deg: int
    deg: Reals
    """Of the rings' middles."""
    low: Reals
    median: Reals
    high: Reals


def main(arguments: Sequence[str]) -> None:
    """Measures, draws and writes."""
    folder, files = Path(arguments[0]), arguments[1:]
    found = [shares for view in VIEWS for eye in EYES for shares in lamps(view, eye)]
    _plot(found).savefig(folder / "glare-accuracy.png", dpi=80)
    text = _lamp_table(found) + "\n\n" + _scene_table(list(extended(files)))
    (folder / "glare-accuracy.md").write_text(text + "\n")


def show(light: NDArray[np.float32], view: View, eye: Eye, level: GlareLevel) -> Reals:
    """A frame (3, y, x) with the glare of a level: the one place that knows how the program is called."""
    settings = Glare(model=eye.model, level=level)
    context = _context(light, view, eye, settings)
    image = jnp.asarray(light)[None]
    shown = GLARE.apply(Picture(image, image), (context,), settings, level.value, None)
    return np.asarray(shown[0], np.float64)


def _context(light: NDArray[np.float32], view: View, eye: Eye, settings: Glare) -> EyeContext:
    frame = Frame(jnp.asarray(light)[None], view)
    pose = EyePose(0.0, 0.0, eye.pupil_diameter_mm)
    effects = Effects(glare=settings)
    made = view_frame(frame, measure(frame), (pose,), OBSERVER, Display(), effects, None, 0.0).eyes[0]
    adapted = dataclasses.replace(made, adapted=dataclasses.replace(made.adapted, luminance_cd_m2=ADAPTED_CD_M2))
    return dataclasses.replace(adapted, prepared={GLARE.name: GLARE.prepare(adapted, settings)})


def levels() -> list[GlareLevel]:
    """All that claim to be whole."""
    return [level for level in GlareLevel if level.value not in ("veil", "reference")]


def truth(light: Reals, view: View, eye: Eye, at: Indices) -> Reals:
    """What arrives at pixels, (3, n), from all others."""
    if eye.model is not GlareModel.WAVE:
        return sphere.arrives(light, view, analytic(eye), at)
    count = light_spectra.wavelengths_for(view.ppd_centre)
    return sphere.arrives_directed(light, view, _wave(eye, count, 1 / view.ppd_centre / NODES), at, nodes=NODES)


def analytic(eye: Eye) -> point_spread.Density:
    """A model's own function; SPE's without its flare lines, which keep the mean."""
    match eye.model:
        case GlareModel.CIE:
            return point_spread.cie135(OBSERVER.age_years, wave_spread.PIGMENTATION[OBSERVER.iris.value])
        case GlareModel.IJSPEERT:
            return point_spread.ijspeert(eye.pupil_diameter_mm, OBSERVER.age_years, IJSPEERT_M[OBSERVER.iris.value])
    return point_spread.spe("photopic", OBSERVER.age_years)


IJSPEERT_M = {"dark": 0.056, "brown": 0.106, "green": 0.142, "blue": 0.16}
"""IJspeert 1993; green is the population's mean."""


@functools.lru_cache(maxsize=4)
def _wave(eye: Eye, wavelengths: int, box_deg: float) -> sphere.Directed:
    return wave_spread.wave(OBSERVER, Pose(eye.pupil_diameter_mm), wavelengths, box_deg)


def lamps(view: View, eye: Eye) -> Iterator[Shares]:
    """Each lamp that the view holds, by each level."""
    for lamp_deg in LAMPS_DEG:
        column = int(view.pixel_of(lamp_deg, 0.0)[0])
        if column >= view.width_px:
            continue
        place = (view.height_px // 2, column)
        light = np.zeros((3, view.height_px, view.width_px))
        light[(slice(None), *place)] = LAMP_CD_M2
        at, ring = _around(view, place)
        right = _luminance(truth(light, view, eye, at))
        for level in levels():
            shown = _luminance(show(light.astype(np.float32), view, eye, level))[at[:, 0], at[:, 1]]
            share = shown / right
            parts = [share[ring == k] for k in range(len(RINGS_DEG) - 1)]
            if eye.model is GlareModel.SPE:
                # Its flare lines keep the mean alone.
                parts = [
                    np.mean(shown[ring == k], keepdims=True) / np.mean(right[ring == k]) for k in range(len(parts))
                ]
            low, median, high = (
                np.array([f(part) if part.size else math.nan for part in parts]) for f in (np.min, np.median, np.max)
            )
            middles = np.sqrt(np.array(RINGS_DEG[1:]) * np.array(RINGS_DEG[:-1]))
            yield Shares(view, eye, level.value, lamp_deg, middles, low, median, high)


def _around(view: View, place: tuple[int, int]) -> tuple[Indices, Indices]:
    """Pixels around a lamp at random, and which ring each lies in."""
    directions = sphere.directions(view)
    angle = np.degrees(2 * np.arcsin(np.linalg.norm(directions - directions[place], axis=-1) / 2))
    random = np.random.default_rng(14)
    chosen = []
    for low, high in itertools.pairwise(RINGS_DEG):
        inside = np.argwhere((angle >= low) & (angle < high))
        chosen.append(inside if len(inside) <= PER_RING else random.choice(inside, PER_RING, replace=False))
    return np.concatenate(chosen), np.repeat(np.arange(len(chosen)), [len(part) for part in chosen])


def _luminance(rgb: Reals) -> Reals:
    return np.asarray(np.tensordot(LUMINANCE_WEIGHTS, rgb, axes=1))


def _lamp_table(found: Sequence[Shares]) -> str:
    rows = []
    for one in found:
        worst = np.nanargmax(np.abs(np.log(np.maximum(np.stack([one.low, one.high]), 1e-6))), axis=1)
        rows.append(
            [
                f"{one.view.fov_deg:g}°",
                one.eye.name,
                one.level,
                f"{one.lamp_deg}°",
                f"{np.nanmedian(one.median):.3f}",
                f"{np.nanmin(one.low):.3f} at {one.deg[worst[0]]:.1f}°",
                f"{np.nanmax(one.high):.3f} at {one.deg[worst[1]]:.1f}°",
            ]
        )
    return _markdown(["view", "model", "level", "lamp at", "median", "least", "most"], rows)


def _markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def extended(files: Sequence[str]) -> Iterator[tuple[str, str, Reals]]:
    """Of each scene and level, by how many code values pixels are off, with CIE's function; sorted."""
    view = View(SIDE_PX, SIDE_PX, 104.0)
    eye = EYES[0]
    for name, light in _lights(view, files):
        right = sphere.glare(light, view, analytic(eye))
        adapted = adaptation.target_cd_m2(measure(Frame(jnp.asarray(light, jnp.float32)[None], view))[0], 0.0, 0.0)
        codes = _codes(right, adapted)
        for level in levels():
            shown = show(light.astype(np.float32), view, eye, level)
            yield name, level.value, np.sort(np.abs(_codes(shown, adapted) - codes).max(axis=0).ravel())


def _codes(rgb: Reals, adapted_cd_m2: float) -> Reals:
    exposure = adaptation.exposure(adapted_cd_m2)
    return np.rint(255 * tone.srgb(tone.aces(rgb, exposure, Display().peak_cd_m2)))


def _lights(view: View, files: Sequence[str]) -> Iterator[tuple[str, Reals]]:
    for name, make in scenes.SCENES.items():
        yield name, np.asarray(make(view).rgb_cd_m2[0], np.float64)
    for number, path in enumerate(files, 1):
        yield f"photograph {number}", _shrunk(path, view)


def _shrunk(path: str, view: View) -> Reals:
    """The middle square of an image, averaged over boxes to the view's size."""
    file = image_file.read(Path(path))
    scale, _ = image_file.cd_m2_per_unit(file, None)
    image = np.asarray(file.rgb, np.float64) * scale
    side = min(image.shape[1:]) // view.width_px * view.width_px
    top, left = ((size - side) // 2 for size in image.shape[1:])
    square, box = image[:, top : top + side, left : left + side], side // view.width_px
    return np.asarray(square.reshape(3, view.height_px, box, view.width_px, box).mean(axis=(2, 4)))


def _scene_table(found: Sequence[tuple[str, str, Reals]]) -> str:
    rows = [
        [name, level, f"{off.mean():.2f}", f"{off[int(0.99 * len(off))]:.0f}", f"{off[-1]:.0f}"]
        for name, level, off in found
    ]
    return _markdown(["scene, CIE", "level", "mean code values off", "99 % of pixels within", "most"], rows)


def _plot(found: Sequence[Shares]) -> Figure:
    figure = Figure(figsize=(15, 3.2 * len(VIEWS) * len(levels())), layout="constrained")
    rows = [(view, level.value) for view in VIEWS for level in levels()]
    panels = figure.subplots(len(rows), len(EYES), sharex=True, squeeze=False)
    colours = dict(zip(LAMPS_DEG, ("#000000", "#2a6fbb", "#3d8b5f", "#e0a030", "#c8553d", "#8a5aa8"), strict=True))
    for line, (view, level) in zip(panels, rows, strict=True):
        for panel, eye in zip(line, EYES, strict=True):
            for one in found:
                if (one.view, one.level, one.eye) != (view, level, eye):
                    continue
                colour = colours[one.lamp_deg]
                panel.fill_between(one.deg, one.low, one.high, color=colour, alpha=0.12, lw=0)
                panel.semilogx(one.deg, one.median, color=colour, label=f"{one.lamp_deg}°")
            panel.set(ylim=(0, 1.5), title=f"{eye.name}, {level}, view of {view.fov_deg:g}°")
            panel.axhline(1, color="black", lw=0.5, ls=":")
            panel.grid(alpha=0.3)
        line[0].set_ylabel("share of the truth")
    for panel in panels[-1]:
        panel.set_xlabel("degrees from the lamp")
    panels[-1][0].legend(title="lamp off the axis", fontsize=7)
    return figure


if __name__ == "__main__":
    main(sys.argv[1:])
