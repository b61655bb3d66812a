"""Pictures on a dark page, pixel for pixel, with their angle rulers and words."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from entoptic.services.psf.picture import SCALE, Scale

DPI = 100
GAP_PX, TITLE_PX, CAPTION_PX, FOOT_PX = 8, 30, 22, 34
PAGE, INK, RULER = "#101114", "#e8e8e8", "#ffffff"
JPEG_QUALITY = 88
"""Engineering choice: no blocks are seen around the needles, and a sheet stays below 300 kB."""


@dataclasses.dataclass(frozen=True)
class Panel:
    """One picture of a sheet."""

    caption: str
    image: UInt8[np.ndarray, "k k 3"]


@dataclasses.dataclass(frozen=True)
class Sheet:
    """Pictures in rows, all to the same scales."""

    title: str
    rows: tuple[tuple[Panel, ...], ...]
    field_deg: float
    note: str = ""
    scale: Scale = SCALE


def write(path: Path, sheet: Sheet) -> None:
    """Draws a sheet as PNG or JPEG, by the path's suffix; every pixel of its pictures is a pixel of the file."""
    columns, side = max(map(len, sheet.rows)), sheet.rows[0][0].image.shape[0]
    width = columns * side + (columns + 1) * GAP_PX
    height = TITLE_PX + len(sheet.rows) * (side + CAPTION_PX) + FOOT_PX
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor=PAGE)
    words: dict[str, Any] = {"color": INK, "va": "center"}
    figure.text(GAP_PX / width, 1 - TITLE_PX / 2 / height, sheet.title, ha="left", size=10, **words)
    for j, row in enumerate(sheet.rows):
        for i, panel in enumerate(row):
            left = GAP_PX + i * (side + GAP_PX)
            bottom = height - TITLE_PX - (j + 1) * (side + CAPTION_PX) + CAPTION_PX
            axes = figure.add_axes((left / width, bottom / height, side / width, side / height))
            show(axes, panel.image, sheet.field_deg)
            middle = ((left + side / 2) / width, (bottom - CAPTION_PX / 2) / height)
            figure.text(*middle, panel.caption, ha="center", size=8, **words)
    foot = f"{sheet.field_deg:g}° wide · lightness: {sheet.scale}"
    if sheet.note:
        foot += f"\n{sheet.note}"
    figure.text(GAP_PX / width, FOOT_PX / 2 / height, foot, ha="left", size=7, linespacing=1.3, **words)
    save(figure, path)


def save(figure: Figure, path: Path) -> None:
    """PNG or JPEG, by the path's suffix; the same figure gives the same bytes."""
    if path.suffix == ".png":
        figure.savefig(path, dpi=DPI, metadata={"Software": None})
    else:
        figure.savefig(path, dpi=DPI, pil_kwargs={"quality": JPEG_QUALITY, "optimize": True})


def show(axes: Axes, image: UInt8[np.ndarray, "k k 3"], field_deg: float, *, rings: bool = False) -> None:
    """A picture in degrees, right and up from the light, with a scale bar and, if wanted, rings at whole degrees."""
    half = field_deg / 2
    axes.imshow(image, extent=(-half, half, -half, half), interpolation="nearest")
    axes.set(xlim=(-half, half), ylim=(-half, half), xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    bar = bar_deg(field_deg)
    start = -half + 0.04 * field_deg
    axes.plot([start, start + bar], [-half + 0.04 * field_deg] * 2, color=RULER, lw=2, solid_capstyle="butt")
    axes.text(start, -half + 0.055 * field_deg, f"{bar:g}°", color=RULER, size=8, va="bottom")
    if rings:
        for radius in ring_radii_deg(field_deg):
            axes.add_patch(Circle((0, 0), radius, fill=False, color=RULER, lw=0.6, ls=(0, (2, 6)), alpha=0.7))
            # On the diagonal, where no needle of a ring's label hides the halo's left, right, top or bottom.
            at = radius / math.sqrt(2)
            axes.text(at, at, f"{radius:g}°", color=RULER, size=8, ha="left", va="bottom")


def bar_deg(field_deg: float) -> float:
    """The longest of 1, 2 or 5 times a power of ten that is no more than a fifth of the field."""
    power = 10.0 ** math.floor(math.log10(field_deg / 5))
    return max(step * power for step in (1, 2, 5) if step * power <= field_deg / 5 * (1 + 1e-9))


def ring_radii_deg(field_deg: float) -> Sequence[float]:
    """Whole degrees within the field; in a field under 2°, multiples of its scale bar."""
    step = 1.0 if field_deg >= 2 else bar_deg(field_deg)
    every = max(1, round(field_deg / 2 / step / 8))
    return [step * every * k for k in range(1, int(field_deg / 2 / step / every + 1e-9) + 1)]
