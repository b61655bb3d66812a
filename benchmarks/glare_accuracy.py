"""How right glare is around a lamp anywhere in a view: every level against the direct sum over the sphere.

A lamp is one pixel. Around it, from 0.2° to 30° in all directions, the light of each level is held against that of the
direct sum, at pixels drawn at random, as many in each of 24 rings. Writes a picture, and the table to standard output.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline import Effects, EyePose, Frame, Glare, GlareLevel, GlareModel, Observer, View
from entoptic.pipeline.effects.effect import Picture
from entoptic.pipeline.effects.glare import GLARE
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, Display
from entoptic.pipeline.measure import measure
from entoptic.pipeline.oracles import glare as oracle
from entoptic.pipeline.oracles import sphere
from entoptic.pipeline.viewing import prepare, view_frame

VIEWS = {"104°, 1440×1600": View(1440, 1600, 104.0), "20°, 720×800": View(720, 800, 20.0)}
MODELS = {
    "CIE 135": (GlareModel.CIE, 4.0),
    "IJspeert, 3 mm": (GlareModel.IJSPEERT, 3.0),
    "wave, 3 mm": (GlareModel.WAVE, 3.0),
    "wave, 5 mm": (GlareModel.WAVE, 5.0),
}
LEVELS = (GlareLevel.EIGHTH, GlareLevel.QUARTER, GlareLevel.HALF)
OFF_AXIS_DEG = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0)
LAMP_CD_M2 = 1e6
RINGS = np.geomspace(0.2, 30.0, 25)
EACH = 60
"""Pixels of a ring."""


class Row(NamedTuple):
    """One lamp at one level."""

    view: str
    model: str
    level: str
    off_axis_deg: float
    share: NDArray[np.float64]
    """Of the truth, ring by ring: (ring, pixel), NaN where a ring has no pixel."""


def rows() -> Iterator[Row]:
    """Lamp by lamp."""
    random = np.random.default_rng(3)
    for view_name, view in VIEWS.items():
        for model_name, (model, pupil_diameter_mm) in MODELS.items():
            for off_axis_deg in OFF_AXIS_DEG:
                column = round(view.width_px / 2 + np.tan(np.radians(off_axis_deg)) * view.focal_px)
                if column >= view.width_px - 8:
                    continue
                pixel = view.height_px // 2, column
                rgb = np.full((3, view.height_px, view.width_px), 1e-9, np.float32)
                rgb[:, *pixel] = LAMP_CD_M2
                frame = Frame(jnp.asarray(rgb)[None], view)
                effects = Effects(glare=Glare(model))
                poses = (EyePose(pupil_diameter_mm=pupil_diameter_mm),)
                viewing = view_frame(frame, measure(frame), poses, Observer(), Display(), effects, None, 0.0)
                eye = prepare(viewing.eyes)[0]
                at = _around(view, pixel, random)
                function = oracle.function_of(eye, GLARE.prepared(eye).kernel, model.value)
                light = sphere.from_pixel(view, function, pixel, at.reshape(-1, 2)) * LAMP_CD_M2
                truth = np.einsum("o,oin->n", LUMINANCE_WEIGHTS, light) if len(light) == 3 else light[0, 0]
                for level in LEVELS:
                    picture = Picture(frame.rgb_cd_m2, frame.rgb_cd_m2)
                    seen = np.asarray(GLARE.apply(picture, [eye], effects.glare, level.value, None)[0], np.float64)
                    shown = np.einsum("c,cn->n", LUMINANCE_WEIGHTS, seen[:, at[..., 0].ravel(), at[..., 1].ravel()])
                    share = np.where(at.reshape(-1, 2)[:, 0] >= 0, shown / truth, np.nan).reshape(at.shape[:2])
                    yield Row(view_name, model_name, level.value, off_axis_deg, share)


def _around(view: View, pixel: tuple[int, int], random: np.random.Generator) -> NDArray[np.intp]:
    """Pixels of each ring, (ring, EACH, 2); −1 where there is none."""
    rows_, columns = np.indices((view.height_px, view.width_px))
    deg = sphere.angle_deg(
        sphere.directions(view, rows_, columns),
        sphere.directions(view, np.array(pixel[0]), np.array(pixel[1]))[:, None, None],
    )
    ring = np.digitize(deg, RINGS)
    found = np.full((len(RINGS) - 1, EACH, 2), -1)
    for k in range(len(RINGS) - 1):
        there = np.stack(np.nonzero(ring == k + 1), axis=1)
        if len(there):
            found[k] = there[random.integers(0, len(there), EACH)]
    return found


def main(picture: str = "docs/glare-accuracy.png") -> None:
    """Prints the table and draws the picture."""
    found = list(rows())
    print("| view | function | level | lamp off the axis | least | 1 % | median | 99 % | largest |")
    print("|---|---|---|---:|---:|---:|---:|---:|---:|")
    for row in found:
        share = row.share[np.isfinite(row.share)]
        low, one, middle, most, high = np.percentile(share, [0, 1, 50, 99, 100])
        print(
            f"| {row.view} | {row.model} | {row.level} | {row.off_axis_deg:.0f}° "
            f"| {low:.3f} | {one:.3f} | {middle:.3f} | {most:.3f} | {high:.3f} |"
        )
    _draw(found, Path(picture))


def _draw(found: list[Row], path: Path) -> None:
    from matplotlib.figure import Figure

    shown = ("CIE 135", "wave, 5 mm")
    figure = Figure(figsize=(11, 6.5), layout="constrained")
    panels = figure.subplots(len(shown), len(LEVELS), sharex=True, sharey=True)
    middles = np.sqrt(RINGS[1:] * RINGS[:-1])
    for row in found:
        if not row.view.startswith("104") or row.model not in shown:
            continue
        axes = panels[shown.index(row.model)][[level.value for level in LEVELS].index(row.level)]
        some = np.isfinite(row.share).any(axis=1)
        low, middle, high = np.nanpercentile(row.share[some], [2, 50, 98], axis=1)
        (line,) = axes.plot(middles[some], middle, label=f"{row.off_axis_deg:.0f}°", lw=1.4)
        axes.fill_between(middles[some], low, high, color=line.get_color(), alpha=0.12, lw=0)
    for k, model in enumerate(shown):
        for axes, level in zip(panels[k], LEVELS, strict=True):
            axes.set(xscale="log", ylim=(0.8, 1.2), title=f"{model}: {level.value}")
            axes.axhline(1, color="#777777", lw=0.6)
            axes.grid(alpha=0.25)
    panels[0][0].legend(title="lamp off the axis", fontsize=8)
    figure.supxlabel("angle from the lamp, degrees")
    figure.supylabel("light as a share of the direct sum's: median, 2 to 98 % of pixels")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
